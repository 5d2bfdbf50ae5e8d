"""The verbs of the command line; nothing heavy is imported before a verb needs it, so ``--help`` answers at once."""

from __future__ import annotations

import io
import os
import re
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from benchmark import __version__
from benchmark.cli import completion
from benchmark.cli.compilation import compile_
from benchmark.cli.data import COLUMNS, data, print_rows
from benchmark.cli.options import (
    INTERRUPTED,
    NOT_OK,
    OK,
    USAGE,
    PathOption,
    Selection,
    VertexCount,
    data_root_option,
    name_skipped,
    name_unusable,
    plugin_option,
    results_option,
    selection_options,
    shard_option,
    timeout_option,
)
from benchmark.cli.reporting import FIGURES
from benchmark.cli.results import compare, merge, prune, why
from benchmark.cli.train import train
from benchmark.errors import BenchmarkError, ConfigurationError, one_line
from benchmark.system.text import brief, clean, say, say_lines

if TYPE_CHECKING:
    from benchmark.jobs.cluster.sharding import Shard
    from benchmark.jobs.plan import Job

RETRY = ("failed", "timeout", "crashed", "killed", "memory", "unsupported", "all")
FORMATS = ("latex", "markdown", "csv", "json")

#: How the program is called in what it says.
PROGRAM = "python -m benchmark"

#: Exit code where whoever reads the output goes away, as shells tell of the signal for it.
NOT_LISTENED = 141

#: What is said of an interruption, by verb: what of the work is there when it is taken up again.
KEPT = {
    "run": "interrupted; finished jobs are kept, and of the others the shapes that were done: run again to go on",
    "train": "interrupted; what the method has saved is kept: train again to go on",
}

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
@click.option("--executor", type=click.Choice(["serial", "processes", "dask"]), default="processes", show_default=True)
@click.option("--scheduler", default="", metavar="URL", help="Scheduler of a dask cluster, such as tcp://HOST:8786.")
@timeout_option("one job", "2h")
@click.option("--retry", multiple=True, type=click.Choice(RETRY), help="Run failures of this kind again.")
@shard_option
def run(
    everything: bool,
    jobs: int | None,
    executor: str,
    scheduler: str,
    timeout: float,
    retry: tuple[str, ...],
    shard: Shard | None,
    **options: Any,
) -> None:
    """Run what is missing of a selection, then print its tables."""
    from benchmark.storage.store import Store

    selection = Selection.of(options | {"retry": frozenset(retry), "everything": everything})
    if not everything and not (selection.tables or selection.methods or selection.datasets or selection.plugins):
        raise ConfigurationError("nothing is selected", "pass --all, or choose with -t, -d or -m")
    store = Store.open(selection.results)
    plan = _part(selection.jobs(store), shard)

    # What runs need takes a second to import: a name that is not known is told before.
    from benchmark.cli.terminal import draw
    from benchmark.jobs.run_plan import run_plan
    from benchmark.report.content import contents
    from benchmark.report.formats import markdown
    from benchmark.report.robustness.curves import robustness
    from benchmark.report.robustness.formats import markdown as robustness_markdown

    unnamed = not selection.is_narrow
    ok = run_plan(plan, store, selection, executor, jobs, timeout, scheduler, as_far_as_possible=unnamed)
    galleries = {job.gallery.name for job in plan}
    inputs = {job.input for job in plan}
    results = selection.results_of(store).all(selection.seed, scorer=selection.scorer_spec().name)
    name_skipped(store)
    shown = [r for r in results if r.record["gallery"] in galleries and r.record["input"] in inputs]
    made = contents(shown, {job.gallery.table.identifier for job in plan}, blanks=not selection.is_narrow)
    if sys.stdout.isatty():
        draw(made)
    else:
        for table in made:
            say_lines("\n" + markdown(table))
    for found in robustness(shown):
        say_lines("\n" + robustness_markdown(found))
    sys.exit(OK if ok else NOT_OK)


@cli.command()
@click.option("--all", "everything", is_flag=True, help="All tables, methods and inputs (the default).")
@selection_options
@shard_option
def plan(everything: bool, shard: Shard | None, **options: Any) -> None:
    """Show what a run would do, why, and what it would take."""
    from benchmark.jobs.estimates import estimate
    from benchmark.storage.store import Store
    from benchmark.threads import available_cores

    selection = Selection.of(options | {"everything": everything})
    store = Store.open(selection.results)
    jobs = _part(selection.jobs(store), shard)
    width = max((len(clean(job.name)) for job in jobs), default=0)
    for job in jobs:
        say(f"{job.state:<11}  {clean(job.name):<{width}}  {brief(job.reason)}")
    n_to_run = sum(job.to_run for job in jobs)
    for line in estimate(jobs, store).lines(n_to_run, available_cores()):
        say(line)
    say(f"{n_to_run} of {len(jobs)} jobs to run")


