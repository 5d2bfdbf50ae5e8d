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
    """Return the quadric of each vertex, which measures distances to the lines through its edges.

    With the quadric Q of a vertex, the squared distances of a point p from these lines sum up to
    (p, 1) Q (p, 1)^T.

    Parameters
    ----------
    vertices
        Positions, shape (n, 3).
    edges
        Vertices at both ends of each edge, shape (edges, 2).

    Returns
    -------
    numpy.ndarray
        Shape (n, 4, 4), symmetric.
    """
    start = vertices[edges[:, 0]]
    end = vertices[edges[:, 1]]
    lengths = np.linalg.norm(end - start, axis=1, keepdims=True)
    directions = (end - start) / np.maximum(lengths, np.finfo(float).tiny)
    # The distance of a point p to a line is the length of d x p - d x start, with the direction d.
    # Of each edge, K maps (p, 1) to that vector, so the squared distance has the quadric K^T K.
    maps = np.zeros((len(edges), 3, 4))
    maps[:, :, :3] = np.cross(directions[:, None], np.eye(3)).transpose(0, 2, 1)
    maps[:, :, 3] = -np.cross(directions, start)
    quadrics = np.zeros((len(vertices), 4, 4))
    for ends in edges.T:
        np.add.at(quadrics, ends, np.einsum("eki,ekj->eij", maps, maps))
    return quadrics


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _collapse(
    points: FloatArray, faces: NDArray[np.int32], links: Links, quadrics: FloatArray
) -> NDArray[np.int64]:
    """Collapse edges, the cheapest one first, until no triangle is left.

    Only edges of triangles collapse. What remains is a skeleton of edges.

    Parameters
    ----------
    points
        Positions, shape (n, 3); a vertex does not move when another one collapses into it.
    faces
        Triangles, shape (m, 3); changed in place.
    links
        Connections of each pair of vertices, shape (n, n): 0 for none, 1 for an edge, more for an
        edge at triangles; changed in place.
    quadrics
        Quadric of each vertex, from :func:`_line_quadrics`, shape (n, 4, 4); changed in place.

    Returns
    -------
    numpy.ndarray
        The vertex into which each vertex collapsed, itself if it remains, shape (n,).
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
        # Vertex i collapses into j; from now on, j stands for the edges of both.
        j = target[i]
        owner[i] = j
        cost[i] = np.inf
        quadrics[j] += quadrics[i]
        # Vertex j takes over the triangles and the connections of i. Triangles that have both
        # vertices vanish, and edges that only these triangles had become plain edges.
        around = np.flatnonzero((faces[:, 0] == i) | (faces[:, 1] == i) | (faces[:, 2] == i))
        _count(faces, around, links, -1)
        for k in np.flatnonzero(links[i]):
            links[i, k] = 0
            links[k, i] = 0
            if k != j:
                links[j, k] = max(links[j, k], 1)
                links[k, j] = links[j, k]
        _replace(faces, around, i, j)
        _count(faces, around, links, 1)
        # Costs around j have changed.
        _evaluate(j, points, quadrics, links, cost, target)
        for k in np.flatnonzero(links[j]):
            _evaluate(k, points, quadrics, links, cost, target)
    # A vertex may have collapsed into one that collapsed later: follow these to the end.
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
    """Find the cheapest collapse of a vertex into a neighbour with which it shares a triangle.

    The cost has two parts [Au et al. 2008]. The shape cost sums up the squared distances from the
    edges that both vertices stand for. The sampling cost is the length of the edge times the length
    of all other edges at the vertex.

    Parameters
    ----------
    i
        Index of the vertex.
    points
        Positions, shape (n, 3).
    quadrics
        Quadric of each vertex, from :func:`_line_quadrics`, shape (n, 4, 4).
    links
        Connections of each pair of vertices, shape (n, n): 0 for none, 1 for an edge, more for an
        edge at triangles.
    cost
        Cost of the cheapest collapse of each vertex, infinite if there is none, shape (n,); entry i
        is written.
    target
        Neighbour into which each vertex would collapse, -1 if there is none, shape (n,); entry i is
        written.
    """
    neighbours = np.flatnonzero(links[i])
    lengths = np.sqrt(((points[neighbours] - points[i]) ** 2).sum(axis=1))
    cost[i] = np.inf
    target[i] = -1
    for place, j in enumerate(neighbours):
        is_at_triangle = links[i, j] > 1
        if not is_at_triangle:
            continue
        # The quadrics of both vertices at the position of the neighbour.
        shape_cost = 0.0
        homogeneous = (points[j, 0], points[j, 1], points[j, 2], 1.0)
        for a, row in enumerate(homogeneous):
            for b, column in enumerate(homogeneous):
                shape_cost += row * column * (quadrics[i, a, b] + quadrics[j, a, b])
        sampling_cost = lengths[place] * (lengths.sum() - lengths[place])
        new_cost = max(shape_cost, 0.0) + sampling_cost
        if new_cost < cost[i]:
            cost[i] = new_cost
            target[i] = j
