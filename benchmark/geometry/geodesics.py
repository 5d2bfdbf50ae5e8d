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
    block sorts the vertices by distance, which is nearly the right order for the whole block. All
    arcs are then relaxed in that order and its reverse, for the whole block at once, until nothing
    changes. The result does not depend on how sources are grouped, because rounding is monotone.

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
    graph_in_units = csr_array((lengths, heads, starts), shape=graph.shape)
    n_vertices = len(starts) - 1
    distances = np.empty((len(sources), n_vertices))
    waiting = np.arange(len(sources))
    while len(waiting):
        # The next block: the sources that are nearest to the first one that waits.
        from_first = dijkstra(graph_in_units, indices=sources[waiting[0]])
        nearest = np.argsort(from_first[sources[waiting]], kind="stable")[:_BLOCK]
        block = waiting[nearest]
        order = np.argsort(from_first, kind="stable")
        columns = _relax(starts, heads, lengths, order, sources[block])
        distances[block] = columns.T.astype(np.float64) * unit
        waiting = np.delete(waiting, nearest)
    return distances


@njit(cache=True, nogil=True)
def _relax(starts, heads, lengths, order, sources):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Compute shortest paths by relaxing all arcs until no distance becomes shorter.

    Parameters
    ----------
    starts
        Index of the first arc of each vertex (compressed sparse rows), shape (n + 1,).
    heads, lengths
        Head and length of each arc, shape (arcs,).
    order
        Vertices in the order of the first sweep; it ends soonest if they are sorted by distance.
        Shape (n,).
    sources
        Vertex indices, shape (k,).

    Returns
    -------
    numpy.ndarray
        Distance of each vertex from each source, shape (n, k), float32; infinite without a path.
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
            # Only neighbours that have changed since its last update can shorten a row.
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
    """Shorten the distances of one vertex by way of its neighbours; return whether any is shorter.

    For each source, the distance is at most that of a neighbour plus the arc between them.

    Parameters
    ----------
    rows
        Distance of each vertex from each source, shape (n, k); the row of the vertex is updated.
    vertex
        Index of the vertex.
    starts
        Index of the first arc of each vertex (compressed sparse rows), shape (n + 1,).
    heads, lengths
        Head and length of each arc, shape (arcs,).
    changed
        Time at which the row of each vertex changed last, shape (n,).
    since
        Only neighbours that changed after this time count.
    """
    # Collect the arcs to neighbours that changed: each arc is written, and kept if the count
    # advances, which is faster than a branch.
    arcs = np.empty(starts[vertex + 1] - starts[vertex] + 3, np.int64)
    n_arcs = 0
    for arc in range(starts[vertex], starts[vertex + 1]):
        arcs[n_arcs] = arc
        n_arcs += changed[heads[arc]] > since
    # Fill up to a multiple of four with copies of the first arc. If no neighbour changed, these
    # entries hold nothing useful, but the loop below does not run.
    arcs[n_arcs : n_arcs + 3] = arcs[0]
    own = rows[vertex]
    improved = False
    # Four neighbours at a time, so that the row of the vertex is read and written less often.
    for place in range(0, n_arcs, 4):
        arc_1 = arcs[place]
        arc_2 = arcs[place + 1]
        arc_3 = arcs[place + 2]
        arc_4 = arcs[place + 3]
        row_1 = rows[heads[arc_1]]
        row_2 = rows[heads[arc_2]]
        row_3 = rows[heads[arc_3]]
        row_4 = rows[heads[arc_4]]
        length_1 = lengths[arc_1]
        length_2 = lengths[arc_2]
        length_3 = lengths[arc_3]
        length_4 = lengths[arc_4]
        any_shorter = 0  # 1 as soon as a distance becomes shorter
        for source in range(own.size):
            by_1 = row_1[source] + length_1
            by_2 = row_2[source] + length_2
            by_3 = row_3[source] + length_3
            by_4 = row_4[source] + length_4
            by_1_or_2 = by_1 if by_1 < by_2 else by_2
            by_3_or_4 = by_3 if by_3 < by_4 else by_4
            shortest = by_1_or_2 if by_1_or_2 < by_3_or_4 else by_3_or_4
            any_shorter |= shortest < own[source]
            own[source] = shortest if shortest < own[source] else own[source]
        improved |= any_shorter > 0
    return improved
