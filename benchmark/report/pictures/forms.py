"""Figures of forms for papers and pages: what methods make of a few shapes."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmark.api.contracts import Input, Method
from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import BenchmarkError, ConfigurationError, ShapeError, did_you_mean
from benchmark.execution.job_specs import Job, to_json
from benchmark.execution.processes.calls import Guard, call_apart
from benchmark.execution.runner import make_forms
from benchmark.geometry.mesh import Mesh, Points
from benchmark.pipeline.method_run import MethodRun
from benchmark.pipeline.preparation import Preparation
from benchmark.pipeline.storage.store import Store
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import TableContent
from benchmark.report.pictures.painting import outwardness, painted
from benchmark.report.pictures.posing import centred, have_same_poses, reach, spread, upright
from benchmark.report.significance import CONTROL
from benchmark.text import clean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Shapes of a subject that a figure shows.
POSES = 3

#: Inches of a figure, the text of a two-column paper; of the widest column; of a picture of an effect.
WIDTH, _COLUMN, _SIDE = 7.16, 1.25, 1.5

#: Methods whose stored forms have room beside each other.
_MOST = 8

#: Pixels per side of a picture.
_PIXELS = 280

#: Height of the titles in inches.
_TITLES = 0.28

#: Width of a picture beyond what the largest form of its row takes.
_MARGIN = 1.03


@dataclass
class Column:
    """Title of a method, and its forms of some shapes, turned for the eye; or why there is none."""

    title: str
    meshes: Sequence[Mesh | str]

    def draw(self, place: Any, number: int) -> None:
        """Draw one of the forms, or the reason why there is none, into its axes."""
        mesh = self.meshes[number]
        if isinstance(mesh, str):
            place.set_aspect("equal")
            reason = "\n".join(textwrap.wrap(clean(mesh), 22, max_lines=7, placeholder=" ..."))
            place.text(0.5, 0.5, reason, transform=place.transAxes, fontsize=4, color="0.4", **_CENTRED)
            return
        half = _MARGIN * max(reach(other.vertices) for other in self.meshes if isinstance(other, Mesh))
        picture = painted(mesh.vertices, mesh.faces, outwardness(mesh), _PIXELS, half)
        place.imshow(np.asarray(picture), interpolation="antialiased")


_CENTRED: dict[str, Any] = {"ha": "center", "va": "center", "parse_math": False}


def forms_figure(
    jobs: Sequence[Job], store: Store, subject: str = "", shapes: Sequence[str] = (), limit: float | None = None
) -> Figure:
    """Draw one subject in a few poses, and beside each the forms of all methods; as wide as a page.

    Parameters
    ----------
    jobs
        Jobs of one gallery under one input. Forms are taken from the store, and missing ones are made in a process of
        their own, but not those of a job that has failed.
    store
        Where the forms are.
    subject
        Which subject to show; the first one by default.
    shapes
        Which shapes to show, in place of some poses of a subject.
    limit
        Seconds that making the missing forms of one method may take; None for no limit.

    Raises
    ------
    ConfigurationError
        If there is no such subject or shape, or none of the methods makes forms.
    """
    dataset, entries = _shapes_of(jobs[0])
    return _drawn(_columns(jobs, dataset, store, _chosen(jobs[0].gallery, entries, subject, shapes), limit))


def effect_figure(
    jobs: Sequence[Job],
    store: Store,
    subjects: Sequence[str] = (),
    shapes: Sequence[str] = (),
    limit: float | None = None,
) -> Figure:
    """Draw some subjects in a few poses on the left, and on the right what the first method makes of them.

    Parameters
    ----------
    jobs, store, limit
        As of :func:`forms_figure`.
    subjects
        Which subjects to show, one in each row; those of the shapes, or the first two, by default.
    shapes
        Which shapes to show of them, in place of some poses of each.
    """
    gallery, (dataset, entries) = jobs[0].gallery, _shapes_of(jobs[0])
    named = _chosen(gallery, entries, "", shapes) if shapes else []
    subjects = subjects or list(dict.fromkeys(entry.subject for entry in named or entries))[: None if shapes else 2]
    rows = []
    for subject in subjects:
        own = [entry.identifier for entry in named if entry.subject == subject]
        rows.append(_columns(jobs[:1], dataset, store, _chosen(gallery, entries, subject, own), limit))
    n_poses = max(len(row[0].meshes) for row in rows)
    widths = [1] * n_poses + [0.7] + [1] * n_poses
    figure, axes = _grid(_SIDE * sum(widths), _SIDE * len(rows) + 0.35, len(rows), widths, 0.9)
    for line, row in zip(axes, rows, strict=True):
        for start, column in zip((0, n_poses + 1), row, strict=True):
            for number in range(len(column.meshes)):
                column.draw(line[start + number], number)
        line[n_poses].annotate(
            "", (0.85, 0.5), (0.15, 0.5), xycoords="axes fraction", textcoords="axes fraction",
            arrowprops={"arrowstyle": "-|>", "lw": 2.2, "color": "0.45", "mutation_scale": 18},
        )  # fmt: skip
    middle = n_poses / sum(widths) / 2
    title = f"Their canonical forms, by {clean(jobs[0].method.info.title)}"
    shown = "The same bodies in different poses" if have_same_poses(entries) else "Shapes of the same class"
    for place, text in ((middle, shown), (1 - middle, title)):
        figure.text(place, 0.955, text, fontsize=12, color="0.25", **_CENTRED)
    return figure


def stored_forms_figure(table: TableContent, artefacts: ArtefactReader) -> Figure | None:
    """Draw the first subject of a table in a few poses, and the stored forms of its methods; None without any."""
    for input_ in table.inputs:
        columns = _stored_columns(table, input_, artefacts)
        if len(columns) > 1:
            return _drawn(columns[: _MOST + 1], min(WIDTH, _COLUMN * min(len(columns), _MOST + 1)))
    return None


def _stored_columns(table: TableContent, input_: Input, artefacts: ArtefactReader) -> list[Column]:
    columns: list[Column] = []
    for row in table.rows:
        cell = row.cells.get(input_)
        if cell is None or not cell.records or row.family == CONTROL:
            continue
        record = dict(cell.records[0])
        try:
            shapes = [entry for entry in artefacts.dataset(record).entries if entry.identifier in record["shapes"]]
        except BenchmarkError:
            return []
        entries = _chosen("", shapes, "", ())
        surfaces = [mesh for entry in entries if (mesh := artefacts.surface(record, entry)) is not None]
        if len(surfaces) == len(entries):
            seen = [artefacts.seen(record, entry, mesh) for entry, mesh in zip(entries, surfaces, strict=True)]
            column = _turned(row.title, [artefacts.form(record, entry) for entry in entries], surfaces, seen)
            columns = columns or [_turned("input", surfaces, surfaces, seen)]
            columns += [column] if any(isinstance(form, Mesh) for form in column.meshes) else []
    return columns


def _drawn(columns: Sequence[Column], width: float = WIDTH) -> Figure:
    """Draw a column for the shapes and for each method, together of a width in inches."""
    n_rows, side = len(columns[0].meshes), width / len(columns)
    height = side * n_rows + _TITLES
    figure, axes = _grid(width, height, n_rows, [1] * len(columns), 1 - _TITLES / height, max(300, _PIXELS / side))
    for number, line in enumerate(axes):
        for place, column in zip(line, columns, strict=True):
            column.draw(place, number)
    for place, column in zip(axes[0], columns, strict=True):
        title = textwrap.fill(clean(column.title), 14, max_lines=2, placeholder=" ...")
        place.text(0.5, 1.03, title, transform=place.transAxes, fontsize=6.5, **_CENTRED | {"va": "bottom"})
    return figure


def _grid(
    width: float, height: float, n_rows: int, widths: Sequence[float], top: float, dpi: float = _PIXELS / 2
) -> tuple[Figure, Any]:
    """A figure of so many inches, and its axes without frames or gaps, up to a share of the height."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi)
    edges = {"wspace": 0, "hspace": 0, "left": 0, "right": 1, "bottom": 0, "top": top}
    axes = figure.subplots(n_rows, len(widths), squeeze=False, gridspec_kw={"width_ratios": widths, **edges})
    for place in axes.flat:
        place.set_axis_off()
    return figure, axes


