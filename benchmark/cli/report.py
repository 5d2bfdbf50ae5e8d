"""``report``: write HTML pages and figures."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from benchmark.cli.options import Selection
from benchmark.cli.plan import planned_jobs
from benchmark.cli.selection import recorded_tables, stored
from benchmark.errors import ConfigurationError
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import methods
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import TableContent
from benchmark.report.html.pages import write_report
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


def draw(
    options: Selection, figure: Path, what: str, subjects: Sequence[str], shapes: Sequence[str], timeout: float, *,
    force: bool,
) -> None:  # fmt: skip
    """Draw a figure."""
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


def _tables(options: Selection) -> tuple[list[TableContent], ArtefactReader]:
    """Return the tables of a selection, and a reader of their arrays."""
    store = stored(options)
    return recorded_tables(options, store), ArtefactReader(store, methods(options.plugins), options.data_root)


def write_pages(options: Selection, output: Path, *, force: bool) -> None:
    """Write the pages."""
    tables, artefacts = _tables(options)
    places = [word for plugin in options.plugins for word in ("--plugin", str(plugin))]
    places += ["--data-root", str(options.data_root)] if options.data_root else []
    places += ["--results", str(options.results)] if options.results != Selection().results else []
    command = shlex.join(["python", "-m", "benchmark", *sys.argv[1:]])
    written = write_report(
        tables, artefacts, output, command, lambda line: say(line, err=True),
        options=places, force=force,
    )  # fmt: skip
    _name_edited(output, written.edited)
    say(
        f"wrote {output / 'index.html'}: {written.size / 2**20:.1f} MiB in {written.n_files} files, "
        f"{written.n_forms} forms, distances of {written.n_distances} of {written.n_ranked} jobs"
    )


def _forms_figure(
    options: Selection, what: str, subjects: Sequence[str], shapes: Sequence[str], timeout: float
) -> Figure:
    """Draw forms of the first selected gallery and input; without -m, those of the paper's methods."""
    store = Store.open(options.results)
    planned = planned_jobs(options, store)
    first = planned[0]
    jobs = [job for job in planned if (job.gallery, job.input) == (first.gallery, first.input)]
    if not options.methods:  # more would not fit
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
