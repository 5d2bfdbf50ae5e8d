"""Figures of forms for papers and pages: what methods make of a subject in a few poses."""

from __future__ import annotations

import io
import textwrap
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from benchmark.api.contracts import Method
from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import BenchmarkError, ConfigurationError, ShapeError, did_you_mean
from benchmark.execution.job_specs import Job, to_json
from benchmark.execution.processes.calls import Guard, call_apart
from benchmark.execution.runner import make_forms
from benchmark.files import write_atomically
from benchmark.geometry.mesh import Mesh, Points
from benchmark.pipeline.method_run import MethodRun
from benchmark.pipeline.preparation import Preparation
from benchmark.pipeline.storage.store import Store
from benchmark.report.pictures.painting import outwardness, painted
from benchmark.report.pictures.posing import centred, reach, upright
from benchmark.text import clean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Poses of a subject that a figure shows.
POSES = 3

#: Width of a figure in inches: the text of a two-column paper.
WIDTH = 7.16

#: Pixels per side of a picture.
_PIXELS = 280

#: Height of the titles in inches.
_TITLES = 0.28

#: Width of a picture beyond what the largest form of its row takes.
_MARGIN = 1.03


@dataclass
class Forms:
    """Forms of some shapes by one method, turned for the eye.

    Parameters
    ----------
    title
        The method.
    meshes
        Surfaces as they are drawn, or why there is none.
    """

    title: str
    meshes: list[Mesh | str] = field(default_factory=list)

    @property
    def half(self) -> float:
        """Half the width of a picture that holds each of them."""
        return max((_MARGIN * reach(mesh.vertices) for mesh in self.meshes if isinstance(mesh, Mesh)), default=1.0)


def forms_figure(
    jobs: Sequence[Job],
    store: Store,
    subject: str = "",
    shapes: Sequence[str] = (),
    limit: float | None = None,
) -> Figure:
    """Draw one subject in a few poses, and beside each the forms of all methods; as wide as a page.

    Where there is no form, its place tells why.

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
        If there is no such subject or shape.
    """
    dataset, entries = _shapes_of(jobs[0])
    chosen = _chosen(jobs[0].gallery, entries, subject, shapes)
    return drawn(_of_methods(jobs, dataset, store, chosen, limit))


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
    from matplotlib.figure import Figure

    gallery, (dataset, entries) = jobs[0].gallery, _shapes_of(jobs[0])
    shown = _chosen(gallery, entries, "", shapes) if shapes else entries
    named = list(subjects) or list(dict.fromkeys(entry.subject for entry in shown))[: None if shapes else 2]
    rows = []
    for subject in named:
        own = [name for name in shapes if any(e.identifier == name and e.subject == subject for e in entries)]
        rows.append(_of_methods(jobs[:1], dataset, store, _chosen(gallery, entries, subject, own), limit))
    n_poses = max(len(row[0].meshes) for row in rows)
    side = 1.5
    figure = Figure(figsize=(side * (2 * n_poses + 0.7), side * len(rows) + 0.35), dpi=_PIXELS / 2)
    widths = [1] * n_poses + [0.7] + [1] * n_poses
    axes = figure.subplots(
        len(rows), len(widths), squeeze=False,
        gridspec_kw={"width_ratios": widths, "wspace": 0, "hspace": 0, "left": 0, "right": 1, "bottom": 0, "top": 0.9},
    )  # fmt: skip
    for line, row in zip(axes, rows, strict=True):
        for place in line:
            place.set_axis_off()
        for start, forms in ((0, row[0]), (n_poses + 1, row[1])):
            for k, mesh in enumerate(forms.meshes):
                _fill(line[start + k], mesh, forms.half)
        line[n_poses].annotate(
            "", (0.85, 0.5), (0.15, 0.5), xycoords="axes fraction", textcoords="axes fraction",
            arrowprops={"arrowstyle": "-|>", "lw": 2.2, "color": "0.45", "mutation_scale": 18},
        )  # fmt: skip
    figure.text(n_poses / sum(widths) / 2, 0.955, "The same bodies in different poses", **_HEAD)
    figure.text(
        1 - n_poses / sum(widths) / 2, 0.955, f"Their canonical forms, by {clean(jobs[0].method.info.title)}", **_HEAD
    )
    return figure


