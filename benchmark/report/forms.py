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
from benchmark.pipeline.record_arrays import read_form, read_prepared
from benchmark.pipeline.record_files import published_folder
from benchmark.pipeline.records import RankedShapes, Record
from benchmark.registry.names import base_name
from benchmark.report.drawing import outwardness
from benchmark.report.notation import file_name
from retrieval.views import CUBE_SYMMETRIES

#: A form is drawn mirrored, or turned more, if it comes nearer by this factor: bodies nearly equal
#: their mirror images.
NEARER = 0.9

#: Points of a surface that an alignment uses, and fewer of them for its first, coarse part.
_POINTS = 600
_COARSE_POINTS = 100

#: Steps of iterative closest points in either part, and coarse results that are refined, at most.
_STEPS = 10
_COARSE_STEPS = 6
_REFINED = 4

#: A coarse result is not refined if it is farther than the best by this factor.
_FAR = 1.5

#: Two coarse results whose rotations differ by no more lead to the same.
_SAME_ROTATION = 0.02

#: Factors of positions and value by which a point is mirrored.
_MIRROR = np.array([-1, -1, -1, 1])


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
        if self.body:
            return self.body.values
        return outwardness(self.mesh)


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
    _forms: dict[tuple[str, str], Drawn | None] = field(default_factory=dict, repr=False)

    def shape(self, record: RankedShapes, name: str) -> Drawn | None:
        """Return a prepared shape; None if it is not stored."""
        place = record.gallery_digest, record.input, name
        if place not in self._shapes:
            self._shapes[place] = self._read_shape(record, name)
        return self._shapes[place]

    def _read_shape(self, record: RankedShapes, name: str) -> Drawn | None:
        """Return a prepared shape from its file; None without one."""
        mesh = read_prepared(self.folder, record, name)
        if mesh is None:
            return None
        camera = self._camera(record, name) if record.input == "mesh" else UPRIGHT
        return drawn_from(mesh, camera)

    def form(self, record: Record, name: str) -> Drawn | None:
        """Return the stored form of a shape, turned so that all poses of a subject face alike.

        The form of the subject's first pose is turned as that shape is, the others as its form.

        Parameters
        ----------
        record
            Record of the method that made the form.
        name
            Name of the shape.

        Returns
        -------
        Drawn or None
            The form; None if it is not stored.
        """
        place = record.key, name
        if place not in self._forms:
            self._forms[place] = self._turned_form(record, name)
        return self._forms[place]

    def _turned_form(self, record: Record, name: str) -> Drawn | None:
        """Return what :meth:`form` returns, which takes a tenth of a second."""
        form = self.form_like_shape(record, name)
        first = _first_pose(record, name)
        if form is None or name == first:
            return form
        target = self.form(record, first)
        return form if target is None else turned_to(form, target)

    def form_like_shape(self, record: RankedShapes, name: str) -> Drawn | None:
        """Return the form of a shape, turned as the shape; None if it is not stored."""
        form = read_form(self.folder, record, name)
        shape = self.shape(record, name)
        if form is None or shape is None:
            return None
        return drawn_form(form, shape)

    def _camera(self, record: RankedShapes, name: str) -> Camera:
        """Return the camera that says which side of a shape is up.

        Without its data, the front is seen.
        """
        shapes = self._data_set(record.data.source)
        if shapes is None:
            return FRONT
        for entry in shapes.shapes:
            if entry.identifier == name:
                return shapes.camera(entry)
        return FRONT

    def _data_set(self, source: str) -> ShapeSet | None:
        """Return a data set; None if it is not here."""
        if source not in self._sets:
            try:
                self._sets[source] = open_dataset(source, self.data_root)
            except (BenchmarkError, OSError):
                self._sets[source] = None
        return self._sets[source]


def _first_pose(record: Record, name: str) -> str:
    """Return the first shape with a result of the class of a shape; itself if none has one."""
    label = record.labels[record.shapes.index(name)]
    for number in record.answered:
        if record.labels[number] == label:
            return record.shapes[number]
    return name


