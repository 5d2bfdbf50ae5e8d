"""Entry point of the command line, and its exit codes."""

from __future__ import annotations

import io
import os
import signal
import sys
from bdb import BdbQuit
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from typer.exceptions import TyperException

from benchmark.cli.verbs import cli
from benchmark.errors import BenchmarkError
from benchmark.kernel_cache import choose_kernel_cache
from benchmark.machine import pin_threads
from benchmark.reads import watch_this_process
from benchmark.text import say

#: Name of the program in messages.
PROGRAM = "python -m benchmark"

#: Exit code of misuse.
USAGE = 2

#: Verbs that go on where they were interrupted, and what they keep.
_KEEPING = {
    "run": "finished jobs, shapes and checkpoints",
    "train": "finished models and checkpoints",
    "models": "fetched models",
}

#: Most letters of the path in a message.
_LONGEST_PLACE = 200

#: Exit code of an interruption.
INTERRUPTED = 130


def _print_version(wanted: bool) -> None:
    """Print the version, and end."""
    if wanted:
        say(f"canonical-forms {version('canonical-forms-benchmark')}")
        raise typer.Exit


@cli.callback(
    help="Canonical forms for non-rigid 3D shape retrieval: "
    "run methods, score them, make the tables."
)
def root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Take the options that stand before a verb."""


def program() -> None:
    """Run the command line.

    An error that the user can correct is printed on one line, with exit code 2.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as nohup has it
        signal.signal(signal.SIGHUP, signal.default_int_handler)
    pin_threads()  # before any library starts some
    # No command opens a window. A notebook names its own backend to the programs that it starts,
    # and matplotlib refuses one that is not installed beside it.
    os.environ["MPLBACKEND"] = "agg"
    choose_kernel_cache()
    watch_this_process()
    _open_streams()
    try:
        Path.cwd()  # most commands need it
    except FileNotFoundError:
        _end("error: the working folder was removed; go to one that exists", USAGE)
    try:
        code = cli(standalone_mode=False)  # which turns KeyboardInterrupt into a code
    except BdbQuit:  # a debugger was left
        code = INTERRUPTED
    except TyperException as error:
        _refuse_usage(error)
    except BenchmarkError as error:
        _end(f"error: {error}", USAGE)
    except OSError as error:
        where = str(error.filename or "writing the output")[:_LONGEST_PLACE]
        _end(f"error: {where}: {error.strerror or error}; choose another place", USAGE)
    if code == INTERRUPTED:
        _end(_interruption(sys.argv[1:]), INTERRUPTED)
    sys.exit(code)


def _interruption(words: Sequence[str]) -> str:
    """Say that a command was interrupted, and what it has kept."""
    if words and words[0] in _KEEPING:
        return f"interrupted; {_KEEPING[words[0]]} are kept: run again to continue"
    return "interrupted; run again"


def _refuse_usage(error: TyperException) -> NoReturn:
    """Print what is wrong with the words on one line, or the help where there are none."""
    text = error.format_message().replace(": Value error, ", ": ")  # as pydantic begins a reason
    if text.startswith("Usage: "):
        with suppress(OSError):
            print(text, file=sys.stderr)  # noqa: T201
        sys.exit(USAGE)
    path = getattr(getattr(error, "ctx", None), "command_path", PROGRAM)
    _end(f"error: {text.rstrip('.')}; see '{path} --help'", USAGE)


def _open_streams() -> None:
    """Reopen closed standard streams in their order, before another file gets their numbers."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A character that the terminal lacks must not end a run.
            stream.reconfigure(errors="backslashreplace")


def _end(line: str, code: int) -> NoReturn:
    """Print a line beside the output, and end with an exit code."""
    with suppress(OSError):
        say(line, err=True)
    sys.exit(code)
