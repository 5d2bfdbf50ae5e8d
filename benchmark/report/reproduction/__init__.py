"""Reproduction of the paper's tables: an outcome for each of its figures, and for each of its claims."""
