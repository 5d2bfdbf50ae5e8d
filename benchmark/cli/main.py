"""Entry point of the command line, and its exit codes."""

from __future__ import annotations

import io
import os
import signal
import sys
from bdb import BdbQuit
from contextlib import suppress
from functools import partial
from importlib.metadata import version
from types import FrameType
from typing import Annotated, NoReturn

import typer
from typer.exceptions import TyperException

from benchmark.cli.verbs import OF_DATA, VERBS
from benchmark.errors import BenchmarkError
from benchmark.kernels import choose_kernel_cache
from benchmark.machine import pin_threads
from benchmark.text import say

#: Name of the program in messages.
PROGRAM = "python -m benchmark"

#: Exit codes: misuse, and an interruption.
USAGE, INTERRUPTED = 2, 130

#: What an interrupted verb leaves.
_REMAINS = {
    "run": "; finished jobs are kept, finished shapes too: run again to continue",
    "train": "; checkpoints are kept: train again to continue",
    "merge": "; added records are kept: merge again to finish",
}

_typer = partial(typer.Typer, no_args_is_help=True, rich_markup_mode=None, pretty_exceptions_enable=False)


def _print_version(wanted: bool) -> None:
    if wanted:
        say(f"canonical-forms {version('canonical-forms-benchmark')}")
        raise typer.Exit


def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """Canonical forms for non-rigid 3D shape retrieval: run methods, score them, make the tables."""


cli = _typer(context_settings={"help_option_names": ["-h", "--help"]})
cli.callback()(root)
data = _typer(help="Check, draw or export data sets.")
for _app, _verbs in ((cli, VERBS), (data, OF_DATA)):
    for _verb in _verbs:
        _app.command(_verb.__name__.partition("_")[0])(_verb)
cli.add_typer(data, name="data")


def program() -> None:
    """Run the command line; an error that the user can correct is printed on one line, with exit code 2."""
    if signal.getsignal(signal.SIGTERM) == signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _interrupt)
    pin_threads()
    choose_kernel_cache()
    _open_streams()
    try:
        code = cli(standalone_mode=False)  # which turns KeyboardInterrupt into a code
    except BdbQuit:  # a debugger was left
        code = INTERRUPTED
    except TyperException as error:
        _refuse_usage(error)
    except BenchmarkError as error:
        _end(f"error: {error}", USAGE)
    except OSError as error:
        hint = "change its permissions" if isinstance(error, PermissionError) else "free some space"
        where = str(error.filename or "writing the output")[:200]
        _end(f"error: {where}: {error.strerror}; {hint} or choose another place", USAGE)
    if code == INTERRUPTED:
        _end(f"interrupted{_REMAINS.get(next(iter(sys.argv[1:]), ''), '')}", INTERRUPTED)
    sys.exit(code)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    signal.signal(number, signal.SIG_DFL)  # a second one ends the program immediately
    raise KeyboardInterrupt


def _refuse_usage(error: TyperException) -> NoReturn:
    """Print what is wrong with the words on one line, or the help where there are none."""
    text = error.format_message()
    if text.startswith("Usage: "):
        with suppress(OSError):
            print(text, file=sys.stderr)  # noqa: T201
        sys.exit(USAGE)
    path = getattr(getattr(error, "ctx", None), "command_path", PROGRAM)
    _end(f"error: {text.replace('Value error, ', '').rstrip('.')}; see '{path} --help'", USAGE)


def _open_streams() -> None:
    """Reopen closed standard streams, so that no other file gets their descriptors."""
    for number, mode in enumerate((os.O_RDONLY, os.O_WRONLY, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.dup2(os.open(os.devnull, mode), number)
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a character that the terminal lacks must not end a run


def _end(line: str, code: int) -> NoReturn:
    with suppress(OSError):
        say(line, err=True)
    sys.exit(code)