_HEAD: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 12, "color": "0.25", "parse_math": False}


#: What each figure says about its origin, so that no figure of ours takes the place of another file.
SIGNATURE = "canonical-forms benchmark"

#: Metadata by the end of a file's name: without it, they would name the time and the version of matplotlib.
_UNDATED: dict[str, dict[str, str | None]] = {
    ".png": {"Software": SIGNATURE},
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": SIGNATURE},
    ".svg": {"Date": None, "Creator": SIGNATURE},
}

#: Kinds of files that a figure can be.
ENDINGS = tuple(_UNDATED)


def as_file(figure: Figure, ending: str) -> bytes:
    """Return a figure as a file without dates, of the kind that has this ending."""
    import matplotlib as mpl

    stream = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "figure"}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a box is drawn in its place
        options: dict[str, Any] = {"bbox_inches": "tight", "pad_inches": 0.03, "metadata": _UNDATED[ending]}
        figure.savefig(stream, format=ending[1:], **options)
    return stream.getvalue()


def save(figure: Figure, path: Path) -> None:
    """Write a figure without dates, so that the same picture is the same file; the end of its name chooses the kind."""
    data = as_file(figure, path.suffix.lower())
    try:
        write_atomically(path, lambda file: file.write(data))
    except OSError as error:
        raise BenchmarkError(f"cannot write {path}: {error.strerror}", "choose another folder with -o") from error


def drawn(columns: Sequence[Forms], width: float = WIDTH) -> Figure:
    """Draw a column for the shapes and for each method, together of a width in inches."""
    from matplotlib.figure import Figure

    rows = [[each.meshes[k] for each in columns] for k in range(len(columns[0].meshes))]
    side = width / len(columns)
    height = side * len(rows) + _TITLES
    figure = Figure(figsize=(width, height), dpi=max(300, _PIXELS / side))
    axes = figure.subplots(
        len(rows), len(columns), squeeze=False,
        gridspec_kw={"wspace": 0, "hspace": 0, "left": 0, "right": 1, "bottom": 0, "top": 1 - _TITLES / height},
    )  # fmt: skip
    for line, row in zip(axes, rows, strict=True):
        for place, forms, mesh in zip(line, columns, row, strict=True):
            place.set_axis_off()
            _fill(place, mesh, forms.half)
    for place, forms in zip(axes[0], columns, strict=True):
        title = textwrap.fill(clean(forms.title), 14, max_lines=2, placeholder=" ...")
        place.text(
            0.5, 1.03, title, transform=place.transAxes, ha="center", va="bottom", fontsize=6.5, parse_math=False
        )
    return figure


def _fill(place: Any, mesh: Mesh | str, half: float) -> None:
    """Put a picture into its place, or the reason why there is none."""
    if isinstance(mesh, Mesh):
        picture = painted(mesh.vertices, mesh.faces, outwardness(mesh), _PIXELS, half)
        place.imshow(np.asarray(picture), interpolation="antialiased")
        return
    place.set_aspect("equal")
    said = "\n".join(textwrap.wrap(clean(mesh), 22, max_lines=7, placeholder=" ..."))
    place.text(
        0.5, 0.5, said, transform=place.transAxes, ha="center", va="center", fontsize=4, color="0.4", parse_math=False
    )


def _shapes_of(job: Job) -> tuple[Dataset, list[Entry]]:
    dataset = open_dataset(job.dataset, job.data_root)
    entries = {entry.identifier: entry for entry in dataset.entries}
    return dataset, [entries[identifier] for identifier in job.identifiers]


def _chosen(gallery: str, entries: Sequence[Entry], subject: str, shapes: Sequence[str]) -> list[Entry]:
    """The named shapes, else poses of one subject, spread over those that it has."""
    if shapes:
        known = {entry.identifier: entry for entry in entries}
        unknown = next((name for name in shapes if name not in known), None)
        if unknown is not None:
            raise did_you_mean(f"shape of {gallery}", unknown, known)
        return [known[name] for name in shapes]
    name = subject or entries[0].subject
    if not (found := poses_of(entries, name)):
        raise did_you_mean(f"subject of {gallery}", name, {entry.subject for entry in entries})
    return found


