"""Geodesic distances on a triangle mesh."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from benchmark.errors import UnsupportedShape
from benchmark.geometry.cleaning import connected_components
from benchmark.geometry.geodesic_graph import geodesic_graph
from benchmark.geometry.mesh import FloatArray, IntArray, Mesh

#: The graph of the latest mesh, for methods that request a few rows at a time.
_graph_of = lru_cache(maxsize=1)(geodesic_graph)

#: Number of sources processed together. Their distances to a vertex are contiguous in memory, so
#: the processor adds and compares eight at a time. Changed neighbours are looked up once per block:
#: with 1000 sources, that is cheap compared to the arithmetic. Not a power of two, for which all
#: entries of a column would compete for the same places in a cache.
_BLOCK = 1000


def all_pairs(mesh: Mesh) -> FloatArray:
    """Compute the geodesic distances between all pairs of vertices.

    Parameters
    ----------
    mesh
        A mesh with a single component.

    Returns
    -------
    numpy.ndarray
        Shape (n, n), symmetric with zero diagonal, in units of the mesh. The two directions are
        averaged, as rounding differs between them.

    Raises
    ------
    UnsupportedShape
        If the mesh has more than one component.
    """
    distances = from_sources(mesh, np.arange(mesh.n_vertices))
    distances = (distances + distances.T) / 2
    np.fill_diagonal(distances, 0.0)
    return distances


def from_sources(mesh: Mesh, sources: ArrayLike) -> FloatArray:
    """Compute the geodesic distances from some vertices to all vertices.

    Parameters
    ----------
    mesh
        A mesh with a single component.
    sources
        Vertex indices, shape (k,).

    Returns
    -------
    numpy.ndarray
        Shape (k, n), in units of the mesh.

    Raises
    ------
    UnsupportedShape
        If the mesh has more than one component, or a source is not a vertex.
    """
    indices = np.asarray(sources, dtype=np.int64).reshape(-1)
    if indices.size and not (indices.min() >= 0 and indices.max() < mesh.n_vertices):
        problem = f"a source lies outside the {mesh.n_vertices} vertices"
        raise UnsupportedShape(problem, "count vertices from 0 and leave none negative")
    components = int(connected_components(mesh).max(initial=-1)) + 1
    if components != 1:
        problem = f"the mesh has {components} components, so some geodesic distances do not exist"
        hint = (
            "join them (benchmark.geometry.bridging) or keep the largest, "
            "and drop unreferenced vertices"
        )
        raise UnsupportedShape(problem, hint)
    return shortest_paths(_graph_of(mesh), indices)


def rounded(matrix: FloatArray) -> FloatArray:
    """Round distances to single precision; the result is float64.

    Seven digits are four more than the accuracy, and rounding removes most last-bit differences
    between processors, so that methods start from the same numbers on any machine.
    """
    return matrix.astype(np.float32).astype(np.float64)


def shortest_paths(graph: csr_array, sources: IntArray) -> FloatArray:
    """Return the lengths of the shortest paths from each source to all vertices.

    Sources are processed in blocks of neighbours. Dijkstra's algorithm from the first source of a
    block yields a vertex order that is nearly correct for the whole block. Alternating forward and
    backward Gauss-Seidel sweeps in that order relax the arcs for the whole block until convergence,
    and skip unchanged vertices. Rounding is monotone, so the result does not depend on the grouping
    of sources.

    Parameters
    ----------
    graph
        Nonnegative lengths of the arcs, symmetric, shape (n, n); a stored 0 is an arc.
    sources
        Vertex indices, shape (k,).

    Returns
    -------
    numpy.ndarray
        Shape (k, n), rounded to single precision at each arc; infinite if there is no path.
    """
    sources = np.asarray(sources, dtype=np.int64)
    starts = graph.indptr
    heads = graph.indices
    # A common unit prevents overflow in single precision; a power of two keeps all digits.
    longest = float(graph.data.max(initial=0.0))
    unit = 2.0 ** np.floor(np.log2(longest)) if longest > 0 else 1.0
    lengths = (graph.data / unit).astype(np.float32)
    single = csr_array((lengths, heads, starts), shape=graph.shape)
    distances = np.empty((len(sources), len(starts) - 1))
    waiting = np.arange(len(sources))
    while len(waiting):
        reference = dijkstra(single, indices=sources[waiting[0]])
        nearest = np.argsort(reference[sources[waiting]], kind="stable")[:_BLOCK]
        block = waiting[nearest]
        rows = _relax(starts, heads, lengths, np.argsort(reference, kind="stable"), sources[block])
        distances[block] = rows.T.astype(np.float64) * unit
        waiting = np.delete(waiting, nearest)
    return distances


@njit(cache=True, nogil=True)
def _relax(starts, heads, lengths, order, sources):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return the distances of all vertices, by rows, from each source, by columns.

    Parameters
    ----------
    starts, heads, lengths
        The graph: the first arc of each vertex, and head and length of each arc.
    order
        Vertices in the order of the first sweep.
    sources
        Vertex indices.
    """
    count = order.size
    rows = np.full((count, sources.size), np.float32(np.inf))
    changed = np.zeros(count, np.int64)  # time of the last change of a row
    updated = np.full(count, -1, np.int64)  # time of the last update of a row from its neighbours
    for column in range(sources.size):
        rows[sources[column], column] = 0
    clock = 0
    settled = False
    while not settled:
        settled = True
        for vertex in order:
            since = updated[vertex]
            clock += 1
            updated[vertex] = clock
            if _pull(rows, vertex, starts, heads, lengths, changed, since):
                changed[vertex] = clock
                settled = False
        # A vertex between two sources is reached from one of them in this order, from the other in
        # reverse order.
        order = order[::-1].copy()
    return rows


# Distances are never NaN; without that guarantee, the compiler would not vectorise the inner loop.
@njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def _pull(rows, vertex, starts, heads, lengths, changed, since):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Shorten the distances of a vertex by way of neighbours that changed since a time.

    Returns whether any is shorter now.
    """
    arcs = np.empty(starts[vertex + 1] - starts[vertex] + 3, np.int64)
    count = 0
    for arc in range(starts[vertex], starts[vertex + 1]):
        arcs[count] = arc
        count += changed[heads[arc]] > since
    arcs[count : count + 3] = arcs[0]  # an arc that is used twice changes nothing
    row = rows[vertex]
    improved = False
    for at in range(0, count, 4):  # four at a time: the row is read and written a quarter as often
        i, j, k, m = arcs[at], arcs[at + 1], arcs[at + 2], arcs[at + 3]
        first = rows[heads[i]]
        second = rows[heads[j]]
        third = rows[heads[k]]
        fourth = rows[heads[m]]
        to_first = lengths[i]
        to_second = lengths[j]
        to_third = lengths[k]
        to_fourth = lengths[m]
        shorter = 0
        for column in range(row.size):
            by_first = first[column] + to_first
            by_second = second[column] + to_second
            by_third = third[column] + to_third
            by_fourth = fourth[column] + to_fourth
            by_either = by_first if by_first < by_second else by_second
            by_other = by_third if by_third < by_fourth else by_fourth
            candidate = by_either if by_either < by_other else by_other
            shorter |= candidate < row[column]
            row[column] = candidate if candidate < row[column] else row[column]
        improved |= shorter > 0
    return improved
