"""Output of ``report``: pages, or one figure."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from benchmark.cli.options import RunOptions
from benchmark.errors import ConfigurationError
from benchmark.text import say

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from benchmark.report.artefact_reader import ArtefactReader
    from benchmark.report.content import TableContent

#: Kinds of figures.
FIGURES = ("forms", "effect", "cost", "precision-recall", "confusion", "classes")


def write_pages(selection: RunOptions, output: Path, *, force: bool = False) -> None:
    """Write the static report of a selection; with force, over what is of no report, too."""
    from benchmark.bundles.board import boards
    from benchmark.report.html.pages import write_report

    tables, artefacts = _recorded(selection)
    options = [word for plugin in selection.plugins for word in ("--plugin", str(plugin))]
    options += ["--data-root", str(selection.data_root)] if selection.data_root else []
    options += ["--results", str(selection.results)] if selection.results != RunOptions().results else []
    command = shlex.join(["python", "-m", "benchmark", *sys.argv[1:]])
    written = write_report(
        tables, artefacts, output, command, lambda line: say(line, err=True), boards(selection.results),
        options=options, force=force,
    )  # fmt: skip
    name_edited(output, written.edited)
    say(
        f"wrote {output / 'index.html'}: {written.size / 2**20:.1f} MiB in {written.n_files} files, "
        f"{written.n_forms} forms, distances of {written.n_distances} of {written.n_ranked} jobs"
    )


def _recorded(selection: RunOptions) -> tuple[list[TableContent], ArtefactReader]:
    """Tables of a selection, and the arrays behind them."""
    from benchmark.plugins.registry import methods
    from benchmark.report.artefact_reader import ArtefactReader
    from benchmark.report.content import contents

    store = selection.store()
    blanks, named = not selection.is_narrow, selection.is_by_name
    tables = contents(selection.recorded(store), selection.tables, blanks=blanks, named=named)
    if not tables:
        raise no_table(selection)
    return tables, ArtefactReader(store, methods(selection.plugins), selection.data_root)


def write_figure(
    selection: RunOptions,
    path: Path,
    what: str,
    subjects: tuple[str, ...],
    shapes: tuple[str, ...],
    timeout: float,
    *,
    force: bool = False,
) -> None:
    """Draw one figure of a selection; the forms that it lacks are made in a process of their own."""
    from benchmark.report.pictures.painting import ENDINGS, SIGNATURE, save

    if path.suffix.lower() not in ENDINGS:
        raise ConfigurationError(f"{path} is not the name of a figure", f"use {', '.join(ENDINGS)}")
    if path.is_file() and not force and SIGNATURE.encode() not in path.read_bytes():
        raise ConfigurationError(f"{path} was not drawn by 'report'", "choose another file, or pass --force")
    if what in ("forms", "effect"):
        save(_forms_figure(selection, what, subjects, shapes, timeout), path)
    else:
        save(_chart(selection, what), path)
    say(f"wrote {path}")


def _forms_figure(
    selection: RunOptions, what: str, subjects: tuple[str, ...], shapes: tuple[str, ...], timeout: float
) -> Figure:
    from benchmark.pipeline.storage.store import Store
    from benchmark.report.pictures.forms import effect_figure, forms_figure

    store = Store.open(selection.results)
    planned = selection.jobs(store)
    first = planned[0]
    jobs = [job for job in planned if (job.gallery, job.input) == (first.gallery, first.input)]
    if not selection.methods:  # those of the paper; the others would not fit
        jobs = [job for job in jobs if job.method.info.family == "paper" and not job.method.parameters]
        jobs = [job for job in jobs if job.state not in ("unavailable", "unsupported")]
        if not jobs:
            raise ConfigurationError("no method of the paper has a form here", "name methods with -m")
    if what == "forms":
        return forms_figure(jobs, store, subjects[0] if subjects else "", shapes, timeout)
    return effect_figure(jobs, store, subjects, shapes, timeout)


def _chart(selection: RunOptions, what: str) -> Figure:
    from benchmark.report.pictures.charts import (
        classes_figure,
        confusion_figure,
        cost_figure,
        precision_recall_figure,
    )

    (table, *others), artefacts = _recorded(selection)
    if others:
        say(f"only table {table.identifier} is drawn of {len(others) + 1}; choose with -t and -d", err=True)
    if what == "cost":
        return cost_figure(table)
    draw = {"precision-recall": precision_recall_figure, "confusion": confusion_figure, "classes": classes_figure}
    return draw[what](table, artefacts)


def name_edited(folder: Path, names: Iterable[str]) -> None:
    """Tell on stderr which files of a folder were left as somebody has edited them."""
    for name in names:
        say(f"kept {folder / name}, which was edited; --force overwrites it", err=True)


def no_table(selection: RunOptions) -> ConfigurationError:
    """Return what is said where no finished job belongs to a table."""
    return ConfigurationError(
        f"no finished job under {selection.results} belongs to table {', '.join(selection.tables) or 'of any name'}",
        "run it first, or select less",
    )
