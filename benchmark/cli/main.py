"""The verbs of the command line; nothing heavy is imported before a verb needs it, so ``--help`` answers at once."""

from __future__ import annotations

import io
import os
import re
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

import click

from benchmark import __version__
from benchmark.cli.data import COLUMNS, data, print_rows
from benchmark.cli.options import (
    INTERRUPTED,
    NOT_OK,
    OK,
    USAGE,
    PathOption,
    Selection,
    data_root_option,
    name_skipped,
    plugin_option,
    results_option,
    selection_options,
    timeout_option,
)
from benchmark.cli.results import compare, merge, prune, why
from benchmark.cli.train import train
from benchmark.errors import BenchmarkError, ConfigurationError, one_line
from benchmark.system.text import brief, clean, say, say_lines

RETRY = ("failed", "timeout", "crashed", "killed", "memory", "unsupported", "all")
FORMATS = ("latex", "markdown", "csv", "json")

#: How the program is called in what it says.
PROGRAM = "python -m benchmark"

#: Exit code where whoever reads the output goes away, as shells tell of the signal for it.
NOT_LISTENED = 141

#: Characters of a method with its parameters that do not belong into the name of a file.
_NOT_IN_NAMES = r"[^\w.,=()\[\]-]"


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="benchmark")
def cli() -> None:
    """Canonical forms for non-rigid 3D shape retrieval: run methods, score them, regenerate the tables."""


@cli.command()
@click.option("--all", "everything", is_flag=True, help="All tables, methods and inputs.")
@selection_options
@click.option("-j", "--jobs", type=click.IntRange(min=1), metavar="N", help="Jobs at a time; all cores by default.")
@click.option("--executor", type=click.Choice(["serial", "processes"]), default="processes", show_default=True)
@timeout_option("one job", "2h")
@click.option("--retry", multiple=True, type=click.Choice(RETRY), help="Run failures of this kind again.")
def run(
    everything: bool, jobs: int | None, executor: str, timeout: float, retry: tuple[str, ...], **options: Any
) -> None:
    """Run what is missing of a selection, then print its tables."""
    from benchmark.jobs.run_plan import run_plan
    from benchmark.methods.registry import methods
    from benchmark.report.content import contents
    from benchmark.report.formats import markdown
    from benchmark.report.results import Results
    from benchmark.storage.store import Store
    from benchmark.threads import available_cores

    selection = Selection.of(options | {"retry": frozenset(retry)})
    if not everything and not (selection.tables or selection.methods or selection.datasets or selection.plugins):
        raise ConfigurationError("nothing is selected", "pass --all, or choose with -t, -d or -m")
    store = Store.open(selection.results)
    plan = selection.jobs(store)
    ok = run_plan(plan, store, selection, executor, jobs or available_cores(), timeout)
    galleries = {job.gallery.name for job in plan}
    inputs = {job.input for job in plan}
    results = Results(store, methods(selection.plugins), selection.data_root).all(selection.seed)
    name_skipped(store)
    shown = [r for r in results if r.record["gallery"] in galleries and r.record["input"] in inputs]
    for table in contents(shown, {job.gallery.table.identifier for job in plan}):
        say_lines("\n" + markdown(table))
    sys.exit(OK if ok else NOT_OK)


@cli.command()
@click.option("--all", "everything", is_flag=True, help="All tables, methods and inputs (the default).")
@selection_options
def plan(everything: bool, **options: Any) -> None:
    """Show what a run would do, and why."""
    from benchmark.storage.store import Store

    selection = Selection.of(options)
    jobs = selection.jobs(Store.open(selection.results))
    width = max(len(clean(job.name)) for job in jobs)
    for job in jobs:
        say(f"{job.state:<11}  {clean(job.name):<{width}}  {brief(job.reason)}")
    say(f"{sum(job.to_run for job in jobs)} of {len(jobs)} jobs to run")


@cli.command("list")
@click.argument("what", type=click.Choice(["methods", "datasets", "tables", "models"]))
@click.option("--json", "as_json", is_flag=True, help="For other programs.")
@plugin_option
@results_option
@data_root_option
def list_(what: str, as_json: bool, plugins: tuple[Path, ...], results: Path, data_root: Path | None) -> None:
    """List what can be named on the command line."""
    from benchmark.cli import listing

    rows = {
        "methods": lambda: listing.methods(plugins),
        "datasets": lambda: listing.datasets(data_root),
        "tables": lambda: listing.tables(data_root),
        "models": lambda: listing.models(results),
    }[what]()
    print_rows(rows, as_json, COLUMNS if what == "datasets" else ())


