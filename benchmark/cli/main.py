"""The verbs of the command line; nothing heavy is imported before a verb needs it, so ``--help`` answers at once."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any

import click

from benchmark import __version__
from benchmark.cli.data import data, print_rows
from benchmark.cli.options import (
    INTERRUPTED,
    NOT_OK,
    OK,
    USAGE,
    Duration,
    Selection,
    data_root_option,
    name_skipped,
    plugin_option,
    results_option,
    selection_options,
)
from benchmark.cli.results import compare, merge, prune, why
from benchmark.cli.train import train
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.system.text import brief, clean, say, say_lines

RETRY = ("failed", "timeout", "crashed", "killed", "memory", "unsupported", "all")
FORMATS = ("latex", "markdown", "csv", "json")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="benchmark")
def cli() -> None:
    """Canonical forms for non-rigid 3D shape retrieval: run methods, score them, regenerate the tables."""


@cli.command()
@click.option("--all", "everything", is_flag=True, help="All tables, methods and inputs.")
@selection_options
@click.option("-j", "--jobs", type=click.IntRange(min=1), metavar="N", help="Jobs at a time; all cores by default.")
@click.option("--executor", type=click.Choice(["serial", "processes"]), default="processes", show_default=True)
@click.option(
    "--timeout",
    type=Duration(),
    metavar="TIME",
    default="2h",
    show_default=True,
    help="Limit of one job: 90s, 10m, 2h.",
)
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
    print_rows(rows, as_json)


@cli.command()
@selection_options
@click.option("--format", "formats", multiple=True, type=click.Choice(FORMATS), help="Default: markdown; all with -o.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
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
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("results/report"),
    show_default=True,
    metavar="DIR",
)
def report(output: Path, **options: Any) -> None:
    """Write a static HTML page with the tables, and a figure of the canonical forms of each gallery."""
    from benchmark.report.content import contents
    from benchmark.report.files import write
    from benchmark.report.page import page
    from benchmark.report.pictures.forms import forms_figures
    from benchmark.storage.store import Store

    selection = Selection.of(options)
    store = Store.open(selection.results)
    jobs = selection.jobs(store)
    figures = forms_figures(jobs, store, selection.seed, output)
    write({"index.html": page(contents(selection.recorded(store), selection.tables), figures)}, output)
    say(f"wrote {output / 'index.html'} and {len(figures)} figures")


@cli.command()
@click.option("-m", "--method", "method", required=True, metavar="METHOD", help="Method; see 'list methods'.")
@click.argument("source", type=click.Path(path_type=Path), metavar="IN")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="OUT",
    help="Mesh file to write; by default IN-METHOD.off beside IN.",
)
@plugin_option
@click.option("--seed", type=int, default=0, show_default=True)
def canonicalise(method: str, source: Path, output: Path | None, plugins: tuple[Path, ...], seed: int) -> None:
    """Write the canonical form of one mesh."""
    from benchmark.cli.canonicalise import canonicalise_file

    target = output or source.with_name(f"{source.stem}-{method}.off")
    form = canonicalise_file(source, target, method, plugins, seed)
    facts = ", ".join(
        f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in form.notes.items()
    )
    say(f"{target}: {len(form.vertices)} vertices{', ' + facts if facts else ''}")


@cli.command()
@click.argument("target", metavar="METHOD|FILE")
def check(target: str) -> None:
    """Check that a method, or each method of a plugin file, keeps the contract; exit 1 if it does not."""
    from benchmark.methods.conformance import check_target

    report = check_target(target)
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
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal that lacks a character ends no run
    try:
        cli.main(standalone_mode=False)
    except click.UsageError as error:
        error.show()
        sys.exit(USAGE)
    except BenchmarkError as error:
        say(f"error: {error}", err=True)
        sys.exit(USAGE)
    except (click.Abort, KeyboardInterrupt):
        say("interrupted; finished jobs are kept", err=True)
        sys.exit(INTERRUPTED)
