"""Robustness of methods: curves from records, and how they are written."""