def thumbnail(results: Path, dataset: str, row: str) -> Path:
    """Return the file of the published picture of a form of a row on a data set."""
    name = f"{base_name(dataset)}-{row}"
    return published_folder(results) / "figures" / "rows" / f"{file_name(name)}.webp"


def drawn_form(form: Mesh, shape: Drawn) -> Drawn:
    """Return a form as it is drawn, turned as its shape if both have the same vertices."""
    mesh = centred(form)
    if mesh.vertices.shape == shape.mesh.vertices.shape:
        turn, _ = orthogonal_procrustes(mesh.vertices, shape.mesh.vertices)
        mesh = mesh.with_vertices(mesh.vertices @ turn)
    has_faces_of_shape = np.array_equal(mesh.faces, shape.mesh.faces)
    return Drawn(mesh, shape if has_faces_of_shape else None)


def drawn_from(mesh: Mesh, camera: Camera) -> Drawn:
    """Return a shape as it is drawn: as a camera sees it."""
    return Drawn(centred(mesh.with_vertices(mesh.vertices @ camera.rotation.T)))


def centred(mesh: Mesh) -> Mesh:
    """Centre a surface by area, and scale it to unit root mean square radius."""
    weights = np.maximum(mesh.vertex_areas, 1e-12)  # of a line or point, all vertices count
    points = mesh.vertices - np.average(mesh.vertices, axis=0, weights=weights)
    radius = np.sqrt(np.average((points**2).sum(axis=1), weights=weights))
    return mesh.with_vertices(points / max(float(radius), 1e-12))


def turned_to(form: Drawn, target: Drawn) -> Drawn:
    """Return a form, turned to face as another one does.

    Of all rotations that bring it equally near, the smallest is taken. It is mirrored if that
    brings it clearly nearer.

    Parameters
    ----------
    form, target
        Two centred forms of one subject. Their values, how far each point is from the centre of the
        body, tell a head from a foot.

    Returns
    -------
    Drawn
        The turned form, with its mean distance from the target.
    """
    points = _points_with_values(form)
    targets = _points_with_values(target)
    distances, rotations = alignments(points, targets)
    mirrored_distances, mirrored_rotations = alignments(points * _MIRROR, targets)
    is_mirrored = bool(mirrored_distances.min() < NEARER * distances.min())
    if is_mirrored:
        distances = mirrored_distances
        rotations = -mirrored_rotations
    # Front and back of a body hardly differ. Of all rotations that bring it about as near as the
    # best one, take the smallest: the trace of a rotation falls with its angle.
    near = rotations[NEARER * distances <= distances.min() + 1e-6]
    rotation = near[np.trace(near, axis1=1, axis2=2).argmax()]
    (distance,), _ = _iterate_closest_points(
        form.mesh.vertices, target.mesh.vertices, rotation[None], steps=0
    )
    mesh = form.mesh.with_vertices(form.mesh.vertices @ rotation)
    return Drawn(mesh, form.body, is_mirrored, float(distance))


def _points_with_values(surface: Drawn) -> Points:
    """Return some points and how far each is from the centre of the body, shape (600, 4)."""
    points = np.column_stack([surface.mesh.vertices, surface.values])
    chosen = np.linspace(0, len(points) - 1, _POINTS).astype(int)
    return np.asarray(points[chosen])


