"""Faults made on purpose, and what the suite makes of them: ``python -m tools.faults``."""
