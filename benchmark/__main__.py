"""``python -m benchmark``."""

from benchmark.cli.main import program

program()
