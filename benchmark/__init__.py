"""The harness: what to run, running it, showing it."""

__version__ = "0.1.0"
