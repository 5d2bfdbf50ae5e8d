"""How a form is turned so that it can be compared by eye: head up, as its shape stands, all poses alike."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmark.geometry.mesh import Points

#: Share of the size of a shape by which a form may differ from it that is the shape itself, turned.
_SAME = 1e-3

#: Points of a form that are compared; more tell no more of how it is turned.
_COMPARED = 300

_ROUNDS = 10

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
    turn = left @ right
    return turn, float(np.linalg.norm(here @ turn - there))


def is_itself(points: Points, target: Points) -> bool:
    """Whether a form is the shape itself, turned at most."""
    return points.shape == target.shape and turn_onto(points, target)[1] < _SAME


def turn_like(points: Points, model: Points) -> NDArray[np.float64]:
    """The turn, or turn and reflection, that makes a form look like another of the same subject.

    The principal axes of both are laid onto each other in all ways, and the closest one is improved by closest points.

    Parameters
    ----------
    points, model
        Two forms, shape (n, 3) and (m, 3).

    Returns
    -------
    numpy.ndarray
        Shape (3, 3), orthogonal; turned points are ``points @ turn``.
    """
    here, there = _sample(points), _sample(model)
    tree = cKDTree(there)
    axes_here, axes_there = (np.linalg.svd(each, full_matrices=False)[2] for each in (here, there))
    starts = [axes_here.T @ (np.array(signs)[:, None] * axes_there) for signs in product((1.0, -1.0), repeat=3)]
    best = min(starts, key=lambda turn: round(float(_distance(here @ turn, there, tree)), 9))
    for _ in range(_ROUNDS):
        best = turn_onto(here, there[tree.query(here @ best)[1]])[0]
    return best


def _distance(points: Points, model: Points, tree: cKDTree) -> float:
    """Mean distance to the closest point, in both directions: neither may leave a part of the other empty."""
    return float(tree.query(points)[0].mean() + cKDTree(points).query(model)[0].mean())


def _sample(points: Points) -> Points:
    """Some of the points, around their mean and of one size."""
    chosen = points[np.unique(np.linspace(0, len(points) - 1, _COMPARED).astype(int))]
    around = chosen - chosen.mean(axis=0)
    return np.asarray(around / max(np.sqrt((around**2).sum(axis=1).mean()), 1e-12))
