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

#: Points of a surface that the parts of an alignment use: all starts, the best, the very best.
_COARSE_POINTS = 60
_POINTS = 200
_FINE_POINTS = 400

#: Steps of iterative closest points in each part; after the first ones, most starts are left out.
_FIRST_STEPS = 2
_COARSE_STEPS = 3
_STEPS = 6
_FINE_STEPS = 5

#: Rotations, and as many mirror images, that are left after the first steps.
_LEFT = 8

#: Coarse results of rotations, and as many of mirror images, that are refined, at most.
_REFINED = 4

#: A coarse result is not refined if it is farther than the best by this factor.
_FAR = 1.5

#: Two coarse results whose rotations differ by no more lead to the same.
_SAME_ROTATION = 0.02


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
    target
        The form of the first pose, if it was turned to that.
    """

    mesh: Mesh
    body: Drawn | None = None
    is_mirrored: bool = False
    target: Drawn | None = None

    @cached_property
    def values(self) -> NDArray[np.float64]:
        """How far each vertex is from the centre of the body."""
        if self.body:
            return self.body.values
        return outwardness(self.mesh)

    @cached_property
    def apart(self) -> float | None:
        """Mean distance of its vertices from those of its target, both ways; None without one."""
        if self.target is None:
            return None
        to_target, _ = self.target.tree.query(self.mesh.vertices)
        to_form, _ = self.tree.query(self.target.mesh.vertices)
        return float(to_target.mean() + to_form.mean()) / 2

    @cached_property
    def tree(self) -> cKDTree:
        """Its vertices, to search for the nearest."""
        return cKDTree(self.mesh.vertices)

    @cached_property
    def samples(self) -> Points:
        """Some points, and how far each is from the centre of the body, shape (400, 4)."""
        points = np.column_stack([self.mesh.vertices, self.values])
        chosen = np.linspace(0, len(points) - 1, _FINE_POINTS).astype(int)
        return np.asarray(points[chosen])


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
        shapes = self._data_set(record.data.path or record.data.source)
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
    """Return a form, turned so that it lies as near as possible to another one.

    It is mirrored if that brings it clearly nearer.

    Parameters
    ----------
    form, target
        Two centred forms of one subject. Their values, how far each point is from the centre of the
        body, tell a head from a foot.
    """
    distances, rotations = alignments(form.samples, target.samples, with_mirror_images=True)
    mirrors = np.linalg.det(rotations) < 0
    nearest = distances[~mirrors].min()
    nearest_mirrored = distances.min(where=mirrors, initial=np.inf)
    is_mirrored = bool(nearest_mirrored < NEARER * nearest)
    distances = distances[mirrors == is_mirrored]
    rotations = rotations[mirrors == is_mirrored]
    # Front and back of a body hardly differ. Of all rotations that bring it about as near as the
    # best one, take the one by the smallest angle: it has the largest trace.
    near = rotations[NEARER * distances <= distances.min() + 1e-6]
    smallest = near[np.trace(near, axis1=1, axis2=2).argmax()]
    (rotation,) = _iterate_closest_points(form.samples, target.samples, smallest[None], _FINE_STEPS)
    mesh = form.mesh.with_vertices(form.mesh.vertices @ rotation)
    return Drawn(mesh, form.body, is_mirrored, target)


def alignments(
    points: Points, target: Points, *, with_mirror_images: bool = False
) -> tuple[NDArray[np.float64], Points]:
    """Return rotations that bring points near a target, and how far apart these remain.

    Principal axes of both are brought together in all ways. Each way is refined by iterative
    closest points, first with few of the points, then the best ways with more of them.

    Parameters
    ----------
    points, target
        Centred points, one a row: three coordinates, then values that do not turn with them.
    with_mirror_images
        Whether to return mirror images, too, of which a coarse result is nearer than that of every
        rotation.

    Returns
    -------
    distances : numpy.ndarray
        Mean distance to the nearest point, both ways, shape (k,).
    rotations : numpy.ndarray
        Matrices R of ``points @ R``, shape (k, 3, 3); those of determinant -1 are mirror images.
    """
    starts = _principal_axes(points) @ CUBE_SYMMETRIES @ _principal_axes(target).T
    if not with_mirror_images:
        starts = starts[np.linalg.det(starts) > 0]
    some = _thinned(points, _COARSE_POINTS)
    some_of_target = _thinned(target, _COARSE_POINTS)
    first = _iterate_closest_points(some, some_of_target, starts, _FIRST_STEPS)
    left = first[_nearest_of_both_hands(_distances(some, some_of_target, first), first)]
    coarse = _iterate_closest_points(some, some_of_target, left, _COARSE_STEPS)
    promising = coarse[_promising(_distances(some, some_of_target, coarse), coarse)]
    rotations = _iterate_closest_points(
        _thinned(points, _POINTS), _thinned(target, _POINTS), promising, _STEPS
    )
    return _distances(points, target, rotations), rotations


def _thinned(points: Points, n_points: int) -> Points:
    """Return every k-th point, so that about so many are left."""
    return points[:: max(1, len(points) // n_points)]


def _nearest_of_both_hands(distances: NDArray[np.float64], rotations: Points) -> NDArray[np.intp]:
    """Return the numbers of the nearest rotations, and of the nearest mirror images."""
    order = np.argsort(distances, kind="stable")
    mirrors = np.linalg.det(rotations[order]) < 0
    return np.concatenate([order[~mirrors][:_LEFT], order[mirrors][:_LEFT]])


def _promising(distances: NDArray[np.float64], rotations: Points) -> list[int]:
    """Return the numbers of the coarse results that are worth refining, the nearest first.

    These are the best rotations, and the best of those mirror images that come nearer than all of
    them.
    """
    mirrors = np.linalg.det(rotations) < 0
    nearest = distances[~mirrors].min()
    return [
        *_distinct(distances, rotations, ~mirrors),
        *_distinct(distances, rotations, mirrors & (distances < nearest)),
    ]


def _distinct(
    distances: NDArray[np.float64], rotations: Points, candidates: NDArray[np.bool_]
) -> list[int]:
    """Return the numbers of the nearest candidates, without those that lead to the same.

    Parameters
    ----------
    distances, rotations
        Coarse results.
    candidates
        Which of them are meant.
    """
    chosen: list[int] = []
    farthest = _FAR * distances.min(where=candidates, initial=np.inf)
    order = np.argsort(distances, kind="stable")
    for number in order[candidates[order]][:_REFINED].tolist():
        apart = np.abs(rotations[chosen] - rotations[number]).max(axis=(1, 2))
        if distances[number] <= farthest and (apart > _SAME_ROTATION).all():
            chosen.append(number)
    return chosen


def _principal_axes(points: Points) -> Points:
    """Return the principal axes of centred points as columns, shape (3, 3)."""
    positions = points[:, :3]
    axes, _, _ = np.linalg.svd(positions.T @ positions)
    return np.asarray(axes)


def _iterate_closest_points(
    points: Points, target: Points, rotations: Points, steps: int
) -> Points:
    """Refine rotations by iterative closest points (ICP), with matches in both directions.

    A mirror image stays one.

    Parameters
    ----------
    points, target
        Points of two surfaces, one a row: coordinates in the first three columns; in others, values
        that do not turn, and that matching points share.
    rotations
        Matrices R of ``points @ R`` to start from, shape (k, 3, 3).
    steps
        Number of steps.

    Returns
    -------
    numpy.ndarray
        The refined rotations, shape (k, 3, 3).
    """
    rotations = rotations.copy()
    moving = np.arange(len(rotations))
    for _ in range(steps):
        before = rotations[moving]
        in_target, in_points = _matches(points, target, before)
        after = _best_rotations(points[:, :3], target[:, :3], in_target, in_points, before)
        rotations[moving] = after
        # Where a step changes nothing, neither would a further one.
        moving = moving[(after != before).any(axis=(1, 2))]
        if not len(moving):
            break
    return rotations


def _distances(points: Points, target: Points, rotations: Points) -> NDArray[np.float64]:
    """Return the mean distance to the nearest point, both ways, after each rotation, shape (k,)."""
    in_target, in_points = _matches(points, target, rotations)
    to_target = np.linalg.norm(_rotated(points, rotations) - target[in_target], axis=2)
    back = rotations.transpose(0, 2, 1)
    to_points = np.linalg.norm(_rotated(target, back) - points[in_points], axis=2)
    return np.asarray(to_target.mean(axis=1) + to_points.mean(axis=1)) / 2


def _matches(
    points: Points, target: Points, rotations: Points
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the nearest points of two surfaces after each of some rotations.

    For some hundred points, products of matrices are faster than a search tree, and single
    precision will do.

    Parameters
    ----------
    points, target
        Coordinates and values, shapes (n, d) and (m, d).
    rotations
        Rotations of the points, shape (k, 3, 3).

    Returns
    -------
    in_target : numpy.ndarray
        Number of the nearest point of the target of each point, shape (k, n).
    in_points : numpy.ndarray
        Number of the nearest point of each point of the target, shape (k, m).
    """
    rotated = _rotated(points, rotations)
    # Of half the squared distance |p - t|^2 / 2, the nearest t of a p minimises |t|^2 / 2 - p t.
    to_target = (
        _with_column(rotated, np.ones(len(points))) @ _with_column(target, -_half_squares(target)).T
    )
    to_points = _with_column(target, np.ones(len(target))) @ _with_column(
        rotated, -_half_squares(points)
    ).transpose(0, 2, 1)
    return to_target.argmax(axis=2), to_points.argmax(axis=2)


