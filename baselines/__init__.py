"""Classical methods: one file each, to be read alongside the paper."""
