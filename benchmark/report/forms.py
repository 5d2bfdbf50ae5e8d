"""Shapes and their stored forms as they are drawn: right, up, towards the viewer."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import orthogonal_procrustes
from scipy.spatial import cKDTree

from benchmark.api.datasets import ShapeSet
from benchmark.datasets.catalogue import open_dataset
from benchmark.depth.frame import UPRIGHT
from benchmark.errors import BenchmarkError
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.mesh import Mesh, Points
from benchmark.pipeline.records import (
    RankedShapes,
    Record,
    published_folder,
    read_form,
    read_prepared,
)
from benchmark.report.drawing import outwardness
from benchmark.report.frames import file_name
from retrieval.views import CUBE_SYMMETRIES

#: A form is drawn mirrored, or turned more, if it comes nearer by this factor: bodies nearly equal
#: their mirror images.
NEARER = 0.9

#: Steps of an alignment with all points, and before that with a few; points, and starts that are
#: refined.
_STEPS, _FEW, _FEW_STEPS, _DRAWN, _KEPT = 10, 100, 6, 600, 4


@dataclass(frozen=True, eq=False)
class Drawn:
    """A shape or form as it is drawn.

    Parameters
    ----------
    mesh
        The surface, centred by area, of unit root mean square radius.
    body
        Its shape, if a form has the same vertices, which says how far each is from the centre.
    is_mirrored
        Whether it is the mirror image of the form that a method made.
    apart
        Mean distance of its points from the form of the first pose, both ways, where it was turned
        to it.
    """

    mesh: Mesh
    body: Drawn | None = None
    is_mirrored: bool = False
    apart: float | None = None

    @cached_property
    def values(self) -> NDArray[np.float64]:
        """How far each vertex is from the centre of the body."""
        return self.body.values if self.body else outwardness(self.mesh)


@dataclass(frozen=True)
class StoredForms:
    """Reader of the shapes and forms that a results folder keeps of its own jobs.

    Parameters
    ----------
    folder
        The results folder.
    data_root
        Folder of the official data sets, whose cameras say which side of a shape is up.
    """

    folder: Path
    data_root: Path | None = None
    _sets: dict[str, ShapeSet | None] = field(default_factory=dict, repr=False)
    _shapes: dict[tuple[str, str, str], Drawn | None] = field(default_factory=dict, repr=False)
    _firsts: dict[tuple[str, str], Drawn | None] = field(default_factory=dict, repr=False)

    def shape(self, record: RankedShapes, name: str) -> Drawn | None:
        """Return a prepared shape; None if it is not stored."""
        place = record.gallery_digest, record.input, name
        if place not in self._shapes:
            mesh = read_prepared(self.folder, record, name)
            camera = self._camera(record, name) if mesh and record.input == "mesh" else UPRIGHT
            self._shapes[place] = seen(mesh, camera) if mesh else None
        return self._shapes[place]

    def form(self, record: Record, name: str) -> Drawn | None:
        """Return the form of a shape, turned to that of the first pose; None if it is not stored.

        The form of the first pose of a subject is turned as its shape.
        """
        label = record.labels[record.shapes.index(name)]
        first = next((record.shapes[k] for k in record.answered if record.labels[k] == label), name)
        if (record.key, first) not in self._firsts:
            self._firsts[record.key, first] = self.upright(record, first)
        target = self._firsts[record.key, first]
        form = target if name == first else self.upright(record, name)
        return form if form is target or form is None or target is None else turned(form, target)

    def upright(self, record: RankedShapes, name: str) -> Drawn | None:
        """Return the form of a shape, turned as the shape; None if it is not stored."""
        form, shape = read_form(self.folder, record, name), self.shape(record, name)
        return upright(form, shape) if form and shape else None

    def _camera(self, record: RankedShapes, name: str) -> Camera:
        source = record.data.source
        if source not in self._sets:
            try:
                self._sets[source] = open_dataset(source, self.data_root)
            except (BenchmarkError, OSError):
                self._sets[source] = None  # the data are not here; a front view has z up
        shapes = self._sets[source]
        entries = [entry for entry in shapes.shapes if entry.identifier == name] if shapes else []
        return shapes.camera(entries[0]) if shapes and entries else FRONT


def thumbnail(results: Path, dataset: str, row: str) -> Path:
    """Return the file of the published picture of a form of a row of a table on a data set, or on a change of it."""
    name = f"{dataset.partition('[')[0]}-{row}"
    return published_folder(results) / "figures" / "rows" / f"{file_name(name)}.webp"


def upright(form: Mesh, shape: Drawn) -> Drawn:
    """Return a form as it is drawn, turned as its shape if both have the same vertices."""
    mesh = centred(form)
    if mesh.vertices.shape == shape.mesh.vertices.shape:
        turn, _ = orthogonal_procrustes(mesh.vertices, shape.mesh.vertices)
        mesh = mesh.with_vertices(mesh.vertices @ turn)
    return Drawn(mesh, shape if np.array_equal(mesh.faces, shape.mesh.faces) else None)


def seen(mesh: Mesh, camera: Camera) -> Drawn:
    """Return a shape as it is drawn: as a camera sees it."""
    return Drawn(centred(mesh.with_vertices(mesh.vertices @ camera.rotation.T)))


def centred(mesh: Mesh) -> Mesh:
    """Centre a surface by area, and scale it to unit root mean square radius."""
    weights = np.maximum(mesh.vertex_areas, 1e-12)  # of a line or point, all vertices count
    points = mesh.vertices - np.average(mesh.vertices, axis=0, weights=weights)
    radius = np.sqrt(np.average((points**2).sum(axis=1), weights=weights))
    return mesh.with_vertices(points / max(float(radius), 1e-12))


def turned(form: Drawn, target: Drawn) -> Drawn:
    """Return a form, turned to another one as little as brings it near, or mirrored if that brings it clearly nearer.

    How far points are from the centre of the body tells a head from a foot.
    """
    points, others = (np.column_stack([each.mesh.vertices, each.values]) for each in (form, target))
    points, others = (
        each[np.linspace(0, len(each) - 1, _DRAWN).astype(int)] for each in (points, others)
    )
    distances, turns = alignments(points, others)
    mirrored = alignments(points * [-1, -1, -1, 1], others)
    is_mirrored = bool(mirrored[0].min() < NEARER * distances.min())
    if is_mirrored:
        distances, turns = mirrored[0], -mirrored[1]
    near = turns[
        NEARER * distances <= distances.min() + 1e-6
    ]  # front and back of a body hardly differ
    turn = near[np.trace(near, axis1=1, axis2=2).argmax()]
    away, _ = _nearer(form.mesh.vertices, target.mesh.vertices, turn[None], 0)
    return Drawn(
        form.mesh.with_vertices(form.mesh.vertices @ turn), form.body, is_mirrored, float(away[0])
    )


def alignments(points: Points, target: Points) -> tuple[NDArray[np.float64], Points]:
    """Return mean distances to the nearest point, both ways, and rotations that make them small.

    Parameters
    ----------
    points, target
        Centred coordinates and what else near points share, shape (n, 3 or more).
    """
    axes, others = (np.linalg.svd(each[:, :3].T @ each[:, :3])[0] for each in (points, target))
    turns = axes @ CUBE_SYMMETRIES @ others.T
    few = slice(None, None, max(1, len(points) // _FEW))
    distances, turns = _nearer(
        points[few], target[few], turns[np.linalg.det(turns) > 0], _FEW_STEPS
    )
    return _nearer(points, target, turns[np.argsort(distances, kind="stable")[:_KEPT]], _STEPS)


def _nearer(
    points: Points, target: Points, turns: Points, steps: int
) -> tuple[NDArray[np.float64], Points]:
    """Return distances and rotations, shape (k, 3, 3), after some steps of iterative closest points, both ways."""
    trees = cKDTree(points), cKDTree(target)
    for step in range(steps + 1):
        away, nearest = trees[1].query(_moved(points, turns))
        back, nearest_back = trees[0].query(_moved(target, turns.transpose(0, 2, 1)))
        if step < steps:
            pairs = (
                points[:, :3].T @ target[nearest, :3]
                + points[nearest_back, :3].transpose(0, 2, 1) @ target[:, :3]
            )
            left, _, right = np.linalg.svd(pairs)
            left[..., 2] *= np.linalg.det(left @ right)[:, None]  # no mirror image
            turns = left @ right
    return (away.mean(axis=1) + back.mean(axis=1)) / 2, turns


def _moved(points: Points, turns: Points) -> Points:
    rest = np.broadcast_to(points[:, 3:], (len(turns), len(points), points.shape[1] - 3))
    return np.concatenate([points[:, :3] @ turns, rest], axis=2)
