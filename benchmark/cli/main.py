"""The program and how it ends; the module of a verb is imported when it is called, so ``--help`` answers at once."""

from __future__ import annotations

import io
import os
import signal
import sys
from contextlib import suppress
from importlib import import_module
from types import FrameType
from typing import NoReturn

import click
from click.shell_completion import CompletionItem, get_completion_class, shell_complete

from benchmark import __version__
from benchmark.cli.declare import argument
from benchmark.cli.options import INTERRUPTED, TERMINATED, USAGE, verb
from benchmark.errors import BenchmarkError
from benchmark.kernel_cache import choose_kernel_cache
from benchmark.machine import pin_threads
from benchmark.plugins import close_process
from benchmark.text import say

#: How the program is called in messages.
PROGRAM = "python -m benchmark"

#: The installed program, whose words a shell completes, and the environment variable by which the shell asks for them.
_COMPLETED, _COMPLETE = "canonical-forms", "_CANONICAL_FORMS_COMPLETE"

#: Exit code where the reader of the output goes away, as shells report the signal for it.
CLOSED_PIPE = 141

#: Verbs behind the names of their modules, by section of ``--help``, with the first sentences of their own help.
VERBS = {
    "Daily use": {
        "run.run": "Run the missing jobs of a selection, then print its tables.",
        "plan.plan": "Show what would run, why, and how long it would take.",
        "show.tables": "Print tables of finished jobs, or write them to files; needs no data.",
        "report.report": "Write HTML pages: tables, charts, canonical forms in 3D, and every query with its nearest"
        " shapes.",
        "methods.list": "List methods, scorers, data sets, tables or models.",
        "methods.describe": "Describe a method: parameters, source, inputs.",
        "forms.canonicalise": "Write the canonical form of a mesh, or of depth images.",
        "forms.retrieve": "Show the shapes of a gallery that are nearest to a depth image or a mesh.",
    },
    "Own methods and data": {
        "methods.new": "Write a plugin to start from, with a test.",
        "train.check": "Test the contract of a method, or of everything in a plugin file; exit 1 if it fails.",
        "train.train": "Train the models of a learner; resume an interrupted training, and skip finished models.",
        "data.data": "List, check, draw or export data sets.",
    },
    "Results": {
        "plan.why": "Explain a job: state, reason, versions, cost, failure.",
        "show.compare": "Compare two methods, two results folders, or two scorers.",
        "report.paper": "Write a LaTeX paper of results: protocol, tables, figures, statistics, sources; compile it by"
        " 'make' in DIR.",
        "share.merge": "Join the records of several results folders; exit 1 if they contradict each other.",
        "share.prune": "Delete data that no record needs, and remains of killed processes.",
        "share.submit": "Write the finished jobs of a method into a bundle that anyone can verify.",
        "share.verify": "Compute the scores of a bundle again; none of its code runs without --run.",
    },
    "Set-up": {
        "compilation.compile": "Compile the kernels and build the body model in advance; otherwise the first run does.",
        "main.completion": 'Print a shell completion script: eval "$(canonical-forms completion bash)".',
    },
    "Others": {"score.score": "Score a distance matrix or ranked lists of any program."},
}
_MODULES = {place.partition(".")[2]: place.partition(".")[0] for verbs in VERBS.values() for place in verbs}

#: What an interruption leaves of the work, by verb.
_REMAINS = {
    "run": "; finished jobs are kept, finished shapes too: run again to continue",
    "train": "; checkpoints are kept: train again to continue",
    "merge": "; added records are kept: merge again to finish",
}


class Terminated(KeyboardInterrupt):
    """Somebody, or a queue system, ends the program by SIGTERM; all that heeds Ctrl-C heeds it."""


class _Verbs(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(_MODULES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _MODULES:
            return None
        module = import_module(f"benchmark.cli.{_MODULES[cmd_name]}")
        commands = (value for value in vars(module).values() if isinstance(value, click.Command))
        return next(command for command in commands if command.name == cmd_name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for title, verbs in VERBS.items():
            with formatter.section(title):
                formatter.write_dl([(place.partition(".")[2], sentence) for place, sentence in verbs.items()])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        names = [CompletionItem(name) for name in sorted(_MODULES) if name.startswith(incomplete)]
        return [*names, *click.Command.shell_complete(self, ctx, incomplete)]


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="benchmark")
def cli() -> None:
    """Canonical forms for non-rigid 3D shape retrieval: run methods, score them, regenerate the tables."""


@verb
def completion(shell: str = argument(type=click.Choice(["bash", "zsh", "fish"]))) -> None:
    """Print a shell completion script: eval "$(canonical-forms completion bash)"."""
    if maker := get_completion_class(shell):
        click.echo(maker(cli, {}, _COMPLETED, _COMPLETE).source())


def program() -> None:
    """Run the command line as a program of its own, into which no plugin comes."""
    close_process()
    if signal.getsignal(signal.SIGTERM) == signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _terminate)
    main()


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    signal.signal(number, signal.SIG_DFL)  # a second one ends it at once
    raise Terminated


def main() -> None:
    """Run the command line; problems that the user can correct are one line and exit code 2."""
    pin_threads()
    choose_kernel_cache()
    _open_streams()
    if asked := os.environ.get(_COMPLETE):
        sys.exit(shell_complete(cli, {}, _COMPLETED, _COMPLETE, asked))
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
        name = next((word for word in sys.argv[1:] if word in _MODULES), "")
        is_terminated = isinstance(error, Terminated)
        word, code = ("terminated", TERMINATED) if is_terminated else ("interrupted", INTERRUPTED)
        _end(f"{word}{_REMAINS.get(name, '')}", code)
    except BrokenPipeError:
        for number in (1, 2):  # what is left in their buffers goes nowhere, without a word
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)
        sys.exit(CLOSED_PIPE)
    except OSError as error:
        hint = "change its permissions" if isinstance(error, PermissionError) else "free some space"
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


def _refuse(problem: str) -> NoReturn:
    _end(f"error: {problem}", USAGE)


def _end(line: str, code: int) -> NoReturn:
    with suppress(OSError):
        say(line, err=True)
    sys.exit(code)
