"""Figures of canonical forms for papers and pages."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmark.api.datasets import Entry
from benchmark.errors import BenchmarkError, ConfigurationError, did_you_mean
from benchmark.execution.job_specs import Job
from benchmark.execution.processes.calls import call_apart
from benchmark.execution.runner import make_forms
from benchmark.geometry.mesh import Mesh, Points
from benchmark.pipeline.storage.records import Record
from benchmark.report.artefact_reader import NOT_STORED, ArtefactReader
from benchmark.report.pictures.painting import outwardness, painted
from benchmark.report.pictures.posing import SHAPE, have_same_poses, posed, reach, spread
from benchmark.text import clean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Number of shapes of a subject in a figure.
POSES = 3

#: Widths in inches: of a figure, as the text of a two-column paper; of the widest column; of a picture of an effect.
WIDTH, _COLUMN, _SIDE = 7.16, 1.25, 1.5

#: Maximum number of methods side by side.
_MOST = 8

#: Pixels per side of a picture.
_PIXELS = 280

#: Height of the titles in inches.
_TITLES = 0.28

#: Width of a picture, relative to the largest form of its row.
_MARGIN = 1.03


@dataclass
class Column:
    """Title of a method with its oriented forms of some shapes, or the reasons why there are none."""

    title: str
    meshes: Sequence[Mesh | str]

    def draw(self, place: Any, number: int) -> None:
        """Draw one of the forms, or the reason why there is none, in its axes."""
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
    jobs: Sequence[Job],
    artefacts: ArtefactReader,
    subject: str = "",
    shapes: Sequence[str] = (),
    limit: float | None = None,
) -> Figure:
    """Draw one subject in a few poses, each with the forms of all methods; as wide as a page.

    Parameters
    ----------
    jobs
        Jobs of one gallery with one input. Missing forms are computed in a separate process, unless their job has
        failed.
    artefacts
        Reader of the forms.
    subject
        The subject, by default the first.
    shapes
        The shapes, instead of some poses of a subject.
    limit
        Timeout in seconds for computing each missing form; None for no limit.

    Raises
    ------
    ConfigurationError
        If there is no such subject or shape, or no method computes forms.
    """
    records = _records(jobs)
    entries = _chosen(jobs[0].gallery, _entries(records, artefacts), subject, shapes)
    return _drawn(_columns(records, artefacts, entries, _make(jobs, records, artefacts, entries, limit)))


def effect_figure(
    jobs: Sequence[Job],
    artefacts: ArtefactReader,
    subjects: Sequence[str] = (),
    shapes: Sequence[str] = (),
    limit: float | None = None,
) -> Figure:
    """Draw some subjects in a few poses on the left, and their forms by the first method on the right.

    Parameters
    ----------
    jobs, artefacts, limit
        See :func:`forms_figure`.
    subjects
        The subjects, one per row; by default those of the shapes, or the first two.
    shapes
        Their shapes, instead of some poses of each.
    """
    jobs, gallery, records = jobs[:1], jobs[0].gallery, _records(jobs[:1])
    entries = _entries(records, artefacts)
    named = _chosen(gallery, entries, "", shapes) if shapes else []
    subjects = subjects or list(dict.fromkeys(entry.subject for entry in named or entries))[: None if shapes else 2]
    rows = []
    for subject in subjects:
        own = [entry.identifier for entry in named if entry.subject == subject]
        chosen = _chosen(gallery, entries, subject, own)
        rows.append(_columns(records, artefacts, chosen, _make(jobs, records, artefacts, chosen, limit)))
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


def _drawn(columns: Sequence[Column], width: float = WIDTH) -> Figure:
    """Draw a column for the shapes and for each method, with a total width in inches."""
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
    """Return a figure of a size in inches, and axes without frames and gaps, up to a fraction ``top`` of its height."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi)
    edges = {"wspace": 0, "hspace": 0, "left": 0, "right": 1, "bottom": 0, "top": top}
    axes = figure.subplots(n_rows, len(widths), squeeze=False, gridspec_kw={"width_ratios": widths, **edges})
    for place in axes.flat:
        place.set_axis_off()
    return figure, axes


def _records(jobs: Sequence[Job]) -> dict[str, Record]:
    """Return the records that jobs with forms would have, as far as known before they run."""
    if all(job.method.describes for job in jobs):
        raise ConfigurationError("none of the methods computes forms", "name one that does with -m; see 'list methods'")
    return {
        job.method.name: {
            **job.facts, "key": job.name, "data": {"source": job.dataset, "name": job.gallery},
            "shapes": job.identifiers, "recipe": {"seed": job.seed},
        }
        for job in jobs
        if not job.method.describes
    }  # fmt: skip


def _entries(records: Mapping[str, Record], artefacts: ArtefactReader) -> list[Entry]:
    """Return the shapes of the gallery of some records; raise ``BenchmarkError`` if the data set is missing."""
    record = next(iter(records.values()))
    entries = {entry.identifier: entry for entry in artefacts.dataset(record).shapes}
    return [entries[identifier] for identifier in record["shapes"]]


def _chosen(gallery: str, entries: Sequence[Entry], subject: str = "", shapes: Sequence[str] = ()) -> list[Entry]:
    """Return the named shapes, or some of a subject, by default the first."""
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


def _make(
    jobs: Sequence[Job],
    records: Mapping[str, Record],
    artefacts: ArtefactReader,
    entries: Sequence[Entry],
    limit: float | None,
) -> dict[str, str]:
    """Compute the missing forms, and return the reasons why some cannot be computed, by method."""
    reasons = {}
    for job in (job for job in jobs if job.method.name in records):
        name = job.method.name
        missing = [entry.identifier for entry in entries if artefacts.form(records[name], entry) == NOT_STORED]
        if job.state in ("unavailable", "unsupported", "failed"):
            reasons[name] = job.reason
        elif missing:
            reasons[name] = "it cannot be stored"
            try:
                hint = "run it to see more"
                call_apart(make_forms, job, missing, what=job.name, hint=hint, limit=limit, say=lambda _: None)
            except BenchmarkError as error:
                reasons[name] = str(error)
    return reasons


def _columns(
    records: Mapping[str, Record], artefacts: ArtefactReader, entries: Sequence[Entry], reasons: Mapping[str, str]
) -> list[Column]:
    """Return a column of shapes, then one of forms for each method, with all poses in one orientation."""
    record, models = next(iter(records.values())), dict[str, Points]()
    forms = [posed(entry, record, records, artefacts, models) for entry in entries]
    columns = [Column("input", [of_shape[SHAPE] for of_shape in forms])]
    for name, of_method in records.items():
        meshes = [reasons.get(name, NOT_STORED) if row[name] == NOT_STORED else row[name] for row in forms]
        columns.append(Column(of_method["title"], meshes))
    return columns
