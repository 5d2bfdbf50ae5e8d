"""Figures made from stored stages: what the methods make of one subject in a few poses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmark.contracts import Descriptor
from benchmark.datasets.base import Entry
from benchmark.errors import ShapeError
from benchmark.geometry.camera import Camera
from benchmark.jobs.plan import Job
from benchmark.jobs.preparation import Preparation
from benchmark.jobs.treatment import Treatment
from benchmark.protocols.tables import Gallery
from benchmark.report.content import file_stem
from benchmark.report.pictures.drawing import Image, depth_picture, principal_frame, shaded
from benchmark.storage.store import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Poses of the subject that a figure shows.
POSES = 3

#: Forms that are the input itself, turned at most: they stand as the camera sees the input.
_UPRIGHT = ("identity",)

#: The surface behind a depth image looks complete from the front, so it is drawn from aside.
_ASLANT = Camera((0.7, 1.0, -0.2))


def forms_figures(jobs: Sequence[Job], store: Store, seed: int, folder: Path) -> dict[str, str]:
    """Draw :func:`forms_figure` for each gallery of a plan, and write them into a folder.

    Tables that go with others show the forms of those, and have no figure of their own.

    Returns
    -------
    dict
        File name by the file stem of the gallery's table.
    """
    names: dict[str, str] = {}
    for job in jobs:
        gallery = job.gallery
        stem = file_stem(gallery.table.identifier, gallery.dataset.name, quick=gallery.quick)
        if stem in names or gallery.table.part_of or gallery.table.ablation:
            continue
        names[stem] = f"forms-{gallery.dataset.name}.png"
        own = [other for other in jobs if other.gallery.name == gallery.name]
        save(forms_figure(own, store, seed), folder / names[stem])
    return names


def forms_figure(jobs: Sequence[Job], store: Store, seed: int, subject: str = "", size: int = 220) -> Figure:
    """Draw the input, the depth view, and the canonical forms of all methods, for one subject of one gallery.

    Parameters
    ----------
    jobs
        Jobs of one gallery; their stages are taken from the store, and computed where missing.
    store
        Where the stages are.
    seed
        Base seed of the run.
    subject
        Which subject to show; the first one by default.
    size
        Pixels per picture.
    """
    from matplotlib.figure import Figure

    gallery = jobs[0].gallery
    inputs = tuple(dict.fromkeys(job.input for job in jobs))
    available = {job.method.name: job for job in jobs if job.state not in ("unavailable", "unsupported")}
    shown = [job for job in available.values() if not isinstance(job.method.create(), Descriptor)]
    entries = _poses(gallery, subject)
    columns: list[tuple[str, list[Image]]] = []
    for input_ in inputs:
        preparation = Preparation(gallery.dataset, input_, store)
        treatments = [Treatment(preparation, store, job.method, seed, job.models) for job in shown]
        for entry in entries:
            pictures = [_input_picture(preparation, entry, size)]
            pictures += [_form_picture(treatment, entry, size) for treatment in treatments]
            columns.append((f"{input_}: {entry.identifier}", pictures))
    rows = ["input", *(job.method.title for job in shown)]
    figure = Figure(figsize=(1.7 * len(columns) + 1.2, 1.7 * len(rows) + 0.3), dpi=100)
    axes = figure.subplots(len(rows), len(columns), squeeze=False, gridspec_kw={"wspace": 0.02, "hspace": 0.02})
    for j, (title, pictures) in enumerate(columns):
        axes[0, j].set_title(title, fontsize=7)
        for i, picture in enumerate(pictures):
            axes[i, j].imshow(picture, interpolation="antialiased")
            axes[i, j].set_axis_off()
    for i, row in enumerate(rows):
        axes[i, 0].text(-0.05, 0.5, row, transform=axes[i, 0].transAxes, ha="right", va="center", fontsize=8)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG without dates, so that the same picture is the same file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, bbox_inches="tight", pad_inches=0.05, metadata={"Software": None})


def _poses(gallery: Gallery, subject: str) -> list[Entry]:
    """Poses of one subject, spread over those that it has."""
    name = subject or gallery.entries[0].subject
    members = [entry for entry in gallery.entries if entry.subject == name]
    return [members[i] for i in np.unique(np.linspace(0, len(members) - 1, POSES).astype(int))]


def _input_picture(preparation: Preparation, entry: Entry, size: int) -> Image:
    """The complete surface as the camera sees it, or the depth image."""
    shape = preparation.shape(entry)
    if shape.depth is not None:
        return depth_picture(shape.depth, size)
    return shaded(shape.mesh, preparation.dataset.camera(entry), size)


def _form_picture(treatment: Treatment, entry: Entry, size: int) -> Image:
    try:
        form = treatment.form(entry)
    except ShapeError:
        return np.ones((size, size, 3))
    if treatment.spec.name not in _UPRIGHT:
        return shaded(principal_frame(form), size=size)
    if treatment.preparation.input == "mesh":
        return shaded(form, treatment.preparation.dataset.camera(entry), size)
    upright = form.with_vertices(form.vertices[:, [0, 2, 1]] * [1, -1, 1])  # from camera coordinates to z up
    return shaded(upright, _ASLANT, size)