def _half_squares(points: Points) -> NDArray[np.float64]:
    """Return half the squared length of each row, which no rotation changes."""
    return np.asarray((points**2).sum(axis=1) / 2)


def _with_column(points: Points, column: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return points with one more coordinate, in single precision."""
    columns = np.broadcast_to(column[:, None], (*points.shape[:-1], 1))
    return np.concatenate([points, columns], axis=-1, dtype=np.float32)


def _best_rotations(
    points: Points,
    target: Points,
    in_target: NDArray[np.intp],
    in_points: NDArray[np.intp],
    before: Points,
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
    before
        The rotations by which matches were found, shape (k, 3, 3). What is found instead of a
        mirror image is one, too.
    """
    covariances = points.T @ target[in_target] + points[in_points].transpose(0, 2, 1) @ target
    left, _, right = np.linalg.svd(covariances)
    # If the product has the other determinant, turn its least certain axis round.
    is_other = np.linalg.det(left @ right) * np.linalg.det(before) < 0
    left[is_other, :, 2] *= -1
    return np.asarray(left @ right)


def _rotated(points: Points, rotations: Points) -> Points:
    """Return points after each rotation, shape (k, n, 3 or more); what is no position stays."""
    n_others = points.shape[1] - 3
    others = np.broadcast_to(points[:, 3:], (len(rotations), len(points), n_others))
    return np.concatenate([points[:, :3] @ rotations, others], axis=2)
