"""Collapse of a contracted surface into the vertices of a curve."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.api.contracts import FloatArray
from benchmark.geometry.mesh import Mesh

#: For each pair of vertices 0 if no edge joins them, else 1 and the number of triangles at it.
Links = NDArray[np.int16]


def collapse(mesh: Mesh) -> NDArray[np.int64]:
    r"""Collapse half-edges until no triangle is left (Au et al. 2008, section 5).

    Collapsing vertex :math:`i` onto its neighbour :math:`j` costs

    .. math:: \tilde v_j^\top (Q_i + Q_j) \tilde v_j
              + \|v_i - v_j\| \sum_{k \in N(i), k \ne j} \|v_i - v_k\|,

    where :math:`Q_i` measures the squared distances to the lines of the edges merged into i. The
    first term preserves the shape of the curve, the second prefers short edges and hence even
    spacing; their weights are those of the code released by Pickup et al. (2016). The cheapest edge
    that still borders a triangle collapses first.

    Parameters
    ----------
    mesh
        Contracted surface; of two collapses of exactly equal cost, the one with the lower vertex
        index goes first.

    Returns
    -------
    numpy.ndarray
        The vertex into which each vertex collapsed, shape (n,); survivors map to themselves.
    """
    n = mesh.n_vertices
    edges = mesh.edges
    links = np.zeros((n, n), dtype=np.int16)
    first, second = edges.ends.T
    links[first, second] = links[second, first] = 1 + edges.counts
    quadrics = _line_quadrics(mesh.vertices, edges.ends)
    return np.asarray(_collapse(mesh.vertices, mesh.faces.copy(), links, quadrics))


def _line_quadrics(vertices: FloatArray, edges: NDArray[np.int64]) -> FloatArray:
    """Return the quadrics of the squared distance to the edges of each vertex, shape (n, 4, 4)."""
    start = vertices[edges[:, 0]]
    end = vertices[edges[:, 1]]
    lengths = np.linalg.norm(end - start, axis=1, keepdims=True)
    direction = (end - start) / np.maximum(lengths, np.finfo(float).tiny)
    # The rows map a homogeneous point p to direction x p - moment, whose length is its distance to
    # the line.
    rows = np.zeros((len(edges), 3, 4))
    rows[:, :, :3] = np.cross(direction[:, None], np.eye(3)).transpose(0, 2, 1)
    rows[:, :, 3] = -np.cross(direction, start)
    total = np.zeros((len(vertices), 4, 4))
    for ends in edges.T:
        np.add.at(total, ends, np.einsum("eki,ekj->eij", rows, rows))
    return total


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _collapse(
    points: FloatArray, faces: NDArray[np.int32], links: Links, quadrics: FloatArray
) -> NDArray[np.int64]:
    """Collapse the cheapest edge at a triangle until none is left; see :func:`collapse`.

    All arrays but the points are changed. Returns the vertex into which each vertex collapsed.
    """
    n = len(points)
    owner = np.arange(n)
    target = np.full(n, -1)
    cost = np.full(n, np.inf)
    for i in range(n):
        _evaluate(i, points, quadrics, links, cost, target)
    while True:
        i = int(np.argmin(cost))
        if cost[i] == np.inf:
            break
        j = target[i]
        owner[i] = j
        cost[i] = np.inf
        quadrics[j] += quadrics[i]
        around = np.flatnonzero((faces[:, 0] == i) | (faces[:, 1] == i) | (faces[:, 2] == i))
        _count(faces, around, links, -1)
        for k in np.flatnonzero(links[i]):
            links[i, k] = links[k, i] = 0
            if k != j:
                links[j, k] = links[k, j] = max(links[j, k], 1)
        _replace(faces, around, i, j)
        _count(faces, around, links, 1)
        _evaluate(j, points, quadrics, links, cost, target)
        for k in np.flatnonzero(links[j]):
            _evaluate(k, points, quadrics, links, cost, target)
    for i in range(n):
        while owner[owner[i]] != owner[i]:
            owner[i] = owner[owner[i]]
    return owner


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _replace(faces: NDArray[np.int32], around: NDArray[np.int64], vertex: int, by: int) -> None:
    """Replace a vertex by another one in some triangles."""
    for f in around:
        for corner in range(3):
            if faces[f, corner] == vertex:
                faces[f, corner] = by


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _count(faces: NDArray[np.int32], around: NDArray[np.int64], links: Links, amount: int) -> None:
    """Add an amount to the number of triangles at each edge of some triangles.

    Only triangles with three different corners count.
    """
    for f in around:
        a, b, c = faces[f]
        if a != b and b != c and c != a:
            for u, v in ((a, b), (b, c), (c, a)):
                links[u, v] += amount
                links[v, u] += amount


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _evaluate(
    i: int,
    points: FloatArray,
    quadrics: FloatArray,
    links: Links,
    cost: FloatArray,
    target: NDArray[np.int64],
) -> None:
    """Find the cheapest collapse of vertex i."""
    neighbours = np.flatnonzero(links[i])
    lengths = np.sqrt(((points[neighbours] - points[i]) ** 2).sum(axis=1))
    cost[i] = np.inf
    target[i] = -1
    for place, j in enumerate(neighbours):
        if links[i, j] > 1:
            shape = 0.0
            x = points[j, 0]
            y = points[j, 1]
            z = points[j, 2]
            for a, row in enumerate((x, y, z, 1.0)):
                for b, column in enumerate((x, y, z, 1.0)):
                    shape += row * column * (quadrics[i, a, b] + quadrics[j, a, b])
            price = max(shape, 0.0) + lengths[place] * (lengths.sum() - lengths[place])
            if price < cost[i]:
                cost[i] = price
                target[i] = j
