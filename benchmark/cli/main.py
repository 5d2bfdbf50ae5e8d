"""The verbs of the command line; nothing heavy is imported before a verb needs it, so ``--help`` answers at once."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from benchmark import __version__
from benchmark.cli.data import DATA_VARIABLE, data, data_root_option, print_rows
from benchmark.cli.train import train
from benchmark.errors import BenchmarkError, ConfigurationError

if TYPE_CHECKING:
    from benchmark.jobs.plan import Job
    from benchmark.storage.store import Store

OK, NOT_OK, USAGE, INTERRUPTED = 0, 1, 2, 130

RETRY = ("failed", "timeout", "crashed", "memory", "unsupported", "all")
FORMATS = ("latex", "markdown", "csv", "json")
_UNITS = {"": 1, "s": 1, "m": 60, "h": 3600}


@dataclass(frozen=True)
class Selection:
    """What the options of ``run``, ``plan`` and ``tables`` select."""

    tables: tuple[str, ...]
    methods: tuple[str, ...]
    datasets: tuple[str, ...]
    inputs: tuple[str, ...]
    plugins: tuple[Path, ...]
    results: Path
    data_root: Path | None
    seed: int
    quick: bool
    retry: frozenset[str] = frozenset()

    def jobs(self, store: Store) -> list[Job]:
        """Plan the selection."""
        from benchmark.jobs.plan import make_plan
        from benchmark.methods.registry import methods, select
        from benchmark.protocols.tables import INPUTS, galleries

        specs = select(self.methods, methods(self.plugins), self.plugins)
        chosen = galleries(self.tables, self.datasets, self.data_root, self.quick)
        inputs = [input_ for input_ in INPUTS if not self.inputs or input_ in self.inputs]
        jobs = make_plan(chosen, inputs, specs, store, self.seed, self.retry)
        if not jobs:
            raise ConfigurationError("no selected method belongs to a selected table", "drop -m, -t or --input")
        return jobs


class Duration(click.ParamType[float]):
    """Seconds, written as ``90``, ``90s``, ``10m`` or ``2h``."""

    name = "duration"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Parse a duration."""
        if isinstance(value, (int, float)):
            return float(value)
        match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", str(value).strip())
        if not match or float(match[1]) == 0:
            self.fail(f"'{value}' is not a duration; write 90s, 10m or 2h", param, ctx)
        return float(match[1]) * _UNITS[match[2]]


def _selection_options(command: Callable[..., Any]) -> Callable[..., Any]:
    folder, file = click.Path(path_type=Path), click.Path(path_type=Path)
    options = [
        click.option(
            "-t", "--table", "tables", multiple=True, metavar="TABLE", help="Table of the paper: I, II, III, IV."
        ),
        click.option("-m", "--method", "methods", multiple=True, metavar="METHOD", help="See 'list methods'; or all."),
        click.option("-d", "--dataset", "datasets", multiple=True, metavar="DATASET|FOLDER", help="Set or folder."),
        click.option("--input", "inputs", multiple=True, type=click.Choice(["view", "mesh"]), help="Default: both."),
        click.option("--plugin", "plugins", multiple=True, type=file, metavar="FILE", help="Python file with methods."),
        click.option("--results", type=folder, default=Path("results"), show_default=True, metavar="DIR"),
        data_root_option,
        click.option("--seed", type=int, default=0, show_default=True, help="Base seed of all methods."),
        click.option("--quick", is_flag=True, help="Fewer poses of each subject."),
    ]
    for option in reversed(options):
        command = option(command)
    return command


def _select(options: dict[str, Any]) -> Selection:
    root = options["data_root"]
    if root is not None and not root.is_dir():
        raise ConfigurationError(
            f"data root {root} is not a readable folder", f"correct --data-root or {DATA_VARIABLE}"
        )
    return Selection(**{name: options[name] for name in Selection.__dataclass_fields__ if name in options})


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="benchmark")
def cli() -> None:
    """Canonical forms for non-rigid 3D shape retrieval: run methods, score them, regenerate the tables."""


@cli.command()
@click.option("--all", "everything", is_flag=True, help="All tables, methods and inputs.")
@_selection_options
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
    import os

    from benchmark.jobs.run_plan import run_plan
    from benchmark.report.content import contents
    from benchmark.report.formats import markdown
    from benchmark.storage.store import Store

    selection = _select(options | {"retry": frozenset(retry)})
    if not everything and not (selection.tables or selection.methods or selection.datasets or selection.plugins):
        raise ConfigurationError("nothing is selected", "pass --all, or choose with -t, -d or -m")
    store = Store.open(selection.results)
    plan = selection.jobs(store)
    workers = jobs or len(os.sched_getaffinity(0))
    ok = run_plan(plan, store, selection, executor, workers, timeout)
    for table in contents(plan, store):
        click.echo("\n" + markdown(table), nl=False)
    sys.exit(OK if ok else NOT_OK)


