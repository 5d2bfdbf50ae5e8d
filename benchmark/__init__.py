"""The harness: what to run, running it, showing it."""

__version__ = "0.2.0"