def poses_of(entries: Sequence[Entry], subject: str) -> list[Entry]:
    """Return some poses of a subject, spread over those that it has."""
    members = [entry for entry in entries if entry.subject == subject]
    return [members[i] for i in np.unique(np.linspace(0, max(len(members) - 1, 0), POSES).astype(int)) if members]


def _of_methods(
    jobs: Sequence[Job], dataset: Dataset, store: Store, entries: Sequence[Entry], limit: float | None
) -> list[Forms]:
    """The shapes themselves, then the forms of each method, all poses turned alike."""
    input_ = jobs[0].input
    preparation = Preparation(dataset, input_, store)
    surfaces = [_surface(preparation, entry) for entry in entries]
    seen: list[Points | None] = []
    for entry, surface in zip(entries, surfaces, strict=True):
        vertices = None if isinstance(surface, str) else surface.vertices
        if vertices is not None and input_ == "mesh":
            vertices = vertices @ dataset.camera(entry).rotation.T
        seen.append(vertices)
    found = [untreated(surfaces, seen)]
    found += [
        turned(job.method.title, _made(job, preparation, entries, limit), surfaces, seen)
        for job in jobs
        if isinstance(job.method.create(), Method)
    ]
    if len(found) == 1:
        raise ConfigurationError("none of the methods makes forms", "name one that does with -m; see 'list methods'")
    return found


def untreated(surfaces: Sequence[Mesh | str], seen: Sequence[Points | None]) -> Forms:
    """Return the shapes themselves as they are drawn: surfaces, and their vertices as a camera sees them."""
    own = [
        m if isinstance(m, str) else m.with_vertices(centred(cast(Points, s)))
        for m, s in zip(surfaces, seen, strict=True)
    ]
    return Forms("input", own)


def turned(
    title: str, made: Sequence[Mesh | str], surfaces: Sequence[Mesh | str], seen: Sequence[Points | None]
) -> Forms:
    """Return forms as they are drawn: upright, and all poses turned alike; or why there is none."""
    forms = Forms(title)
    model: Points | None = None
    for form, surface, points in zip(made, surfaces, seen, strict=True):
        if isinstance(form, str) or isinstance(surface, str) or points is None:
            forms.meshes.append(form if isinstance(form, str) else str(surface))
            continue
        vertices = centred(upright(form, surface, points, model))
        model = vertices if model is None else model
        forms.meshes.append(form.with_vertices(vertices))
    return forms


def _surface(preparation: Preparation, entry: Entry) -> Mesh | str:
    try:
        return preparation.shape(entry).mesh
    except ShapeError as error:
        return str(error)


def _made(job: Job, preparation: Preparation, entries: Sequence[Entry], limit: float | None) -> list[Mesh | str]:
    """The form of each shape, or the reason why there is none."""
    if job.state in ("unavailable", "unsupported", "failed") or preparation.store is None:
        return [job.reason] * len(entries)
    method_run = MethodRun(preparation, preparation.store, job.method, job.seed, job.model_of)
    recipes = {entry.identifier: method_run.recipe(entry) for entry in entries}
    missing = [name for name, recipe in recipes.items() if preparation.store.find(recipe, wanted=_nothing) is None]
    reason = "it cannot be kept"
    if missing:
        try:
            guard = Guard(job.name, "run it to see more", limit)
            call_apart(make_forms, to_json(job), missing, guard=guard, say=lambda _: None)
        except BenchmarkError as error:
            reason = str(error)
    return [_found(method_run, entry) or reason for entry in entries]


def _nothing(_: str) -> bool:
    """Want no array: it is enough to know whether a form is there."""
    return False


def _found(method_run: MethodRun, entry: Entry) -> Mesh | str | None:
    """The form of a shape, or why the shape cannot be treated; None if there is no answer."""
    try:
        return method_run.found_form(entry)
    except ShapeError as error:
        return str(error)
