"""Collapse of a contracted surface into the vertices of a curve."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import FloatArray
from benchmark.geometry.mesh import Mesh, edges_of

SAMPLING = 0.1
"""Weight of the sampling cost relative to the shape cost, as in Au et al. (2008)."""


def collapse(mesh: Mesh, sampling: float = SAMPLING) -> NDArray[np.int32]:
    r"""Collapse half-edges until no triangle is left (Au et al. 2008, section 5).

    Collapsing vertex :math:`i` onto its neighbour :math:`j` costs

    .. math:: \tilde v_j^\top (Q_i + Q_j) \tilde v_j + w \, \|v_i - v_j\| \sum_{k \in N(i)} \|v_i - v_k\|,

    where :math:`Q_i` measures the squared distances to the lines of the edges merged into i. The first term preserves
    the shape of the curve, the second prefers short edges and hence even spacing. The cheapest edge that still borders
    a triangle collapses first.

    Parameters
    ----------
    mesh
        Contracted surface; of two collapses of exactly equal cost, the one with the lower vertex index goes first.
    sampling
        Weight w of the second term.

    Returns
    -------
    numpy.ndarray
        The vertex into which each vertex collapsed, shape (n,); survivors map to themselves.
    """
    faces = mesh.faces
    edges = edges_of(faces).ends
    directed = np.concatenate([edges, edges[:, ::-1]])
    directed = directed[np.argsort(directed[:, 0], kind="stable")].astype(np.int32)
    # The weight in the kernel is fixed; scaling all costs does not change their order.
    quadrics = SAMPLING / sampling * _line_quadrics(mesh.vertices, edges)
    return np.asarray(_collapse(mesh.vertices, faces, directed, quadrics))


def _line_quadrics(vertices: FloatArray, edges: NDArray[np.int64]) -> FloatArray:
    start, end = vertices[edges[:, 0]], vertices[edges[:, 1]]
    lengths = np.linalg.norm(end - start, axis=1, keepdims=True)
    direction = (end - start) / np.maximum(lengths, np.finfo(float).tiny)
    moment = np.cross(direction, start)
    # The rows map a homogeneous point p to direction x p - moment, whose length is its distance to the line.
    rows = np.zeros((len(edges), 3, 4))
    rows[:, 0, 1], rows[:, 0, 2] = -direction[:, 2], direction[:, 1]
    rows[:, 1, 0], rows[:, 1, 2] = direction[:, 2], -direction[:, 0]
    rows[:, 2, 0], rows[:, 2, 1] = -direction[:, 1], direction[:, 0]
    rows[:, :, 3] = -moment
    quadrics = np.einsum("eki,ekj->eij", rows, rows)
    total = np.zeros((len(vertices), 4, 4))
    np.add.at(total, edges[:, 0], quadrics)
    np.add.at(total, edges[:, 1], quadrics)
    return total


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _find(owner: NDArray[np.int32], vertex: int) -> int:
    while owner[vertex] != vertex:
        owner[vertex] = owner[owner[vertex]]
        vertex = owner[vertex]
    return vertex


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _collapse(
    points: FloatArray, faces: NDArray[np.int32], directed: NDArray[np.int32], quadrics: FloatArray
) -> NDArray[np.int32]:
    # Neighbours and corners of a vertex are linked lists of original entries, resolved through `owner` when read, so
    # that a collapse only chains two lists.
    n = len(points)
    owner = np.arange(n).astype(np.int32)
    first_edge, last_edge = np.full(n, -1), np.full(n, -1)
    next_edge = np.full(len(directed), -1)
    for e in range(len(directed)):
        _append(first_edge, last_edge, next_edge, directed[e, 0], e)
    first_corner, last_corner = np.full(n, -1), np.full(n, -1)
    next_corner = np.full(3 * len(faces), -1)
    for c in range(3 * len(faces)):
        _append(first_corner, last_corner, next_corner, faces[c // 3, c % 3], c)
    stamp = np.full(n, -1)
    clock = 0
    cost, target = np.full(n, np.inf), np.full(n, -1)
    for i in range(n):
        _evaluate(i, points, quadrics, faces, directed, owner, first_edge, next_edge, first_corner, next_corner,
                  stamp, clock, cost, target)  # fmt: skip
        clock += 1
    touched = np.empty(n, dtype=np.int64)  # stamped before they enter, so each vertex enters at most once
    while True:
        i = int(np.argmin(cost))
        if cost[i] == np.inf:
            break
        j = target[i]
        owner[i] = j
        quadrics[j] += quadrics[i]
        cost[i] = np.inf
        _chain(first_edge, last_edge, next_edge, i, j)
        _chain(first_corner, last_corner, next_corner, i, j)
        count = 1
        touched[0] = j
        stamp[j] = clock
        e = first_edge[j]
        while e != -1:
            k = _find(owner, directed[e, 1])
            if stamp[k] != clock:
                stamp[k] = clock
                touched[count] = k
                count += 1
            e = next_edge[e]
        clock += 1
        for t in range(count):
            _evaluate(touched[t], points, quadrics, faces, directed, owner, first_edge, next_edge, first_corner,
                      next_corner, stamp, clock, cost, target)  # fmt: skip
            clock += 1
    for i in range(n):
        owner[i] = _find(owner, i)
    return owner


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _append(
    first: NDArray[np.int64], last: NDArray[np.int64], following: NDArray[np.int64], v: int, entry: int
) -> None:
    if first[v] == -1:
        first[v] = entry
    else:
        following[last[v]] = entry
    last[v] = entry


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _chain(
    first: NDArray[np.int64], last: NDArray[np.int64], following: NDArray[np.int64], source: int, v: int
) -> None:
    if first[source] == -1:
        return
    if first[v] == -1:
        first[v] = first[source]
    else:
        following[last[v]] = first[source]
    last[v] = last[source]


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _evaluate(
    i: int,
    points: FloatArray,
    quadrics: FloatArray,
    faces: NDArray[np.int32],
    directed: NDArray[np.int32],
    owner: NDArray[np.int32],
    first_edge: NDArray[np.int64],
    next_edge: NDArray[np.int64],
    first_corner: NDArray[np.int64],
    next_corner: NDArray[np.int64],
    stamp: NDArray[np.int64],
    clock: int,
    cost: FloatArray,
    target: NDArray[np.int64],
) -> None:
    """Find the cheapest collapse of vertex i, and drop obsolete entries from its lists."""
    reach = 0.0
    previous = -1
    e = first_edge[i]
    while e != -1:
        k = _find(owner, directed[e, 1])
        if k == i or stamp[k] == clock:
            # The last entry stays even if it is a duplicate: others may be chained behind it.
            if previous != -1 and next_edge[e] != -1:
                next_edge[previous] = next_edge[e]
                e = next_edge[previous]
                continue
        else:
            stamp[k] = clock
            reach += np.sqrt(((points[i] - points[k]) ** 2).sum())
        previous = e
        e = next_edge[e]
    cost[i], target[i] = np.inf, -1
    previous = -1
    c = first_corner[i]
    while c != -1:
        face = c // 3
        a, b, d = _find(owner, faces[face, 0]), _find(owner, faces[face, 1]), _find(owner, faces[face, 2])
        if a == b or b == d or d == a:
            if previous != -1 and next_corner[c] != -1:
                next_corner[previous] = next_corner[c]
                c = next_corner[previous]
                continue
        else:
            for j in (a, b, d):
                if j != i:
                    price = _shape_cost(quadrics[i], quadrics[j], points[j])
                    price += SAMPLING * np.sqrt(((points[i] - points[j]) ** 2).sum()) * reach
                    if price < cost[i] or (price == cost[i] and j < target[i]):
                        cost[i], target[i] = price, j
        previous = c
        c = next_corner[c]


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _shape_cost(first: FloatArray, second: FloatArray, point: FloatArray) -> float:
    total = 0.0
    for a in range(4):
        for b in range(4):
            left = point[a] if a < 3 else 1.0
            right = point[b] if b < 3 else 1.0
            total += left * right * (first[a, b] + second[a, b])
    return max(total, 0.0)
