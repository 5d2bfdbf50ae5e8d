"""The program and how it ends; nothing heavy is imported before a verb needs it, so ``--help`` answers at once."""

from __future__ import annotations

import io
import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import ClassVar, NoReturn

import click

from benchmark import __version__
from benchmark.cli import completion
from benchmark.cli.options import INTERRUPTED, TERMINATED, USAGE
from benchmark.cli.verbs.compilation import compile_
from benchmark.cli.verbs.data import data
from benchmark.cli.verbs.forms import canonicalise, check
from benchmark.cli.verbs.names import describe, list_
from benchmark.cli.verbs.new import new
from benchmark.cli.verbs.paper import paper
from benchmark.cli.verbs.results import compare, merge, prune, why
from benchmark.cli.verbs.retrieve import retrieve
from benchmark.cli.verbs.run import plan, run
from benchmark.cli.verbs.score import score
from benchmark.cli.verbs.submit import submit
from benchmark.cli.verbs.tables import report, tables
from benchmark.cli.verbs.train import train
from benchmark.cli.verbs.verify import verify
from benchmark.errors import BenchmarkError
from benchmark.text import say

#: How the program is called in what it says.
PROGRAM = "python -m benchmark"

#: Exit code where whoever reads the output goes away, as shells tell of the signal for it.
NOT_LISTENED = 141

#: What is said behind an interruption, by verb: what of the work is there when it is taken up again.
KEPT = {
    "run": "; finished jobs are kept, and of the others the shapes that were done: run again to go on",
    "train": "; what the method has saved is kept: train again to go on",
    "merge": "; each record is whole or absent: merge again to go on",
}


class Terminated(KeyboardInterrupt):
    """Somebody, or a queue system, ends the program by SIGTERM; all that heeds Ctrl-C heeds it."""


class _GroupedVerbs(click.Group):
    """Shows the verbs of daily use first in ``--help``, and the others by what they are for."""

    sections: ClassVar[dict[str, tuple[str, ...]]] = {
        "Daily use": ("run", "plan", "tables", "report", "list", "describe", "canonicalise", "retrieve"),
        "Own methods and data": ("new", "check", "train", "data"),
        "Results": ("why", "compare", "paper", "merge", "prune", "submit", "verify"),
        "Set-up": ("compile", "completion"),
    }

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        named = {name for names in self.sections.values() for name in names}
        others = {"Others": tuple(name for name in self.list_commands(ctx) if name not in named)}
        for title, names in (self.sections | others).items():
            if names:
                with formatter.section(title):
                    formatter.write_dl([(name, self.commands[name].get_short_help_str(160)) for name in names])


@click.group(cls=_GroupedVerbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="benchmark")
def cli() -> None:
    """Canonical forms for non-rigid 3D shape retrieval: run methods, score them, regenerate the tables."""


@cli.command("completion")
@click.argument("shell", type=click.Choice(completion.SHELLS))
def completion_(shell: str) -> None:
    """Print a shell completion script: eval "$(canonical-forms completion bash)"."""
    click.echo(completion.script(cli, shell))


for verb in (
    run, plan, list_, describe, tables, report, paper, canonicalise, retrieve, check, new,
    data, train, merge, compare, score, submit, verify, prune, why, compile_,
):  # fmt: skip
    cli.add_command(verb)


def program() -> None:
    """Run the command line as a program of its own, into which no plugin comes."""
    from benchmark.plugins.closing import close_process

    close_process("Inspected")
    if signal.getsignal(signal.SIGTERM) == signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _terminate)
    main()


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    signal.signal(number, signal.SIG_DFL)  # a second one ends it at once
    raise Terminated


def main() -> None:
    """Run the command line; problems that the user can correct are one line and exit code 2."""
    from benchmark.kernel_cache import choose_kernel_cache
    from benchmark.threads import pin_threads

    pin_threads()
    choose_kernel_cache()
    _open_streams()
    if (asked := completion.answer(cli)) is not None:
        sys.exit(asked)
    verb = ""
    try:
        with cli.make_context(PROGRAM, sys.argv[1:]) as context:
            verb = next((word for word in sys.argv[1:] if word in cli.commands), "")
            cli.invoke(context)
    except click.exceptions.Exit as end:
        sys.exit(end.exit_code)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(USAGE)
    except click.ClickException as error:
        _refuse(_usage(error))
    except BenchmarkError as error:
        _refuse(str(error))
    except Terminated:
        _refuse(f"terminated{KEPT.get(verb, '; each file is whole or absent')}", TERMINATED)
    except (click.Abort, KeyboardInterrupt):
        _refuse(f"interrupted{KEPT.get(verb, '')}", INTERRUPTED)
    except BrokenPipeError:
        for number in (1, 2):  # what is left in their buffers goes nowhere, without a word
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)
        sys.exit(NOT_LISTENED)
    except OSError as error:
        hint = "change its rights" if isinstance(error, PermissionError) else "make room"
        _refuse(f"{error.filename or 'writing the output'}: {error.strerror}; {hint} or choose another place")


def _open_streams() -> None:
    """Open what the caller has closed of the standard streams, so that no file takes the place of one."""
    for number, mode in enumerate((os.O_RDONLY, os.O_WRONLY, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.dup2(os.open(os.devnull, mode), number)
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal that lacks a character ends no run


def _refuse(problem: str, code: int = USAGE) -> NoReturn:
    """End with one line."""
    with suppress(OSError):
        say(problem if code != USAGE else f"error: {problem}", err=True)
    sys.exit(code)


def _usage(error: click.ClickException) -> str:
    """Return what is wrong with a command line, and where to read how it is written."""
    context = getattr(error, "ctx", None)
    return f"{error.format_message().rstrip('.')}; see '{context.command_path if context else PROGRAM} --help'"
