"""Verbs of the command line in this process."""

from __future__ import annotations

import typer
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.errors import BenchmarkError

VERBS = typer.main.get_command(cli).commands


def call(*arguments: object, code: int = 0) -> str:
    """Run a verb, which must end with this exit code; returns what it said, or the error with which
    it refuses.
    """
    done = CliRunner().invoke(cli, [*map(str, arguments)])
    if isinstance(done.exception, BenchmarkError):
        assert code == 2, repr(done.exception)
        return str(done.exception)
    assert done.exception is None or isinstance(done.exception, SystemExit), repr(done.exception)
    assert done.exit_code == code, done.output
    return done.output


def refusal(*arguments: object) -> str:
    """Return the error of a verb that refuses, as the program prints it on one line."""
    return call(*arguments, code=2)
