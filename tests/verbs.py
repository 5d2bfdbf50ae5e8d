"""Verbs of the command line in this process."""

from __future__ import annotations

from typer.testing import CliRunner

from benchmark.cli.main import cli


def call(*arguments: object, code: int = 0) -> str:
    """Run a verb, which must end with this exit code; returns what it said."""
    done = CliRunner().invoke(cli, [*map(str, arguments)])
    assert done.exception is None or isinstance(done.exception, SystemExit), repr(done.exception)
    assert done.exit_code == code, done.output
    return done.output