def _shapes_of(job: Job) -> tuple[Dataset, list[Entry]]:
    dataset = open_dataset(job.dataset, job.data_root)
    entries = {entry.identifier: entry for entry in dataset.entries}
    return dataset, [entries[identifier] for identifier in job.identifiers]


def _chosen(gallery: str, entries: Sequence[Entry], subject: str, shapes: Sequence[str]) -> list[Entry]:
    """The named shapes, else some of a subject, else of the first one."""
    if shapes:
        known = {entry.identifier: entry for entry in entries}
        unknown = next((name for name in shapes if name not in known), None)
        if unknown is not None:
            raise did_you_mean(f"shape of {gallery}", unknown, known)
        return [known[name] for name in shapes]
    name = subject or entries[0].subject
    chosen = spread([entry for entry in entries if entry.subject == name], POSES)
    if not chosen:
        raise did_you_mean(f"subject of {gallery}", name, {entry.subject for entry in entries})
    return chosen


def _columns(
    jobs: Sequence[Job], dataset: Dataset, store: Store, entries: Sequence[Entry], limit: float | None
) -> list[Column]:
    """The shapes themselves, then the forms of each method, all poses turned alike."""
    preparation = Preparation(dataset, jobs[0].input, store)
    surfaces = [_surface(preparation, entry) for entry in entries]
    turns = [dataset.camera(entry).rotation.T if jobs[0].input == "mesh" else np.eye(3) for entry in entries]
    seen = [None if isinstance(s, str) else s.vertices @ turn for s, turn in zip(surfaces, turns, strict=True)]
    columns = [_turned("input", surfaces, surfaces, seen)]
    columns += [
        _turned(job.method.title, _made(job, preparation, store, entries, limit), surfaces, seen)
        for job in jobs
        if isinstance(job.method.create(), Method)
    ]
    if len(columns) == 1:
        raise ConfigurationError("none of the methods makes forms", "name one that does with -m; see 'list methods'")
    return columns


