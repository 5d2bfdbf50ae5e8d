"""Select the shapes for a picture and orient their forms: upright like the shape, and aligned in all poses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.geometry.mesh import Mesh, Points
from benchmark.pipeline.storage.records import Record
from benchmark.report.artefact_reader import ArtefactReader

T = TypeVar("T")

#: Name of the shape itself among its forms.
SHAPE = ""

#: Minimum fraction of combinations of class and pose that exist in a data set with comparable names of poses.
_SAME_POSES = 0.9

#: Largest relative difference at which a form counts as the rotated shape.
_SAME = 1e-3

#: Number of points of a form to compare, enough for its orientation.
_COMPARED = 300

_ROUNDS = 10

#: Ratio of distances up to which two orientations fit equally well.
_ALIKE = 1.6

#: Fraction of the vertices that may be cut off on each side, so that outliers do not shrink a form.
_CUT_OFF = 0.002


def spread(values: Sequence[T], most: int) -> list[T]:
    """Return at most ``most`` evenly spaced values, including the first and the last."""
    places = np.unique(np.linspace(0, max(len(values) - 1, 0), min(most, len(values))).astype(int))
    return [values[place] for place in places.tolist()]


def select(
    dataset: ShapeSet, entries: Iterable[Entry], n_subjects: int | None = None, n_poses: int = 8
) -> list[list[Entry]]:
    """Select shapes spread over the subjects and over the poses of each.

    Parameters
    ----------
    dataset
        Data set, with the names of canonical poses, if any.
    entries
        The available shapes.
    n_subjects
        Number of subjects; None for all.
    n_poses
        Number of shapes of each subject.

    Returns
    -------
    list of list of Entry
        A row for each subject in the order of the entries, with the canonical pose first.
    """
    canonical = dataset.canonical_poses
    subjects: dict[str, list[Entry]] = {}
    for entry in entries:
        subjects.setdefault(entry.subject, []).append(entry)
    rows = [
        sorted(members, key=lambda entry: entry.pose != canonical.get(entry.subject)) for members in subjects.values()
    ]
    return [spread(row, n_poses) for row in spread(rows, n_subjects or len(rows))]


def have_same_poses(entries: Sequence[Entry]) -> bool:
    """Return whether all classes have the same poses; poses that are only numbered differ between classes."""
    poses, subjects = {entry.pose for entry in entries}, {entry.subject for entry in entries}
    return len(entries) >= _SAME_POSES * len(poses) * len(subjects)


def centred(points: Points) -> Points:
    """Centre points on the middle of their extent, ignoring outliers; shape (n, 3)."""
    low, high = np.quantile(points, [_CUT_OFF, 1 - _CUT_OFF], axis=0)
    return np.asarray(points - (low + high) / 2)


def reach(points: Points) -> float:
    """Return half the width of a picture of centred points, ignoring outliers."""
    return max(float(np.quantile(np.abs(points[:, :2]), 1 - _CUT_OFF, axis=0).max()), 1e-12)


def turn_onto(points: Points, target: Points) -> tuple[NDArray[np.float64], float]:
    """Compute the rotation (or rotoreflection) that aligns points with corresponding ones [Schönemann 1966].

    Returns
    -------
    numpy.ndarray
        Orthogonal matrix, shape (3, 3); the rotated points are ``points @ turn``.
    float
        Remaining distance after scaling to the same size, relative to that size.
    """
    moving, fixed = points - points.mean(axis=0), target - target.mean(axis=0)
    moving, fixed = moving / max(np.linalg.norm(moving), 1e-12), fixed / max(np.linalg.norm(fixed), 1e-12)
    left, _, right = np.linalg.svd(moving.T @ fixed)
    turn = np.asarray(left @ right)
    return turn, float(np.linalg.norm(moving @ turn - fixed))


def upright(form: Mesh, surface: Mesh, seen: Points, model: Points | None) -> Points:
    """Return the vertices of a form, oriented for display next to its shape.

    Parameters
    ----------
    form, surface
        The form, and its shape.
    seen
        Vertices of the shape in camera coordinates: right, up, towards the viewer.
    model
        An oriented form of another pose of the same subject by the same method; None if there is none yet.
    """
    points = form.vertices
    if not np.array_equal(form.faces, surface.faces):
        return points  # a new surface, already in camera coordinates
    turn, remainder = turn_onto(points, seen)
    if model is not None and remainder >= _SAME:
        turn = _turn_like(_sample(points), _sample(model), turn)
    return np.asarray(points @ turn)


def posed(
    entry: Entry,
    record: Record,
    records: Mapping[str, Record],
    artefacts: ArtefactReader,
    models: dict[str, Points],
) -> dict[str, Mesh | str]:
    """Return a shape in camera coordinates under the name "", and its form by each method, or why there is none.

    Parameters
    ----------
    entry
        The shape.
    record
        A record of its gallery for the input.
    records
        Records of the methods whose forms are shown.
    artefacts
        Reader of surfaces and forms.
    models
        First form of each method, to which forms of other poses are aligned; updated in place.
    """
    surface = artefacts.surface(record, entry)
    forms = {method: artefacts.form(record, entry, surface) for method, record in records.items()}
    if surface is None:
        return {SHAPE: next((form for form in forms.values() if isinstance(form, str)), ""), **forms}
    seen = artefacts.seen(record, entry, surface)
    meshes: dict[str, Mesh | str] = {SHAPE: surface.with_vertices(centred(seen))}
    for method, form in forms.items():
        if isinstance(form, Mesh):
            points = centred(upright(form, surface, seen, models.get(method)))
            models.setdefault(method, points)
            form = form.with_vertices(points)
        meshes[method] = form
    return meshes


def _turn_like(points: Points, model: Points, hint: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the orthogonal matrix that aligns a form with another one of the same subject.

    All alignments of the principal axes are tried. Since a body is nearly mirror-symmetric, several may fit almost
    equally well; the one closest to a hint, which comes from the shape, is refined by iterative closest points.
    """
    tree = cKDTree(model)

    def distance(turn: NDArray[np.float64]) -> float:
        turned = points @ turn
        return float(tree.query(turned)[0].mean() + cKDTree(turned).query(model)[0].mean())

    axes, onto = (np.linalg.svd(form, full_matrices=False)[2] for form in (points, model))
    turns = [hint, *(axes.T @ (np.array(signs)[:, None] * onto) for signs in product((1.0, -1.0), repeat=3))]
    distances = [distance(turn) for turn in turns]
    alike = [turn for turn, away in zip(turns, distances, strict=True) if away <= _ALIKE * min(distances)]
    best = max(alike, key=lambda turn: round(float(np.trace(turn.T @ hint)), 6))
    for _ in range(_ROUNDS):
        best = turn_onto(points, model[tree.query(points @ best)[1]])[0]
    return np.asarray(best)


def _sample(points: Points) -> Points:
    """Return some of the points, centred and scaled to a fixed size."""
    chosen = points[spread(range(len(points)), _COMPARED)]
    around = chosen - chosen.mean(axis=0)
    return np.asarray(around / max(np.sqrt((around**2).sum(axis=1).mean()), 1e-12))
