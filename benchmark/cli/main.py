"""Entry point of the command line, and its exit codes."""

from __future__ import annotations

import io
import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import NoReturn

import click

from benchmark import __version__
from benchmark.cli.options import INTERRUPTED, SECTIONS, TERMINATED, USAGE
from benchmark.errors import BenchmarkError
from benchmark.kernels import choose_kernel_cache
from benchmark.machine import pin_threads
from benchmark.plugins import close_process
from benchmark.text import say

#: Name of the program in messages.
PROGRAM = "python -m benchmark"

#: Exit code if the reader of the output closes it: 128 + SIGPIPE.
CLOSED_PIPE = 141


#: Message after an interruption, by command.
_REMAINS = {
    "run": "; finished jobs are kept, finished shapes too: run again to continue",
    "train": "; checkpoints are kept: train again to continue",
    "merge": "; added records are kept: merge again to finish",
}


class Terminated(KeyboardInterrupt):
    """SIGTERM from a user or a queue system; handled like Ctrl-C."""


class _Verbs(click.Group):
    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for title, commands in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl(
                    [
                        (str(command.name), " ".join((command.help or "").split("\n\n")[0].split()))
                        for command in commands
                    ]
                )


@click.group(
    cls=_Verbs,
    commands=[command for commands in SECTIONS.values() for command in commands],
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(__version__, prog_name="benchmark")
def cli() -> None:
    """Canonical forms for non-rigid 3D shape retrieval: run methods, score them, regenerate the tables."""


def program() -> None:
    """Run the command line as a program; this process imports no plugin."""
    close_process()
    if signal.getsignal(signal.SIGTERM) == signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _terminate)
    main()


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    signal.signal(number, signal.SIG_DFL)  # a second one ends the program immediately
    raise Terminated


def main() -> None:
    """Run the command line; an error that the user can correct is printed on one line, with exit code 2."""
    pin_threads()
    choose_kernel_cache()
    _open_streams()
    try:
        with cli.make_context(PROGRAM, sys.argv[1:]) as context:
            cli.invoke(context)
    except click.exceptions.Exit as end:
        sys.exit(end.exit_code)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(USAGE)
    except click.ClickException as error:
        path = error.ctx.command_path if isinstance(error, click.UsageError) and error.ctx else PROGRAM
        _refuse(f"{error.format_message().rstrip('.')}; see '{path} --help'")
    except BenchmarkError as error:
        _refuse(str(error))
    except (click.Abort, KeyboardInterrupt) as error:
        name = next((word for word in sys.argv[1:] if word in cli.commands), "")
        is_terminated = isinstance(error, Terminated)
        word, code = ("terminated", TERMINATED) if is_terminated else ("interrupted", INTERRUPTED)
        _end(f"{word}{_REMAINS.get(name, '')}", code)
    except BrokenPipeError:
        for number in (1, 2):  # discard their buffers silently
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)
        sys.exit(CLOSED_PIPE)
    except OSError as error:
        hint = "change its permissions" if isinstance(error, PermissionError) else "free some space"
        _refuse(f"{error.filename or 'writing the output'}: {error.strerror}; {hint} or choose another place")


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


def _refuse(problem: str) -> NoReturn:
    _end(f"error: {problem}", USAGE)


def _end(line: str, code: int) -> NoReturn:
    with suppress(OSError):
        say(line, err=True)
    sys.exit(code)