def _turned(
    title: str, forms: Sequence[Mesh | str], surfaces: Sequence[Mesh | str], seen: Sequence[Points | None]
) -> Column:
    """Forms as they are drawn: upright, and all poses turned alike."""
    meshes: list[Mesh | str] = []
    model: Points | None = None
    for form, surface, points in zip(forms, surfaces, seen, strict=True):
        if isinstance(form, str) or isinstance(surface, str) or points is None:
            meshes.append(form if isinstance(form, str) else str(surface))
            continue
        vertices = centred(points if form is surface else upright(form, surface, points, model))
        model = vertices if model is None else model
        meshes.append(form.with_vertices(vertices))
    return Column(title, meshes)


def _surface(preparation: Preparation, entry: Entry) -> Mesh | str:
    try:
        return preparation.shape(entry).mesh
    except ShapeError as error:
        return str(error)


def _made(
    job: Job, preparation: Preparation, store: Store, entries: Sequence[Entry], limit: float | None
) -> list[Mesh | str]:
    """The form of each shape, made where it is missing, or the reason why there is none."""
    if job.state in ("unavailable", "unsupported", "failed"):
        return [job.reason] * len(entries)
    method_run = MethodRun(preparation, store, job.method, job.seed, job.model_of)
    missing = [e.identifier for e in entries if store.find(method_run.recipe(e), wanted=lambda _: False) is None]
    reason = "it cannot be kept"
    if missing:
        try:
            guard = Guard(job.name, "run it to see more", limit)
            call_apart(make_forms, to_json(job), missing, guard=guard, say=lambda _: None)
        except BenchmarkError as error:
            reason = str(error)
    forms: list[Mesh | str] = []
    for entry in entries:
        try:
            forms.append(method_run.found_form(entry) or reason)
        except ShapeError as error:
            forms.append(str(error))
    return forms
