"""Starts of iterations over all pairs: the scaling of a few spread vertices, and the others among them."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray

from baselines._kernels.orientation import largest
from benchmark.api.contracts import FloatArray

#: Spread vertices that are scaled first: a sixtieth of the pairs of 2000 vertices. With 160 of them the fingers of some
#: bodies come to rest in other places, at a stress higher by two per cent.
SAMPLES = 256
#: Samples are scaled on a grid of this share of the largest distance; :func:`baselines._kernels.quasi_newton.minimise`.
#: On a grid 64 times as fine, noise of 1e-12 in the distances moved a twelfth of the forms; the stress is the same.
GRAIN = 2.0**-20
#: Transforms by which every other vertex settles among them.
SETTLING = 4
#: How far a sample's own move dominates around it, as a share of the largest distance to the nearest sample.
NEAR = 0.25


def coarse_start(
    distances: FloatArray,
    start: FloatArray,
    vertices: FloatArray,
    scale: Callable[[FloatArray, FloatArray, float], tuple[FloatArray, Callable[[FloatArray], FloatArray]]],
) -> FloatArray:
    """Scale a sample of the vertices, and let the others follow.

    Farthest-point samples are scaled to the end, at a fraction of the cost. Every other vertex moves with the
    samples near to it, and then by some Guttman transforms of its own against the samples alone [de Silva and
    Tenenbaum 2004 place vertices in this way, from classic scaling]. What is left to a scaling of all pairs are small
    adjustments.

    Parameters
    ----------
    distances
        Symmetric, shape (n, n).
    start
        First positions, shape (n, 3).
    vertices
        Positions that tell equally far vertices apart, shape (n, 3).
    scale
        Takes distances and first positions of the samples, shapes (p, p) and (p, 3), and the grain to which positions
        are to be rounded; returns their positions, and what turns any distances into those that the form should have.

    Returns
    -------
    numpy.ndarray
        Shape (n, 3); ``start`` itself if there are too few vertices for samples to pay.
    """
    if len(start) < 4 * SAMPLES:
        return start
    samples, radius = _spread(distances, vertices)
    rows = np.ascontiguousarray(distances[samples])
    anchors, targets_of = scale(
        np.ascontiguousarray(rows[:, samples]), start[samples], GRAIN * 2.0 ** np.floor(np.log2(rows.max()))
    )
    # Moves that start from a common mean, as the scaling of the samples has its own.
    moves = anchors - (start[samples] - start[samples].mean(axis=0))
    shares = (rows + NEAR * radius) ** -4.0
    points = start - start[samples].mean(axis=0) + (shares.T @ moves) / shares.sum(axis=0)[:, None]
    settled = np.ascontiguousarray(points.T)
    _settle(settled, np.ascontiguousarray(targets_of(rows).T), np.ascontiguousarray(anchors.T), SETTLING)
    return np.ascontiguousarray(settled.T)


def _spread(distances: FloatArray, vertices: FloatArray) -> tuple[NDArray[np.int64], float]:
    """Farthest-point samples, from the vertex farthest from all others on; and how far any vertex is from them."""
    chosen = [largest(np.einsum("ij,ij->i", distances, distances), vertices)]
    nearest = distances[chosen[0]].copy()
    while len(chosen) < SAMPLES:
        chosen.append(largest(nearest, vertices))
        np.minimum(nearest, distances[chosen[-1]], out=nearest)
    return np.array(chosen), float(nearest.max())


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _settle(points, targets, anchors, transforms):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Move each point, a column of ``points``, towards its target distances from the anchors, in place."""
    count = anchors.shape[1]
    anchor_x, anchor_y, anchor_z = anchors[0], anchors[1], anchors[2]
    middle_x, middle_y, middle_z = anchor_x.sum() / count, anchor_y.sum() / count, anchor_z.sum() / count
    for i in range(points.shape[1]):
        x, y, z = points[0, i], points[1, i], points[2, i]
        target = targets[i]
        for _ in range(transforms):
            pull_x = pull_y = pull_z = 0.0
            for j in range(count):
                dx, dy, dz = x - anchor_x[j], y - anchor_y[j], z - anchor_z[j]
                squared = dx * dx + dy * dy + dz * dz
                ratio = target[j] / np.sqrt(squared) if squared > 0.0 else 0.0
                pull_x += ratio * dx
                pull_y += ratio * dy
                pull_z += ratio * dz
            x, y, z = middle_x + pull_x / count, middle_y + pull_y / count, middle_z + pull_z / count
        points[0, i], points[1, i], points[2, i] = x, y, z
