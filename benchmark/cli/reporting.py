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

#: Kinds of figures.
FIGURES = ("forms", "effect", "cost")


def write_pages(selection: RunOptions, output: Path, *, force: bool = False) -> None:
    """Write the static report of a selection; with force, over what is of no report, too."""
    from benchmark.bundles.board import boards
    from benchmark.plugins.registry import methods
    from benchmark.report.artefact_reader import ArtefactReader
    from benchmark.report.content import contents
    from benchmark.report.html.site import write_report

    store = selection.store()
    named = selection.is_by_name
    tables = contents(selection.recorded(store), selection.tables, blanks=not selection.is_narrow, named=named)
    if not tables:
        raise no_table(selection)
    artefacts = ArtefactReader(store, methods(selection.plugins), selection.data_root)
    command = shlex.join(["python", "-m", "benchmark", *sys.argv[1:]])
    written = write_report(
        tables, artefacts, output, command, lambda line: say(line, err=True), boards(selection.results), force=force
    )
    name_edited(output, written.edited)
    say(
        f"wrote {output / 'index.html'}: {written.size / 2**20:.1f} MiB in {written.n_files} files, "
        f"{written.n_forms} forms, distances of {written.n_distances} of {written.n_ranked} jobs"
    )


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
    from benchmark.report.pictures.forms import ENDINGS, SIGNATURE, effect_figure, forms_figure, save

    if path.suffix.lower() not in ENDINGS:
        raise ConfigurationError(f"{path} is not the name of a figure", f"use {', '.join(ENDINGS)}")
    if path.is_file() and not force and SIGNATURE.encode() not in path.read_bytes():
        raise ConfigurationError(f"{path} was not drawn by 'report'", "choose another file, or pass --force")
    if what == "cost":
        save(_cost_figure(selection), path)
    else:
        from benchmark.pipeline.storage.store import Store

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
            figure = forms_figure(jobs, store, subjects[0] if subjects else "", shapes, timeout)
        else:
            figure = effect_figure(jobs, store, subjects, shapes, timeout)
        save(figure, path)
    say(f"wrote {path}")


def _cost_figure(selection: RunOptions) -> Figure:
    from benchmark.report.content import contents
    from benchmark.report.pictures.cost import cost_figure

    store = selection.store()
    tables = contents(selection.recorded(store), selection.tables)
    if not tables:
        raise no_table(selection)
    if len(tables) > 1:
        say(f"only table {tables[0].identifier} is drawn of {len(tables)}; choose with -t and -d", err=True)
    return cost_figure(tables[0])


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
