"""Figures made from stored stages: what the methods make of one subject in a few poses."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmark.contracts import Method
from benchmark.datasets.base import Entry
from benchmark.errors import BenchmarkError, ShapeError
from benchmark.geometry.camera import Camera
from benchmark.jobs.orders import Order, Scope
from benchmark.jobs.plan import Job
from benchmark.jobs.preparation import Preparation
from benchmark.jobs.runner import make_forms
from benchmark.jobs.treatment import Treatment
from benchmark.protocols.tables import Gallery
from benchmark.report.content import file_stem
from benchmark.report.pictures.drawing import Image, depth_picture, principal_frame, shaded
from benchmark.storage.store import Store
from benchmark.system.calls import call_apart
from benchmark.system.text import clean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A picture, or the reason why there is none.
Picture = Image | str

#: Poses of the subject that a figure shows.
POSES = 3

#: Forms that are the input itself, turned at most: they stand as the camera sees the input.
_UPRIGHT = ("identity",)

#: The surface behind a depth image looks complete from the front, so it is drawn from aside.
_ASLANT = Camera((0.7, 1.0, -0.2))


def forms_figures(
    jobs: Sequence[Job], store: Store, selection: Scope, folder: Path, limit: float | None = None
) -> dict[str, str]:
    """Draw :func:`forms_figure` for each gallery of a plan, and write them into a folder.

    Tables that go with others show the forms of those, and have no figure of their own.

    Returns
    -------
    dict
        File name by the file stem of the gallery's table.

    Raises
    ------
    BenchmarkError
        If a file cannot be written.
    """
    names: dict[str, str] = {}
    for job in jobs:
        gallery = job.gallery
        stem = file_stem(gallery.table.identifier, gallery.dataset.name, quick=gallery.quick)
        if stem in names or gallery.table.part_of or gallery.table.ablation:
            continue
        names[stem] = f"forms-{gallery.dataset.name}.png"
        own = [other for other in jobs if other.gallery.name == gallery.name]
        save(forms_figure(own, store, selection, limit=limit), folder / names[stem])
    return names


def forms_figure(
    jobs: Sequence[Job],
    store: Store,
    selection: Scope,
    subject: str = "",
    size: int = 220,
    limit: float | None = None,
) -> Figure:
    """Draw the input, the depth view, and the canonical forms of all methods, for one subject of one gallery.

    Where there is no form, its place tells why.

    Parameters
    ----------
    jobs
        Jobs of one gallery; their stages are taken from the store. Missing forms are made in a process of their own,
        but not those of a job that has failed.
    store
        Where the stages are.
    selection
        What the jobs were planned for.
    subject
        Which subject to show; the first one by default.
    size
        Pixels per picture.
    limit
        Seconds that making one form may take; None for no limit.
    """
    from matplotlib.figure import Figure

    gallery = jobs[0].gallery
    by_place = {(job.method.name, job.input): job for job in jobs}
    available = {job.method.name: job for job in jobs if job.state not in ("unavailable", "unsupported")}
    shown = [name for name, job in available.items() if isinstance(job.method.create(), Method)]
    entries = _poses(gallery, subject)
    columns: list[tuple[str, list[Picture]]] = []
    for input_ in dict.fromkeys(job.input for job in jobs):
        preparation = Preparation(gallery.dataset, input_, store)
        inputs = [_input_picture(preparation, entry, size) for entry in entries]
        rows = [_form_pictures(by_place[name, input_], preparation, selection, entries, size, limit) for name in shown]
        for number, entry in enumerate(entries):
            columns.append((clean(f"{input_}: {entry.identifier}"), [inputs[number], *(row[number] for row in rows)]))
    titles = ["input", *(clean(available[name].method.title) for name in shown)]
    figure = Figure(figsize=(1.7 * len(columns) + 1.2, 1.7 * len(titles) + 0.3), dpi=100)
    axes = figure.subplots(len(titles), len(columns), squeeze=False, gridspec_kw={"wspace": 0.02, "hspace": 0.02})
    for j, (heading, pictures) in enumerate(columns):
        axes[0, j].set_title(heading, fontsize=7, parse_math=False)
        for i, picture in enumerate(pictures):
            _fill(axes[i, j], picture, size)
    for i, title in enumerate(titles):
        place = axes[i, 0]
        place.text(-0.05, 0.5, title, transform=place.transAxes, ha="right", va="center", fontsize=8, parse_math=False)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG without dates, so that the same picture is the same file."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, bbox_inches="tight", pad_inches=0.05, metadata={"Software": None})
    except OSError as error:
        raise BenchmarkError(f"cannot write {path}: {error.strerror}", "choose another folder with -o") from error


def _fill(place: Any, picture: Picture, size: int) -> None:
    """Put a picture into its place, or the reason why there is none."""
    place.set_axis_off()
    if not isinstance(picture, str):
        place.imshow(picture, interpolation="antialiased")
        return
    place.imshow(np.ones((size, size, 3)), interpolation="antialiased")
    said = "\n".join(textwrap.wrap(clean(picture), 28, max_lines=8, placeholder=" ..."))
    place.text(
        0.5, 0.5, said, transform=place.transAxes, ha="center", va="center", fontsize=5, color="0.4", parse_math=False
    )


def _poses(gallery: Gallery, subject: str) -> list[Entry]:
    """Poses of one subject, spread over those that it has."""
    name = subject or gallery.entries[0].subject
    members = [entry for entry in gallery.entries if entry.subject == name]
    return [members[i] for i in np.unique(np.linspace(0, len(members) - 1, POSES).astype(int))]


def _input_picture(preparation: Preparation, entry: Entry, size: int) -> Picture:
    """The complete surface as the camera sees it, or the depth image; the reason if it cannot be prepared."""
    try:
        shape = preparation.shape(entry)
    except ShapeError as error:
        return str(error)
    if shape.depth is not None:
        return depth_picture(shape.depth, size)
    return shaded(shape.mesh, preparation.dataset.camera(entry), size)


def _form_pictures(
    job: Job, preparation: Preparation, selection: Scope, entries: Sequence[Entry], size: int, limit: float | None
) -> list[Picture]:
    """The form of each shape, or the reason why there is none."""
    if job.state in ("unavailable", "unsupported", "failed") or preparation.store is None:
        return [job.reason] * len(entries)
    treatment = Treatment(preparation, preparation.store, job.method, selection.seed, job.models)
    order = Order.of(job, selection)
    recipes = {entry.identifier: treatment.recipe(entry) for entry in entries}
    missing = [name for name, recipe in recipes.items() if preparation.store.find(recipe, wanted=_nothing) is None]
    reason = "it cannot be kept"
    if missing:
        try:
            call_apart(
                make_forms, order, missing, what=job.name, mend="run it to see more", limit=limit, say=lambda _: None
            )
        except BenchmarkError as error:
            reason = str(error)
    found = [_form_picture(treatment, entry, size) for entry in entries]
    return [reason if picture is None else picture for picture in found]


def _nothing(_: str) -> bool:
    """Want no array: it is enough to know whether a form is there."""
    return False


def _form_picture(treatment: Treatment, entry: Entry, size: int) -> Picture | None:
    """The form of a shape, or why the shape cannot be treated; None if there is no answer."""
    try:
        form = treatment.found_form(entry)
    except ShapeError as error:
        return str(error)
    if form is None:
        return None
    if treatment.spec.name not in _UPRIGHT:
        return shaded(principal_frame(form), size=size)
    if treatment.preparation.input == "mesh":
        return shaded(form, treatment.preparation.dataset.camera(entry), size)
    upright = form.with_vertices(form.vertices[:, [0, 2, 1]] * [1, -1, 1])  # from camera coordinates to z up
    return shaded(upright, _ASLANT, size)
