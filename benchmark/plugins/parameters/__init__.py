"""Parameters of methods: what they may be, how they are written, and when two ways to write them are the same."""