def _part(jobs: list[Job], shard: Shard | None) -> list[Job]:
    """The jobs of a shard, which says which part of which plan it is; all of them without one."""
    if shard is None:
        return jobs
    say(shard.told(jobs))
    return shard.of(jobs)


@cli.command("list")
@click.argument("what", type=click.Choice(["methods", "scorers", "datasets", "tables", "models"]))
@click.option("--json", "as_json", is_flag=True, help="For other programs.")
@plugin_option
@results_option
@data_root_option
def list_(what: str, as_json: bool, plugins: tuple[Path, ...], results: Path, data_root: Path | None) -> None:
    """List what can be named on the command line."""
    from benchmark.cli import listing

    rows = {
        "methods": lambda: listing.methods(plugins),
        "scorers": lambda: listing.scorers(plugins),
        "datasets": lambda: listing.datasets(data_root, plugins),
        "tables": lambda: listing.tables(data_root),
        "models": lambda: listing.models(results),
    }[what]()
    print_rows(rows, as_json, COLUMNS if what == "datasets" else ())
    if what == "methods":
        name_unusable()


@cli.command()
@click.argument("method", metavar="METHOD", shell_complete=completion.methods)
@click.option("--json", "as_json", is_flag=True, help="For other programs.")
@plugin_option
def describe(method: str, as_json: bool, plugins: tuple[Path, ...]) -> None:
    """Tell what a method takes and where it comes from: parameters, source, inputs."""
    import json
    import shutil

    from benchmark.cli.description import facts_of, lines_of
    from benchmark.methods.registry import methods, variant

    facts = facts_of(variant(method, methods(plugins)))
    if as_json:
        click.echo(json.dumps(facts, indent=1))
        return
    for line in lines_of(facts, shutil.get_terminal_size((100, 24)).columns):
        say(line)


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
    from benchmark.report.robustness.curves import robustness
    from benchmark.report.robustness.formats import rendered
    from benchmark.storage.store import Store

    if check and output is None:
        raise ConfigurationError("--check has nothing to compare with", "name the folder of the tables with -o DIR")
    selection = Selection.of(options)
    store = Store.open(selection.results)
    recorded = selection.recorded(store, fresh=fresh)
    content = contents(recorded, selection.tables, blanks=not selection.is_narrow)
    disturbed = robustness(recorded) if "robustness" in selection.tables or not selection.tables else []
    if output is None and not formats and sys.stdout.isatty():
        from benchmark.cli.terminal import draw

        draw(content)
        for text in rendered(disturbed, ("markdown",)).values():
            say_lines(text)
        return
    if output is None:
        for text in (render(content, chosen := formats or ("markdown",)) | rendered(disturbed, chosen)).values():
            say_lines(text)
        return
    files = render(content, formats or FORMATS) | rendered(disturbed, formats or FORMATS)
    if not check:
        from benchmark.report.pictures.curves import draw_curves

        write(files, output)
        draw_curves(disturbed, output)
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
@click.option(
    "--figure", type=PathOption(), metavar="FILE", help="Draw a figure instead, as .pdf, .png or .svg: see --of."
)
@click.option(
    "--of",
    "what",
    type=click.Choice(FIGURES),
    default=FIGURES[0],
    show_default=True,
    help="A subject through all methods; subjects before and after the first method; accuracy against cost.",
)
@click.option("--subject", "subjects", multiple=True, metavar="NAME", help="Of a figure: whom to show.")
@click.option("--shape", "shapes", multiple=True, metavar="NAME", help="Of a figure: in which shapes.")
@timeout_option("the forms of a method that a figure lacks")
def report(
    output: Path,
    figure: Path | None,
    what: str,
    subjects: tuple[str, ...],
    shapes: tuple[str, ...],
    timeout: float,
    **options: Any,
) -> None:
    """Write a static report: tables, charts, canonical forms to turn, and every query with its nearest shapes.

    It opens from its folder without a network. What is not kept in RESULTS is not made: of records alone there are
    tables and scores, and the report says which run brings the rest.
    """
    from benchmark.cli.reporting import write_figure, write_pages

    selection = Selection.of(options)
    if figure is not None:
        write_figure(selection, figure, what, subjects, shapes, timeout)
    else:
        write_pages(selection, output)


