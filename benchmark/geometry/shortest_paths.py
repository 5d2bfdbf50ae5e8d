"""Shortest paths on a graph from many sources at once."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.geometry.geodesic_graph import Graph, largest_count

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Number of sources processed together. Their distances to a vertex are contiguous in memory, so the processor adds and
# compares eight at a time. Changed neighbours are looked up once per block: with 512 sources, that is cheap compared to
# the arithmetic, although fewer rows fit the cache.
_BLOCK = 512


def shortest_paths(graph: Graph, sources: IntArray) -> FloatArray:
    """Return the lengths of the shortest paths from each source to all vertices.

    Sources are processed in blocks of neighbours. Dijkstra's algorithm from the first source of a block yields a vertex
    order that is nearly correct for the whole block. Alternating forward and backward Gauss-Seidel sweeps in that order
    relax the arcs for the whole block until convergence, and skip unchanged vertices. Rounding is monotone, so the
    result does not depend on the grouping of sources.

    Parameters
    ----------
    graph
        Undirected graph with n vertices and nonnegative lengths.
    sources
        Vertex indices, shape (k,).

    Returns
    -------
    numpy.ndarray
        Shape (k, n), rounded to single precision at each arc; infinite if there is no path.
    """
    sources = np.asarray(sources, dtype=np.int64)
    # A common unit prevents overflow in single precision; a power of two keeps all digits.
    longest = float(graph.lengths.max(initial=0.0))
    unit = 2.0 ** np.floor(np.log2(longest)) if longest > 0 else 1.0
    lengths = (graph.lengths / unit).astype(np.float32)
    distances = np.empty((len(sources), len(graph.starts) - 1))
    waiting = np.arange(len(sources))
    while len(waiting):
        reference = _dijkstra(graph.starts, graph.heads, lengths, sources[waiting[0]])
        if len(waiting) == 1:
            distances[waiting[0]] = reference * unit
            break
        nearest = np.argsort(reference[sources[waiting]], kind="stable")[:_BLOCK]
        block = waiting[nearest]
        rows = _relax(graph.starts, graph.heads, lengths, np.argsort(reference, kind="stable"), sources[block])
        _store(rows, unit, block, distances)
        waiting = np.delete(waiting, nearest)
    return distances


@njit(cache=True, nogil=True)
def _store(rows, unit, block, distances):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write column c of ``rows``, times the unit, to row ``block[c]`` of ``distances``."""
    count = rows.shape[0]
    # A few rows at a time, so that they stay in the cache until their last column is read.
    for first in range(0, count, 16):
        last = min(first + 16, count)
        for column in range(block.size):
            target = distances[block[column]]
            for vertex in range(first, last):
                target[vertex] = unit * rows[vertex, column]


@njit(cache=True, nogil=True)
def _relax(starts, heads, lengths, order, sources):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    count = order.size
    rows = np.full((count, sources.size), np.float32(np.inf))
    changed = np.zeros(count, np.int64)  # time of the last change of a row
    updated = np.full(count, -1, np.int64)  # time of the last update of a row from its neighbours
    for column in range(sources.size):
        rows[sources[column], column] = 0
    # Room for the arcs of any vertex; one extra entry, as an arc is written before it is counted.
    arcs = np.empty(largest_count(starts) + 1, np.int64)
    clock = 0
    settled = False
    while not settled:
        settled = True
        for vertex in order:
            since = updated[vertex]
            clock += 1
            updated[vertex] = clock
            if _pull(rows, vertex, starts, heads, lengths, changed, since, arcs):
                changed[vertex] = clock
                settled = False
        # A vertex between two sources is reached from one of them in this order, from the other in reverse order.
        order = order[::-1].copy()
    return rows


# Distances are never NaN; without that guarantee, the compiler would not vectorise the inner loop.
@njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def _pull(rows, vertex, starts, heads, lengths, changed, since, arcs):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    row = rows[vertex]
    improved = False
    news = 0
    for arc in range(starts[vertex], starts[vertex + 1]):
        arcs[news] = arc
        news += changed[heads[arc]] > since
    # Four neighbours at a time, which reduces loads and stores of the row to a quarter.
    fours = news - news % 4
    for at in range(0, fours, 4):
        i, j, k, m = arcs[at], arcs[at + 1], arcs[at + 2], arcs[at + 3]
        first, second, third, fourth = rows[heads[i]], rows[heads[j]], rows[heads[k]], rows[heads[m]]
        to_first, to_second, to_third, to_fourth = lengths[i], lengths[j], lengths[k], lengths[m]
        shorter = 0
        for column in range(row.size):
            one, two = first[column] + to_first, second[column] + to_second
            three, four = third[column] + to_third, fourth[column] + to_fourth
            one, three = one if one < two else two, three if three < four else four
            candidate = one if one < three else three
            shorter |= candidate < row[column]
            row[column] = candidate if candidate < row[column] else row[column]
        if shorter:
            improved = True
    for at in range(fours, news):
        other, length = rows[heads[arcs[at]]], lengths[arcs[at]]
        shorter = 0
        for column in range(row.size):
            candidate = other[column] + length
            shorter |= candidate < row[column]
            row[column] = candidate if candidate < row[column] else row[column]
        if shorter:
            improved = True
    return improved


@njit(cache=True, nogil=True)
def _dijkstra(starts, heads, lengths, source):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    count = starts.size - 1
    distance = np.full(count, np.float32(np.inf))
    # A vertex enters the heap once and keeps its ``place``; after it leaves, nonnegative lengths cannot lower it.
    heap = np.empty(count, np.int64)
    place = np.full(count, -1, np.int64)
    distance[source] = 0
    heap[0], place[source], size = source, 0, 1
    while size:
        nearest = heap[0]
        size -= 1
        if size:
            _sink(heap, place, distance, heap[size], size)
        near = distance[nearest]
        for arc in range(starts[nearest], starts[nearest + 1]):
            head = heads[arc]
            candidate = near + lengths[arc]
            if candidate < distance[head]:
                distance[head] = candidate
                if place[head] < 0:
                    place[head] = size
                    size += 1
                _rise(heap, place, distance, head)
    return distance


@njit(cache=True, nogil=True)
def _rise(heap, place, distance, vertex):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    at = place[vertex]
    key = distance[vertex]
    while at > 0:
        parent = (at - 1) >> 2
        other = heap[parent]
        if distance[other] <= key:
            break
        heap[at], place[other] = other, at
        at = parent
    heap[at], place[vertex] = vertex, at


@njit(cache=True, nogil=True)
def _sink(heap, place, distance, vertex, size):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    at = 0
    key = distance[vertex]
    while 4 * at + 1 < size:
        best = 4 * at + 1
        for sibling in range(best + 1, min(4 * at + 5, size)):
            if distance[heap[sibling]] < distance[heap[best]]:
                best = sibling
        other = heap[best]
        if distance[other] >= key:
            break
        heap[at], place[other] = other, at
        at = best
    heap[at], place[vertex] = vertex, at
