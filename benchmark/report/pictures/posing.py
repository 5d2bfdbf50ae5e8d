"""Orientation of forms for comparison by eye: head up, as its shape stands, all poses alike."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmark.geometry.mesh import Mesh, Points

#: Share of the size of a shape by which a form may differ from it that is the shape itself, turned.
_SAME = 1e-3

#: Points of a form that are compared; more tell no more of how it is turned.
_COMPARED = 300

_ROUNDS = 10

#: How much farther from the model than the best turn another one may be that fits it nearly alike.
_ALIKE = 1.6

#: Share of the vertices that a picture may cut off on each side: forms with a few far points are no specks.
_CUT_OFF = 0.002


def centred(points: Points) -> Points:
    """The points around the middle of their extent, a few far ones aside; shape (n, 3)."""
    low, high = np.quantile(points, [_CUT_OFF, 1 - _CUT_OFF], axis=0)
    return np.asarray(points - (low + high) / 2)


def reach(points: Points) -> float:
    """Half the width of a picture that shows centred points, a few far ones aside."""
    return max(float(np.quantile(np.abs(points[:, :2]), 1 - _CUT_OFF, axis=0).max()), 1e-12)


def turn_onto(points: Points, target: Points) -> tuple[NDArray[np.float64], float]:
    """The turn, or turn and reflection, that brings points onto others of the same number.

    A form of distances alone is as good as its mirror image, so a reflection is no change of it.

    Returns
    -------
    numpy.ndarray
        Shape (3, 3), orthogonal; turned points are ``points @ turn``.
    float
        What remains between them when both have one size, as a share of that size.

    References
    ----------
    Schönemann, "A generalized solution of the orthogonal Procrustes problem", 1966.
    """
    here, there = points - points.mean(axis=0), target - target.mean(axis=0)
    here, there = here / max(np.linalg.norm(here), 1e-12), there / max(np.linalg.norm(there), 1e-12)
    left, _, right = np.linalg.svd(here.T @ there)
    turn = np.asarray(left @ right)
    return turn, float(np.linalg.norm(here @ turn - there))


def turn_like(points: Points, model: Points, hint: NDArray[np.float64]) -> NDArray[np.float64]:
    """The turn, or turn and reflection, that makes a form look like another of the same subject.

    The principal axes of both are laid onto each other in all ways. A body is nearly its own mirror image, so several
    may fit nearly alike: of these the one that is closest to the hint counts. It is then improved by closest points.

    Parameters
    ----------
    points, model
        Two forms, shape (n, 3) and (m, 3).
    hint
        The turn that the shape of the form suggests, shape (3, 3).

    Returns
    -------
    numpy.ndarray
        Shape (3, 3), orthogonal; turned points are ``points @ turn``.
    """
    here, there = _sample(points), _sample(model)
    tree = cKDTree(there)
    axes_here, axes_there = (np.linalg.svd(each, full_matrices=False)[2] for each in (here, there))
    starts = [
        hint,
        *(axes_here.T @ (np.array(signs)[:, None] * axes_there) for signs in product((1.0, -1.0), repeat=3)),
    ]
    away = [_distance(here @ turn, there, tree) for turn in starts]
    alike = [turn for turn, distance in zip(starts, away, strict=True) if distance <= _ALIKE * min(away)]
    best = max(alike, key=lambda turn: round(float(np.trace(turn.T @ hint)), 6))
    for _ in range(_ROUNDS):
        best = turn_onto(here, there[tree.query(here @ best)[1]])[0]
    return np.asarray(best)


def upright(form: Mesh, surface: Mesh, seen: Points, model: Points | None) -> Points:
    """Vertices of a form as they are shown beside its shape.

    Parameters
    ----------
    form
        The form.
    surface
        The shape that it was made of.
    seen
        Vertices of the shape as its camera sees them: to the right, up, towards the viewer.
    model
        A form by the same method of another pose of the same subject, as it is shown; None if there is none yet.
    """
    points = form.vertices
    if form.faces.shape != surface.faces.shape or (form.faces != surface.faces).any():
        return points  # a surface of its own, made as a camera sees it
    own, left = turn_onto(points, seen)
    if model is None or left < _SAME:
        return np.asarray(points @ own)
    return np.asarray(points @ turn_like(points, model, own))


def _distance(points: Points, model: Points, tree: cKDTree) -> float:
    """Mean distance to the closest point, in both directions: neither may leave a part of the other empty."""
    return float(tree.query(points)[0].mean() + cKDTree(points).query(model)[0].mean())


def _sample(points: Points) -> Points:
    """Some of the points, around their mean and of one size."""
    chosen = points[np.unique(np.linspace(0, len(points) - 1, _COMPARED).astype(int))]
    around = chosen - chosen.mean(axis=0)
    return np.asarray(around / max(np.sqrt((around**2).sum(axis=1).mean()), 1e-12))
