"""Sides of triangles, and the undirected edges in which they meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Edges:
    """The undirected edges of some triangles.

    Parameters
    ----------
    ends
        Vertices at the two ends, the smaller index first, shape (e, 2); rows ascend.
    counts
        Number of sides that meet in each edge, shape (e,): 1 at a boundary, 2 inside a manifold.
    of_sides
        Edge of each side, shape (3 m,), in the order of :func:`sides_of`.
    grouped_sides
        All sides, edge by edge and ascending within an edge, shape (3 m,).
    """

    ends: IntArray
    counts: IntArray
    of_sides: IntArray
    grouped_sides: IntArray

    @property
    def first(self) -> IntArray:
        """Place in ``grouped_sides`` where each edge begins, shape (e,)."""
        return np.asarray(np.cumsum(self.counts) - self.counts)

    @property
    def boundary(self) -> IntArray:
        """Ends of the edges that belong to one side only, shape (b, 2)."""
        return np.asarray(self.ends[self.counts == 1])


def sides_of(faces: NDArray[np.integer]) -> tuple[IntArray, IntArray]:
    """Return where the sides of triangles start and end.

    Parameters
    ----------
    faces
        Shape (m, 3).

    Returns
    -------
    starts, ends : numpy.ndarray
        Shape (3 m,) each: side 3 f + k runs from corner k to corner k + 1 of face f.
    """
    corners = faces.astype(np.int64)
    return corners.ravel(), np.roll(corners, -1, axis=1).ravel()


def edges_of(faces: NDArray[np.integer]) -> Edges:
    """Return the undirected edges of triangles, shape (m, 3)."""
    starts, ends = sides_of(faces)
    base = int(faces.max(initial=0)) + 1
    key = np.minimum(starts, ends) * base + np.maximum(starts, ends)
    order = np.argsort(key, kind="stable")
    key = key[order]
    is_new = np.ones(len(key), dtype=bool)
    is_new[1:] = key[1:] != key[:-1]
    first = np.flatnonzero(is_new)
    of_sides = np.empty(len(key), dtype=np.int64)
    of_sides[order] = np.cumsum(is_new) - 1
    counts = np.diff(np.append(first, len(key)))
    return Edges(np.stack(np.divmod(key[first], base), axis=1), counts, of_sides, order)
