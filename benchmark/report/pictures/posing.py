"""Choice of the shapes that a picture shows, and their orientation: head up, as the shape stands, all poses alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmark.datasets.base import Dataset, Entry
from benchmark.geometry.mesh import Mesh, Points
from benchmark.pipeline.storage.records import Record
from benchmark.report.artefact_reader import ArtefactReader

T = TypeVar("T")

#: Name of the shape itself among its forms.
SHAPE = ""

#: Share of all classes in all poses that a data set must hold for the names of its poses to mean the same pose.
_SAME_POSES = 0.9

#: Largest difference between a form and its shape, as a share of their size, at which the form is the shape turned.
_SAME = 1e-3

#: Points of a form that are compared; more say no more about its orientation.
_COMPARED = 300

_ROUNDS = 10

#: Ratio of distances up to which two orientations fit the model alike.
_ALIKE = 1.6

#: Share of the vertices that a picture may cut off on each side: forms with a few far points are no specks.
_CUT_OFF = 0.002


def spread(values: Sequence[T], most: int) -> list[T]:
    """Return so many of the values, evenly spread, the first and the last among them."""
    places = np.unique(np.linspace(0, max(len(values) - 1, 0), min(most, len(values))).astype(int))
    return [values[place] for place in places.tolist()]


def select(
    dataset: Dataset, entries: Iterable[Entry], n_subjects: int | None = None, n_poses: int = 8
) -> list[list[Entry]]:
    """Choose shapes spread over the subjects, and over the poses of each.

    Parameters
    ----------
    dataset
        Names canonical poses, if it has any.
    entries
        The shapes to choose from.
    n_subjects
        Subjects; None for all.
    n_poses
        Shapes of each subject.

    Returns
    -------
    list of list of Entry
        A row for each subject, in the order of the entries; the canonical pose leads.
    """
    canonical = getattr(dataset, "canonical_poses", {})
    subjects: dict[str, list[Entry]] = {}
    for entry in entries:
        subjects.setdefault(entry.subject, []).append(entry)
    rows = [
        sorted(members, key=lambda entry: entry.pose != canonical.get(entry.subject)) for members in subjects.values()
    ]
    return [spread(row, n_poses) for row in spread(rows, n_subjects or len(rows))]


def have_same_poses(entries: Sequence[Entry]) -> bool:
    """Return whether the classes take the same poses: merely numbered ones differ in number from class to class."""
    poses, subjects = {entry.pose for entry in entries}, {entry.subject for entry in entries}
    return len(entries) >= _SAME_POSES * len(poses) * len(subjects)


def centred(points: Points) -> Points:
    """The points around the middle of their extent, a few far ones aside; shape (n, 3)."""
    low, high = np.quantile(points, [_CUT_OFF, 1 - _CUT_OFF], axis=0)
    return np.asarray(points - (low + high) / 2)


def reach(points: Points) -> float:
    """Half the width of a picture that shows centred points, a few far ones aside."""
    return max(float(np.quantile(np.abs(points[:, :2]), 1 - _CUT_OFF, axis=0).max()), 1e-12)


def turn_onto(points: Points, target: Points) -> tuple[NDArray[np.float64], float]:
    """Turn points, reflected if need be, onto others of the same number [Schönemann 1966].

    Returns
    -------
    numpy.ndarray
        Shape (3, 3), orthogonal; turned points are ``points @ turn``.
    float
        What remains between them when both have one size, as a share of that size.
    """
    here, there = points - points.mean(axis=0), target - target.mean(axis=0)
    here, there = here / max(np.linalg.norm(here), 1e-12), there / max(np.linalg.norm(there), 1e-12)
    left, _, right = np.linalg.svd(here.T @ there)
    turn = np.asarray(left @ right)
    return turn, float(np.linalg.norm(here @ turn - there))


def upright(form: Mesh, surface: Mesh, seen: Points, model: Points | None) -> Points:
    """Vertices of a form as they are shown beside its shape.

    Parameters
    ----------
    form, surface
        The form, and the shape that it was made of.
    seen
        Vertices of the shape as its camera sees them: to the right, up, towards the viewer.
    model
        A form by the same method of another pose of the same subject, as it is shown; None if there is none yet.
    """
    points = form.vertices
    if not np.array_equal(form.faces, surface.faces):
        return points  # a surface of its own, made as a camera sees it
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
    """Return a shape as its camera sees it, by the name "", and its form by each method, or why there is none.

    Parameters
    ----------
    entry
        The shape.
    record
        A record of its gallery under one input.
    records
        Those of the methods whose forms are wanted.
    artefacts
        Where surfaces and forms are.
    models
        The first form of each method, by which those of other poses are turned; filled here.
    """
    surface = artefacts.surface(record, entry)
    forms = {method: artefacts.form(each, entry, surface) for method, each in records.items()}
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
    """Turn a form so that it looks like another of the same subject.

    Their principal axes are laid onto each other in all ways. A body is nearly its own mirror image, so several may fit
    nearly alike: the one closest to the hint, which its shape gives, is improved by closest points.
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
    """Some of the points, around their mean and of one size."""
    chosen = points[spread(range(len(points)), _COMPARED)]
    around = chosen - chosen.mean(axis=0)
    return np.asarray(around / max(np.sqrt((around**2).sum(axis=1).mean()), 1e-12))
