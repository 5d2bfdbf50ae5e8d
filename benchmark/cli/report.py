"""``report`` and ``paper``: results as pages, as a figure, and as a LaTeX document."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable
from pathlib import Path

import click
from matplotlib.figure import Figure

from benchmark.bundles.outcomes import boards
from benchmark.cli.declare import PATH, option, timeout_option
from benchmark.cli.options import SELECTION, RunOptions, shared, verb
from benchmark.cli.plan import planned_jobs
from benchmark.cli.selection import recorded_tables, stored
from benchmark.errors import ConfigurationError
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import methods
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import TableContent
from benchmark.report.html.pages import write_report
from benchmark.report.output import Folder
from benchmark.report.paper.document import Template, main_tables, paper_files
from benchmark.report.pictures.charts import classes_figure, confusion_figure, cost_figure, precision_recall_figure
from benchmark.report.pictures.forms import effect_figure, forms_figure
from benchmark.report.pictures.painting import ENDINGS, SIGNATURE, save
from benchmark.text import say

#: Kinds of figures: of forms, and of scores.
_OF_FORMS = ("forms", "effect")
_CHARTS = {
    "cost": lambda table, _: cost_figure(table),
    "precision-recall": precision_recall_figure,
    "confusion": confusion_figure,
    "classes": classes_figure,
}


@verb
def report(
    options: RunOptions = shared(*SELECTION),
    output: Path = option("-o", "--output", type=PATH, default=Path("results/report"), metavar="DIR"),
    force: bool = shared("force"),
    published: bool = shared("published"),
    figure: Path | None = option(
        "--figure", type=PATH, metavar="FILE", help="Draw a figure (.pdf, .png or .svg) instead; see --of."
    ),
    what: str = option(
        "--of", type=click.Choice([*_OF_FORMS, *_CHARTS]), default=_OF_FORMS[0],
        help="One subject by all methods; subjects before and after one method; accuracy against cost; precision over"
        " recall; nearest matches by class; scores by class.",
    ),
    subjects: tuple[str, ...] = option(
        "--subject", multiple=True, metavar="NAME", help="Subject to show in a figure."
    ),
    shapes: tuple[str, ...] = option("--shape", multiple=True, metavar="NAME", help="Shape to show in a figure."),
    timeout: float = timeout_option("missing forms of a method"),
) -> None:  # fmt: skip
    """Write HTML pages: tables, charts, canonical forms in 3D, and every query with its nearest shapes.

    They work without a network. Nothing is computed; where data is missing, a page names the run that creates it.
    """
    if figure is None:
        _write_pages(options, output)
        return
    if figure.suffix.lower() not in ENDINGS:
        raise ConfigurationError(f"{figure} is not the name of a figure", f"use {', '.join(ENDINGS)}")
    if figure.is_file() and not force and SIGNATURE.encode() not in figure.read_bytes():
        raise ConfigurationError(f"{figure} was not drawn by 'report'", "choose another file, or pass --force")
    if what in _OF_FORMS:
        save(_forms_figure(options, what, subjects, shapes, timeout), figure)
    else:
        (table, *others), artefacts = _tables(options)
        if others:
            say(f"drew only table {table.identifier}, the first of {len(others) + 1}; choose with -t and -d", err=True)
        save(_CHARTS[what](table, artefacts), figure)
    say(f"wrote {figure}")


def _tables(options: RunOptions) -> tuple[list[TableContent], ArtefactReader]:
    """Tables of a selection, and the arrays behind them."""
    store = stored(options)
    return recorded_tables(options, store), ArtefactReader(store, methods(options.plugins), options.data_root)


def _write_pages(options: RunOptions, output: Path) -> None:
    tables, artefacts = _tables(options)
    places = [word for plugin in options.plugins for word in ("--plugin", str(plugin))]
    places += ["--data-root", str(options.data_root)] if options.data_root else []
    places += ["--results", str(options.results)] if options.results != RunOptions().results else []
    command = shlex.join(["python", "-m", "benchmark", *sys.argv[1:]])
    written = write_report(
        tables, artefacts, output, command, lambda line: say(line, err=True), boards(options.results),
        options=places, force=options.force,
    )  # fmt: skip
    _name_edited(output, written.edited)
    say(
        f"wrote {output / 'index.html'}: {written.size / 2**20:.1f} MiB in {written.n_files} files, "
        f"{written.n_forms} forms, distances of {written.n_distances} of {written.n_ranked} jobs"
    )


def _forms_figure(
    options: RunOptions, what: str, subjects: tuple[str, ...], shapes: tuple[str, ...], timeout: float
) -> Figure:
    """Draw forms of the first gallery and input of the selection; without -m, by the methods of the paper."""
    store = Store.open(options.results)
    planned = planned_jobs(options, store)
    first = planned[0]
    jobs = [job for job in planned if (job.gallery, job.input) == (first.gallery, first.input)]
    if not options.methods:  # others would not fit
        jobs = [job for job in jobs if job.method.info.family == "paper" and not job.method.parameters]
        jobs = [job for job in jobs if job.state not in ("unavailable", "unsupported")]
    if not jobs:
        raise ConfigurationError("no method of the paper has a form here", "name methods with -m")
    artefacts = ArtefactReader(store, methods(options.plugins), options.data_root)
    if what == "effect":
        return effect_figure(jobs, artefacts, subjects, shapes, timeout)
    return forms_figure(jobs, artefacts, subjects[0] if subjects else "", shapes, timeout)


def _name_edited(folder: Path, names: Iterable[str]) -> None:
    for name in names:
        say(f"kept {folder / name}, which was edited; --force overwrites it", err=True)


@verb
def paper(
    options: RunOptions = shared(*SELECTION),
    output: Path = option("-o", "--output", type=PATH, default=Path("results/paper"), metavar="DIR"),
    template: Template = option(
        "--template", type=click.Choice(["article", "ieee"]), default="article", help="LaTeX class."
    ),
    force: bool = shared("force"),
    published: bool = shared("published"),
) -> None:
    """Write a LaTeX paper of results: protocol, tables, figures, statistics, sources; compile it by 'make' in DIR.

    Without -t and -d it contains Tables I to IV and those of your own data. Files that you edited are kept.
    """
    tables, artefacts = _tables(options)
    tables = [table for table in tables if any(line.scores for line in table.lines)]
    if not tables:
        raise ConfigurationError("no finished job of the selection has scores", "run it first, or select less")
    if not (options.tables or options.datasets):
        tables = main_tables(tables)
    files = paper_files(tables, artefacts, template)
    _name_edited(output, Folder(output, "paper", "written-by-paper.json", force).write(files))
    say(f"wrote {len(files)} files to {output}; compile them: make -C {shlex.quote(str(output))}")
    if "figures/forms.pdf" not in files:
        figure = shlex.quote(str(output / "figures" / "forms.pdf"))
        say(f"no forms are stored here; draw some with report -d DATASET --figure {figure}")
