"""Rigid parts of a surface: their division, their motions, and the closing of their seams."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from baselines._kernels.arap import AsRigidAsPossible, nearest_rotation
from baselines._kernels.orientation import TIE
from benchmark.api.contracts import FloatArray

CLEARER = 1e-6
"""A vertex changes its part if that lowers the squared distance to its target by more than this share of the surface
area; no rounding error does."""


def nearest_seed(distances: FloatArray) -> NDArray[np.int64]:
    """Return the part of each vertex: that of the nearest seed, or of the first of equally near ones.

    Parameters
    ----------
    distances
        Distances from each seed to all vertices, shape (k, n).

    Returns
    -------
    numpy.ndarray
        Shape (n,), from 0 without gaps: a seed at the position of an earlier one has no part.
    """
    nearest = (distances <= distances.min(axis=0) + TIE * distances.max()).argmax(axis=0)
    return np.asarray(np.unique(nearest, return_inverse=True)[1].reshape(-1), dtype=np.int64)


def rigid_motions(
    surface: AsRigidAsPossible, targets: FloatArray, masses: FloatArray, parts: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """Compute the rotation and translation of each part that bring its vertices nearest to their targets (Kabsch 1976).

    The neighbours of a part count as its own, so that neighbouring parts agree on their seam and not even a part of a
    single vertex can rotate freely.

    Parameters
    ----------
    surface
        Rest positions and edges.
    targets
        Positions, shape (n, 3).
    masses
        Weight of each vertex, shape (n,), positive.
    parts
        Part of each vertex, shape (n,), from 0 to k - 1, none empty.

    Returns
    -------
    rotations : numpy.ndarray
        Proper, shape (k, 3, 3).
    translations : numpy.ndarray
        Shape (k, 3): a vertex p of part c moves to ``rotations[c] @ p + translations[c]``.
    """
    count = int(parts.max()) + 1
    rotations, translations = np.empty((count, 3, 3)), np.empty((count, 3))
    rest = surface.rest
    for part in range(count):
        members = parts == part
        members |= surface.weights @ members.astype(np.float64) > 0
        weights = masses[members] / masses[members].sum()
        centre, goal = weights @ rest[members], weights @ targets[members]
        nearest_rotation(((rest[members] - centre) * weights[:, None]).T @ (targets[members] - goal), rotations[part])
        translations[part] = goal - rotations[part] @ centre
    return rotations, translations


def refit_parts(
    surface: AsRigidAsPossible,
    targets: FloatArray,
    masses: FloatArray,
    parts: NDArray[np.int64],
    rounds: int,
) -> NDArray[np.int64]:
    """Shift the seams, vertex by vertex, so that the parts fit the targets better.

    In each round every vertex at a seam joins the part of a neighbour whose rigid motion brings it nearest to its
    target. Vertices of a part that would keep fewer than half of its initial vertices stay, and no part becomes empty.
    """
    graph = surface.weights
    start = np.repeat(np.arange(len(parts)), np.diff(graph.indptr))
    least = np.maximum(np.bincount(parts) // 2, 1)
    threshold = CLEARER * masses.sum()
    for _ in range(rounds):
        rotations, translations = rigid_motions(surface, targets, masses, parts)
        moved = np.einsum("kab,nb->kna", rotations, surface.rest) + translations[:, None]
        misses = ((moved - targets) ** 2).sum(axis=2)
        offered = np.full(misses.shape, np.inf)
        offered[parts[graph.indices], start] = misses[parts[graph.indices], start]
        own = misses[parts, np.arange(len(parts))]
        best = offered.min(axis=0)
        nearest = (offered <= best + threshold).argmax(axis=0)
        changed = np.where(best < own - threshold, nearest, parts)
        losing = np.bincount(changed, minlength=len(least)) < least
        while losing.any():  # returning vertices may empty the parts that they had joined
            changed = np.where(losing[parts], parts, changed)
            losing = np.bincount(changed, minlength=len(least)) == 0
        if (changed == parts).all():
            break
        parts = changed
    return parts


def close_gaps(
    surface: AsRigidAsPossible,
    masses: FloatArray,
    parts: NDArray[np.int64],
    rotations: FloatArray,
    translations: FloatArray,
) -> FloatArray:
    r"""Translate the parts, without rotation, so that they meet at their seams.

    With the edges (i, j) of the seams, of weights w, and the share :math:`\alpha_c` of part c in the area,

    .. math:: \min_t \sum_c \alpha_c \|t_c - t^0_c\|^2
              + \sum_{ij} w_{ij} \| R_c p_i + t_c - R_d p_j - t_d - \tfrac12 (R_c + R_d)(p_i - p_j) \|^2 .

    Parameters
    ----------
    surface, masses, parts
        As in :func:`refit_parts`.
    rotations, translations
        Motions :math:`R, t^0` of the parts.

    Returns
    -------
    numpy.ndarray
        New translations, shape (k, 3).
    """
    graph = surface.weights
    start, end = np.repeat(np.arange(len(parts)), np.diff(graph.indptr)), graph.indices
    seam = (parts[start] != parts[end]) & (start < end)
    start, end, weights = start[seam], end[seam], graph.data[seam]
    first, second = parts[start], parts[end]
    # The gap is R_c m + t_c - R_d m - t_d at the middle m of the edge.
    middles = (surface.rest[start] + surface.rest[end]) / 2
    gaps = np.einsum("eab,eb->ea", rotations[second] - rotations[first], middles)
    system = np.diag(np.bincount(parts, masses) / masses.sum())
    right = system @ translations
    np.add.at(system, (first, first), weights)
    np.add.at(system, (second, second), weights)
    np.add.at(system, (first, second), -weights)
    np.add.at(system, (second, first), -weights)
    np.add.at(right, first, weights[:, None] * gaps)
    np.add.at(right, second, -weights[:, None] * gaps)
    return np.asarray(np.linalg.solve(system, right))


def smooth_seams(
    surface: AsRigidAsPossible, masses: FloatArray, placed: FloatArray, turns: FloatArray, width: float
) -> FloatArray:
    r"""Smooth the seams between placed parts.

    Finds the positions x that minimise

    .. math:: \sum_{ij} w_{ij} \| (x_i - x_j) - \tfrac12 (R_i + R_j) (p_i - p_j) \|^2
              + \frac1{b^2} \sum_i m_i \| x_i - y_i \|^2 ,

    a screened Poisson equation: the perturbation by a seam decays as :math:`e^{-d/b}` with the distance d from it.

    Parameters
    ----------
    surface, masses
        As in :func:`refit_parts`; the masses m are areas in squared units of the rest positions.
    placed
        Positions y of the vertices after the rigid motions of their parts, shape (n, 3).
    turns
        Rotation of each vertex, shape (n, 3, 3).
    width
        Width b of the seams.
    """
    pull = masses / width**2
    return surface.factorise(pull)(surface.load(turns) + pull[:, None] * placed)