@cli.command()
@selection_options
@click.option("--format", "formats", multiple=True, type=click.Choice(FORMATS), help="Default: markdown; all with -o.")
@click.option(
    "-o",
    "--output",
    type=PathOption(),
    metavar="DIR",
    help="Write files instead of printing.",
)
@click.option("--check", is_flag=True, help="Compare with the files in -o DIR; exit 1 if they differ.")
@click.option("--fresh", is_flag=True, help="Leave out rows that were made by other code or versions.")
def tables(formats: tuple[str, ...], output: Path | None, check: bool, fresh: bool, **options: Any) -> None:
    """Make the tables anew from the records of finished jobs; nothing is computed, and no data is needed."""
    from benchmark.report.content import contents
    from benchmark.report.files import render, stale, write
    from benchmark.storage.store import Store

    if check and output is None:
        raise ConfigurationError("--check has nothing to compare with", "name the folder of the tables with -o DIR")
    selection = Selection.of(options)
    store = Store.open(selection.results)
    content = contents(selection.recorded(store, fresh=fresh), selection.tables)
    if output is None:
        for text in render(content, formats or ("markdown",)).values():
            say_lines(text)
        return
    files = render(content, formats or FORMATS)
    if not check:
        write(files, output)
        say(f"wrote {', '.join(files)} to {output}")
        return
    different = stale(files, output)
    say(f"stale: {', '.join(different)}" if different else f"{len(files)} files are up to date")
    sys.exit(NOT_OK if different else OK)


@cli.command()
@selection_options
@click.option(
    "-o",
    "--output",
    type=PathOption(),
    default=Path("results/report"),
    show_default=True,
    metavar="DIR",
)
@timeout_option("one form that is not in the store")
def report(output: Path, timeout: float, **options: Any) -> None:
    """Write a static HTML page with the tables, and a figure of the canonical forms of each gallery."""
    from benchmark.report.content import contents
    from benchmark.report.files import write
    from benchmark.report.page import page
    from benchmark.report.pictures.forms import forms_figures
    from benchmark.storage.store import Store

    selection = Selection.of(options)
    store = Store.open(selection.results)
    jobs = selection.jobs(store)
    figures = forms_figures(jobs, store, selection, output, timeout)
    write({"index.html": page(contents(selection.recorded(store), selection.tables), figures)}, output)
    say(f"wrote {output / 'index.html'} and {len(figures)} figures")


@cli.command()
@click.option("-m", "--method", "method", required=True, metavar="METHOD", help="Method; see 'list methods'.")
@click.argument("source", type=PathOption(), metavar="IN")
@click.option(
    "-o",
    "--output",
    type=PathOption(),
    metavar="OUT",
    help="Mesh file to write; by default IN-METHOD.off beside IN.",
)
@plugin_option
@timeout_option("making the form")
@click.option("--seed", type=int, default=0, show_default=True)
def canonicalise(
    method: str, source: Path, output: Path | None, plugins: tuple[Path, ...], timeout: float, seed: int
) -> None:
    """Write the canonical form of one mesh."""
    from benchmark.cli.canonicalise import canonicalise_facts
    from benchmark.system.calls import call_apart

    target = output or source.with_name(f"{source.stem}-{re.sub(_NOT_IN_NAMES, '_', method)}.off")
    n_vertices, notes = call_apart(
        canonicalise_facts, str(source), str(target), method, [str(path) for path in plugins], seed,
        what=f"method '{method}' on {source}", mend="try another shape, or mend the method", limit=timeout,
    )  # fmt: skip
    facts = ", ".join(
        f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in notes.items()
    )
    say(f"{target}: {n_vertices} vertices{', ' + facts if facts else ''}")


@cli.command()
@click.argument("target", metavar="METHOD|FILE")
@timeout_option("one check")
def check(target: str, timeout: float) -> None:
    """Check that a method, or each method of a plugin file, keeps the contract; exit 1 if it does not."""
    from benchmark.methods.conformance import check_apart

    report = check_apart(target, timeout)
    say_lines(str(report))
    sys.exit(OK if report else NOT_OK)


@cli.group()
def new() -> None:
    """Write files to start from."""


@new.command("method")
@click.argument("name")
def new_method(name: str) -> None:
    """Write a working plugin file called NAME and its test into this folder."""
    from benchmark.methods import scaffold

    for path in scaffold.new_method(name):
        say(path)


for verb in (data, train, merge, compare, prune, why):
    cli.add_command(verb)


def main() -> None:
    """Run the command line; problems that the user can mend are one line and exit code 2."""
    from benchmark.threads import pin_threads

    pin_threads()
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
        _refuse(_usage(error))
    except BenchmarkError as error:
        _refuse(str(error))
    except (click.Abort, KeyboardInterrupt):
        _refuse("interrupted; finished jobs are kept", INTERRUPTED)
    except BrokenPipeError:
        for number in (1, 2):  # what is left in their buffers goes nowhere, without a word
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)
        sys.exit(NOT_LISTENED)
    except OSError as error:
        _refuse(f"{error.filename or 'writing the output'}: {error.strerror}; make room or choose another place")
    except Exception as error:
        culprit = _plugin_in(error)
        if not culprit:
            raise
        _refuse(f"plugin {culprit} raises {one_line(error)}; mend the file")


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
        say(problem if code == INTERRUPTED else f"error: {problem}", err=True)
    sys.exit(code)


def _usage(error: click.ClickException) -> str:
    """What is wrong with a command line, and where to read how it is written."""
    context = getattr(error, "ctx", None)
    return f"{error.format_message().rstrip('.')}; see '{context.command_path if context else PROGRAM} --help'"


def _plugin_in(error: BaseException) -> str:
    """The plugin file that an exception comes from; "" if it is one of our own."""
    frames = traceback.extract_tb(error.__traceback__)
    files = {module.__file__ for name, module in list(sys.modules.items()) if name.startswith("plugin_")}
    return next((frame.filename for frame in reversed(frames) if frame.filename in files), "")
