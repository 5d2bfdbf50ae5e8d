"""Sampling of points of a surface, spread evenly, the first few of them as evenly as all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.api.contracts import FloatArray
from benchmark.geometry.mesh import Mesh, Points

PER_POINT = 4
"""Candidates per sampled point if they are evenly spaced."""

RANDOM_PER_POINT = 2
"""Candidates per sampled point if they are random: training need not be as even."""

MOST_PER_TRIANGLE = 64
"""Largest number of candidates along the side of a triangle, that of a triangle with the whole area."""

TIE = 1e-6
"""Relative difference below which squared distances are equal, far above rounding errors."""

_TIE_BREAKER = np.array([1.0, 0.7390851332, 0.5671432904])
"""Direction perpendicular to no edge of a regular shape; the component along it breaks ties between distances."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Points of a surface.

    Parameters
    ----------
    points
        Shape (m, 3).
    normals
        Unit normals of their triangles, shape (m, 3).
    """

    points: Points
    normals: Points


def even_samples(mesh: Mesh, count: int) -> Samples:
    """Sample a surface by farthest point sampling, independently of the order of its vertices and triangles.

    Each triangle gets candidates according to its area, at the centres of the small triangles into which it is divided.
    These do not depend on the order of its corners.

    Parameters
    ----------
    mesh
        A surface with area, in its own frame (:func:`learned.frame.frame_of`).
    count
        Number of points, m.
    """
    areas = mesh.face_areas
    # Each triangle is divided into k^2; the margin gives triangles of equal area the same k.
    parts = np.ceil(np.sqrt(areas / areas.sum() * PER_POINT * count) * (1 - TIE)).astype(np.int64)
    parts = np.where(areas > 0, np.clip(parts, 1, MOST_PER_TRIANGLE), 0)
    points, owners = [], []
    for k in np.unique(parts[parts > 0]):
        of_size = np.flatnonzero(parts == k)
        weights = _centres(int(k))
        points.append(np.einsum("wc,mcx->mwx", weights, mesh.vertices[mesh.faces[of_size]]).reshape(-1, 3))
        owners.append(np.repeat(of_size, len(weights)))
    return _spread(mesh, np.concatenate(points), np.concatenate(owners), count)


def random_samples(mesh: Mesh, count: int, random: np.random.Generator) -> Samples:
    """Sample a surface by farthest point sampling from random candidates, uniform by area."""
    areas = mesh.face_areas
    number = RANDOM_PER_POINT * count
    owners = np.searchsorted(np.cumsum(areas), random.uniform(0, areas.sum(), number)).clip(max=len(areas) - 1)
    # Square roots make the candidates uniform in a triangle [Osada et al. 2002, equation 1].
    root, along = np.sqrt(random.uniform(size=number)), random.uniform(size=number)
    weights = (1 - root, root * (1 - along), root * along)
    points = sum(weight[:, None] * mesh.vertices[mesh.faces[owners, k]] for k, weight in enumerate(weights))
    return _spread(mesh, np.asarray(points), owners, count)


def _spread(mesh: Mesh, candidates: Points, owners: NDArray[np.int64], count: int) -> Samples:
    chosen = _farthest_points(np.ascontiguousarray(candidates), candidates @ _TIE_BREAKER, count)
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[owners[chosen]]], 1, 0)
    normals = np.cross(b - a, c - a)
    return Samples(candidates[chosen], normals / np.linalg.norm(normals, axis=1, keepdims=True).clip(min=1e-300))


def _centres(k: int) -> FloatArray:
    """Return the barycentric coordinates of the centres of the k^2 parts of a triangle, shape (k^2, 3)."""
    i, j = (indices.ravel() for indices in np.indices((k, k)))
    upright, inverted = i + j < k, i + j < k - 1
    first = np.concatenate([i[upright] + 1 / 3, i[inverted] + 2 / 3])
    second = np.concatenate([j[upright] + 1 / 3, j[inverted] + 2 / 3])
    return np.stack([first, second, k - first - second], axis=1) / k


@njit(cache=True, nogil=True)
def _farthest_points(points: FloatArray, keys: FloatArray, count: int) -> NDArray[np.int64]:
    """Select points by farthest point sampling, starting farthest from the origin; the larger key breaks ties.

    If there are fewer points than requested, points repeat.
    """
    chosen = np.zeros(count, dtype=np.int64)
    squares = np.empty(len(points))
    for i in range(len(points)):
        squares[i] = points[i, 0] ** 2 + points[i, 1] ** 2 + points[i, 2] ** 2
    for number in range(count):
        if number:
            last = chosen[number - 1]
            for i in range(len(points)):
                square = 0.0
                for k in range(3):
                    square += (points[i, k] - points[last, k]) ** 2
                if number == 1 or square < squares[i]:
                    squares[i] = square
        least = squares.max() * (1.0 - TIE)
        best = -1
        for i in range(len(points)):
            if squares[i] >= least and (best < 0 or keys[i] > keys[best]):
                best = i
        chosen[number] = best
    return chosen