@cli.command()
@click.option("--all", "everything", is_flag=True, help="All tables, methods and inputs (the default).")
@_selection_options
def plan(everything: bool, **options: Any) -> None:
    """Show what a run would do, and why."""
    from benchmark.storage.store import Store

    selection = _select(options)
    jobs = selection.jobs(Store.open(selection.results))
    width = max(len(job.name) for job in jobs)
    for job in jobs:
        click.echo(f"{job.state:<11}  {job.name:<{width}}  {job.reason}")
    click.echo(f"{sum(job.to_run for job in jobs)} of {len(jobs)} jobs to run")


@cli.command("list")
@click.argument("what", type=click.Choice(["methods", "datasets", "tables", "models"]))
@click.option("--json", "as_json", is_flag=True, help="For other programs.")
@click.option("--plugin", "plugins", multiple=True, type=click.Path(path_type=Path), metavar="FILE")
@click.option("--results", type=click.Path(path_type=Path), default=Path("results"), show_default=True, metavar="DIR")
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
@_selection_options
@click.option("--format", "formats", multiple=True, type=click.Choice(FORMATS), help="Default: markdown; all with -o.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Write files instead of printing.",
)
@click.option("--check", is_flag=True, help="Compare with the files in -o DIR; exit 1 if they differ.")
def tables(formats: tuple[str, ...], output: Path | None, check: bool, **options: Any) -> None:
    """Make the tables anew from the records of finished jobs; nothing is computed."""
    from benchmark.report.content import contents
    from benchmark.report.files import render, stale, write
    from benchmark.storage.store import Store

    if check and output is None:
        raise ConfigurationError("--check has nothing to compare with", "name the folder of the tables with -o DIR")
    selection = _select(options)
    store = Store.open(selection.results)
    content = contents(selection.jobs(store), store)
    if output is None:
        for text in render(content, formats or ("markdown",)).values():
            click.echo(text, nl=False)
        return
    files = render(content, formats or FORMATS)
    if not check:
        write(files, output)
        click.echo(f"wrote {', '.join(files)} to {output}")
        return
    different = stale(files, output)
    click.echo(f"stale: {', '.join(different)}" if different else f"{len(files)} files are up to date")
    sys.exit(NOT_OK if different else OK)


@cli.command()
@_selection_options
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
    from benchmark.report.figures import forms_figures
    from benchmark.report.files import write
    from benchmark.report.page import page
    from benchmark.storage.store import Store

    selection = _select(options)
    store = Store.open(selection.results)
    jobs = selection.jobs(store)
    figures = forms_figures(jobs, store, selection.seed, output)
    write({"index.html": page(contents(jobs, store), figures)}, output)
    click.echo(f"wrote {output / 'index.html'} and {len(figures)} figures")


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
@click.option("--plugin", "plugins", multiple=True, type=click.Path(path_type=Path), metavar="FILE")
@click.option("--seed", type=int, default=0, show_default=True)
def canonicalise(method: str, source: Path, output: Path | None, plugins: tuple[Path, ...], seed: int) -> None:
    """Write the canonical form of one mesh."""
    from benchmark.cli.canonicalise import canonicalise_file

    target = output or source.with_name(f"{source.stem}-{method}.off")
    form = canonicalise_file(source, target, method, plugins, seed)
    facts = ", ".join(
        f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in form.notes.items()
    )
    click.echo(f"{target}: {len(form.vertices)} vertices{', ' + facts if facts else ''}")


@cli.command()
@click.argument("target", metavar="METHOD|FILE")
def check(target: str) -> None:
    """Check that a method, or each method of a plugin file, keeps the contract; exit 1 if it does not."""
    from benchmark.methods.conformance import check_target

    report = check_target(target)
    click.echo(str(report))
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
        click.echo(path)


cli.add_command(data)
cli.add_command(train)


def main() -> None:
    """Run the command line; problems that the user can mend are one line and exit code 2."""
    from benchmark.threads import pin_threads

    pin_threads()
    try:
        cli.main(standalone_mode=False)
    except click.UsageError as error:
        error.show()
        sys.exit(USAGE)
    except BenchmarkError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(USAGE)
    except (click.Abort, KeyboardInterrupt):
        click.echo("interrupted; finished jobs are kept", err=True)
        sys.exit(INTERRUPTED)