@cli.command()
@click.option(
    "-m", "--method", "method", required=True, metavar="METHOD", help="Method; see 'list methods'.",
    shell_complete=completion.methods,
)  # fmt: skip
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
@click.option(
    "--vertices", type=VertexCount(), metavar="N|all", help="Vertices of the form; all: those of the file. [2000]"
)
def canonicalise(
    method: str,
    source: Path,
    output: Path | None,
    plugins: tuple[Path, ...],
    timeout: float,
    seed: int,
    vertices: int | str | None,
) -> None:
    """Write the canonical form of one mesh."""
    from benchmark.cli.canonicalise import canonicalise_file

    target = output or source.with_name(f"{source.stem}-{re.sub(_NOT_IN_NAMES, '_', method)}.off")
    form = canonicalise_file(source, target, method, plugins, seed, timeout, vertices)
    facts = ", ".join(
        f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in form.notes.items()
    )
    say(f"{target}: {len(form.vertices)} vertices{', ' + facts if facts else ''}")


@cli.command()
@click.argument("target", metavar="METHOD|FILE", shell_complete=completion.methods_or_files)
@click.option("-m", "--method", "chosen", multiple=True, metavar="METHOD", help="Of a file, check this method alone.")
@click.option("-o", "--option", "options", multiple=True, metavar="NAME=VALUE", help="How to train a learner for it.")
@plugin_option
@timeout_option("one check")
def check(
    target: str, chosen: tuple[str, ...], options: tuple[str, ...], plugins: tuple[Path, ...], timeout: float
) -> None:
    """Check that a method, or all that a plugin file brings, keeps the contract; exit 1 if it does not.

    Parameters are written behind either: FILE[power=1].
    """
    from benchmark.methods.conformance import Target, check_apart
    from benchmark.parameters.values import assignments

    named = Target(target, chosen, tuple(map(str, plugins)), tuple(assignments(options).items()))
    report = check_apart(named, timeout)
    say_lines(str(report))
    sys.exit(OK if report else NOT_OK)


@cli.group()
def new() -> None:
    """Write files to start from."""


def _add_new(kind: str, what: str) -> None:
    """Add the command that writes a plugin of one kind."""

    @new.command(kind, help=f"Write a working plugin file with {what} called NAME, and its test, into this folder.")
    @click.argument("name")
    def write(name: str) -> None:
        from benchmark.methods.scaffold import new_plugin

        plugin, *others = new_plugin(kind, name)
        for path in (plugin, *others):
            say(path)
        say(f"next: edit it, then 'python -m benchmark check {plugin}'", err=True)


for _kind, _what in {
    "method": "a method that makes canonical forms",
    "descriptor": "a descriptor that compares shapes without a form",
    "learner": "a method that is trained",
    "scorer": "a scorer that compares forms",
    "dataset": "a data set",
}.items():
    _add_new(_kind, _what)


@cli.command("completion")
@click.argument("shell", type=click.Choice(completion.SHELLS))
def completion_(shell: str) -> None:
    """Print what a shell has to read to complete names: eval "$(canonical-forms completion bash)"."""
    click.echo(completion.script(cli, shell))


for verb in (data, train, merge, compare, prune, why, compile_):
    cli.add_command(verb)


def program() -> None:
    """Run the command line as a program of its own; threads and exit handlers of a plugin have no say in its end."""
    from benchmark.system import warden

    try:
        main()
    finally:
        if warden.MARK in os.environ:
            code = _exit_code(sys.exception())
            for stream in (sys.stdout, sys.stderr):
                with suppress(OSError, ValueError):
                    stream.flush()
            os._exit(code)


def _exit_code(error: BaseException | None) -> int:
    """The code by which a program ends with an exception, which is shown if nobody expected it."""
    if error is None or (isinstance(error, SystemExit) and error.code is None):
        return OK
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else NOT_OK
    sys.excepthook(type(error), error, error.__traceback__)
    return NOT_OK


def main() -> None:
    """Run the command line; problems that the user can mend are one line and exit code 2."""
    from benchmark.threads import pin_threads

    pin_threads()
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
    except (click.Abort, KeyboardInterrupt):
        _refuse(KEPT.get(verb, "interrupted"), INTERRUPTED)
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