def alignments(points: Points, target: Points) -> tuple[NDArray[np.float64], Points]:
    """Return rotations that bring points near a target, and how far apart these remain.

    Principal axes of both are brought together in all ways. Each way is refined by iterative
    closest points, first with some of the points, then the best ways with all of them.

    Parameters
    ----------
    points, target
        Centred points, one a row: three coordinates, then values that do not turn with them.

    Returns
    -------
    distances : numpy.ndarray
        Mean distance to the nearest point, both ways, shape (k,).
    rotations : numpy.ndarray
        Matrices R of ``points @ R``, shape (k, 3, 3).
    """
    starts = _principal_axes(points) @ CUBE_SYMMETRIES @ _principal_axes(target).T
    starts = starts[np.linalg.det(starts) > 0]
    coarse = slice(None, None, max(1, len(points) // _COARSE_POINTS))
    distances, rotations = _iterate_closest_points(
        points[coarse], target[coarse], starts, _COARSE_STEPS
    )
    distinct = rotations[_distinct(distances, rotations)]
    return _iterate_closest_points(points, target, distinct, _STEPS)


def _distinct(distances: NDArray[np.float64], rotations: Points) -> list[int]:
    """Return the numbers of the coarse results that are worth refining, the nearest first."""
    chosen: list[int] = []
    for number in np.argsort(distances, kind="stable")[:_REFINED].tolist():
        is_far = distances[number] > _FAR * distances.min()
        apart = np.abs(rotations[chosen] - rotations[number]).max(axis=(1, 2))
        if not is_far and (apart > _SAME_ROTATION).all():
            chosen.append(number)
    return chosen


def _principal_axes(points: Points) -> Points:
    """Return the principal axes of centred points as columns, shape (3, 3)."""
    positions = points[:, :3]
    axes, _, _ = np.linalg.svd(positions.T @ positions)
    return np.asarray(axes)


def _iterate_closest_points(
    points: Points, target: Points, rotations: Points, steps: int
) -> tuple[NDArray[np.float64], Points]:
    """Refine rotations by iterative closest points (ICP), with matches in both directions.

    Parameters
    ----------
    points, target
        Points of two surfaces, one a row: coordinates in the first three columns; in others, values
        that do not turn, and that matching points share.
    rotations
        Matrices R of ``points @ R`` to start from, shape (k, 3, 3).
    steps
        Number of steps; 0 only measures the distances.

    Returns
    -------
    distances : numpy.ndarray
        Mean distance to the nearest point, both ways, after each rotation, shape (k,).
    rotations : numpy.ndarray
        The refined rotations, shape (k, 3, 3).
    """
    tree = cKDTree(points)
    target_tree = cKDTree(target)
    rotations = rotations.copy()
    moving = np.arange(len(rotations))
    for _ in range(steps):
        before = rotations[moving]
        _, in_target = target_tree.query(_rotated(points, before))
        _, in_points = tree.query(_rotated(target, before.transpose(0, 2, 1)))
        after = _best_rotations(points[:, :3], target[:, :3], in_target, in_points)
        rotations[moving] = after
        # Where a step changes nothing, neither would a further one.
        moving = moving[(after != before).any(axis=(1, 2))]
        if not len(moving):
            break
    to_target, _ = target_tree.query(_rotated(points, rotations))
    to_points, _ = tree.query(_rotated(target, rotations.transpose(0, 2, 1)))
    return (to_target.mean(axis=1) + to_points.mean(axis=1)) / 2, rotations


def _best_rotations(
    points: Points, target: Points, in_target: NDArray[np.int64], in_points: NDArray[np.int64]
) -> Points:
    """Return the rotations R that bring ``points @ R`` nearest to their matches (Kabsch 1976).

    Parameters
    ----------
    points, target
        Coordinates, shapes (n, 3) and (m, 3).
    in_target
        The match of each point in the target, for each of k rotations, shape (k, n).
    in_points
        The match of each point of the target, shape (k, m).
    """
    covariances = points.T @ target[in_target] + points[in_points].transpose(0, 2, 1) @ target
    left, _, right = np.linalg.svd(covariances)
    # A product of determinant -1 is a mirror image: turn its least certain axis round.
    left[..., 2] *= np.linalg.det(left @ right)[:, None]
    return np.asarray(left @ right)


def _rotated(points: Points, rotations: Points) -> Points:
    """Return points after each rotation, shape (k, n, 3 or more); what is no position stays."""
    n_others = points.shape[1] - 3
    others = np.broadcast_to(points[:, 3:], (len(rotations), len(points), n_others))
    return np.concatenate([points[:, :3] @ rotations, others], axis=2)
