"""Graphs over the vertices of a mesh whose shortest paths approximate geodesics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.geometry.mesh import Mesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Windows followed from each vertex; docs/geodesics.md has the measurements behind the number.
WINDOWS = 800


@dataclass(frozen=True, eq=False)
class Graph:
    """An undirected graph in compressed rows: the arcs of vertex v are ``heads[starts[v]:starts[v + 1]]``.

    Parameters
    ----------
    starts
        Shape (n + 1,).
    heads
        Vertex at the far end of each arc, shape (a,); every edge is stored in both directions.
    lengths
        Length of each arc, shape (a,), in units of the mesh.
    """

    starts: IntArray
    heads: IntArray
    lengths: FloatArray


def edge_graph(mesh: Mesh) -> Graph:
    """Return the graph of the edges of the mesh with their Euclidean lengths."""
    sides = _Sides.of(mesh)
    return _undirected(mesh.n_vertices, sides.starts, sides.ends, sides.lengths)


def unfolded_graph(mesh: Mesh) -> Graph:
    """Return the edge graph with, across each interior edge, the straight line between its two opposite vertices.

    The two triangles are unfolded into one plane; the diagonal counts only where it crosses their common edge.
    """
    sides = _Sides.of(mesh)
    near = np.flatnonzero(sides.twins > np.arange(len(sides.twins)))
    far = sides.twins[near]
    width = sides.lengths[near]
    x_near = sides.apex_x[near]
    x_far = np.where(sides.starts[near] == sides.starts[far], sides.apex_x[far], width - sides.apex_x[far])
    height = sides.apex_y[near] + sides.apex_y[far]
    with np.errstate(invalid="ignore"):
        crossing = x_near + (x_far - x_near) * sides.apex_y[near] / height
        straight = (crossing >= 0) & (crossing <= width)
    return _undirected(
        mesh.n_vertices,
        np.concatenate((sides.starts, sides.apexes[near[straight]])),
        np.concatenate((sides.ends, sides.apexes[far[straight]])),
        np.concatenate((sides.lengths, np.hypot(x_near - x_far, height)[straight])),
    )


def geodesic_graph(mesh: Mesh, windows: int = WINDOWS) -> Graph:
    """Return the graph of the straight geodesics between nearby vertices.

    Every shortest path on a triangle mesh is a chain of straight geodesics between vertices [Mitchell, Mount and
    Papadimitriou 1987], so the graph of *all* straight geodesics would give exact distances: the saddle vertex graph
    [Ying, Wang and He 2013]. Here, as there, each vertex keeps those of its neighbourhood. From every vertex, the
    triangles around it are unfolded strip by strip into the plane; a *window* is the cone of straight lines from the
    vertex that cross one side. A vertex inside the cone is joined by an arc of exactly its unfolded distance and
    splits the window in two. Windows are followed breadth first, ring by ring, until at least ``windows`` have been
    followed: the neighbourhood adapts to the size of the triangles and does not depend on the order of the faces. An
    arc is a path on the surface, so distances are never too short.

    Parameters
    ----------
    mesh
        Any triangle mesh; windows end at boundaries and at edges with more than two faces.
    windows
        Windows to follow from each vertex; the ring in which the number is reached is completed. More cost time and
        come closer to the exact distances.

    Returns
    -------
    Graph
        The edges of the mesh and the arcs.
    """
    sides = _Sides.of(mesh)
    opposite = np.argsort(sides.apexes, kind="stable")
    first = np.concatenate(([0], np.cumsum(np.bincount(sides.apexes, minlength=mesh.n_vertices))))
    tails, heads, lengths = _follow_windows(
        sides.starts, sides.apexes, sides.twins, sides.lengths, sides.apex_x, sides.apex_y, first, opposite, windows
    )
    return _undirected(mesh.n_vertices, tails, heads, lengths)


@dataclass(frozen=True, eq=False)
class _Sides:
    """The sides of all triangles; side 3 f + k runs from corner k to corner k + 1 of face f.

    ``twins`` is the side of the neighbouring triangle along the same edge, -1 where there is no single one.
    ``apex_x`` and ``apex_y`` place the third corner in the frame of the side: along it from its start, and beside it.
    """

    starts: IntArray
    ends: IntArray
    apexes: IntArray
    twins: IntArray
    lengths: FloatArray
    apex_x: FloatArray
    apex_y: FloatArray

    @classmethod
    def of(cls, mesh: Mesh) -> _Sides:
        faces = mesh.faces.astype(np.int64)
        starts, ends, apexes = (np.roll(faces, -turn, axis=1).ravel() for turn in range(3))
        along = mesh.vertices[ends] - mesh.vertices[starts]
        towards_apex = mesh.vertices[apexes] - mesh.vertices[starts]
        lengths = np.linalg.norm(along, axis=1)
        along /= np.where(lengths > 0, lengths, 1.0)[:, None]
        apex_x = (towards_apex * along).sum(axis=1)
        apex_y = np.linalg.norm(towards_apex - apex_x[:, None] * along, axis=1)

        key = np.minimum(starts, ends) * mesh.n_vertices + np.maximum(starts, ends)
        order = np.argsort(key, kind="stable")
        same = np.diff(key[order]) == 0
        # An edge with exactly two triangles is a run of exactly two equal keys.
        pair = np.flatnonzero(same & ~np.append(same[1:], False) & ~np.append(False, same[:-1]))
        first, second = order[pair], order[pair + 1]
        proper = lengths[first] > 0
        twins = np.full(len(key), -1, dtype=np.int64)
        twins[first[proper]], twins[second[proper]] = second[proper], first[proper]
        return cls(starts, ends, apexes, twins, lengths, apex_x, apex_y)


def _undirected(count: int, tails: IntArray, heads: IntArray, lengths: FloatArray) -> Graph:
    """Build a graph from arcs in any order and direction; of parallel ones the shortest counts."""
    return Graph(*_mirror(count, tails, heads, lengths))


@njit(cache=True, nogil=True)
def _mirror(count, tails, heads, lengths):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    # Counting sort of the arcs and their reverses by tail.
    place = np.zeros(count + 1, np.int64)
    for arc in range(tails.size):
        place[tails[arc] + 1] += 1
        place[heads[arc] + 1] += 1
    place = np.cumsum(place)
    row_end = place.copy()
    far = np.empty(2 * tails.size, np.int64)
    size = np.empty(2 * tails.size, np.float64)
    for arc in range(tails.size):
        tail, head = tails[arc], heads[arc]
        far[row_end[tail]], size[row_end[tail]] = head, lengths[arc]
        row_end[tail] += 1
        far[row_end[head]], size[row_end[head]] = tail, lengths[arc]
        row_end[head] += 1

    # Merge parallel arcs in place; ``slot`` says where the arc of the current row to a vertex lies.
    slot = np.full(count, -1, np.int64)
    starts = np.zeros(count + 1, np.int64)
    write = 0
    for vertex in range(count):
        begin = write
        for read in range(place[vertex], place[vertex + 1]):
            head = far[read]
            if head == vertex:
                continue
            if slot[head] < begin:
                slot[head] = write
                far[write], size[write] = head, size[read]
                write += 1
            elif size[read] < size[slot[head]]:
                size[slot[head]] = size[read]
        starts[vertex + 1] = write
    return starts, far[:write].copy(), size[:write].copy()


@njit(cache=True, nogil=True)
def _follow_windows(  # type: ignore[no-untyped-def]  # noqa: ANN202
    starts,  # noqa: ANN001
    apexes,  # noqa: ANN001
    twins,  # noqa: ANN001
    lengths,  # noqa: ANN001
    apex_x,  # noqa: ANN001
    apex_y,  # noqa: ANN001
    first,  # noqa: ANN001
    opposite,  # noqa: ANN001
    budget,  # noqa: ANN001
):
    """Collect the arcs of :func:`geodesic_graph`; the source lies at the origin of every unfolded plane.

    A window is (side to enter, vertices P and Q of that side; their positions; the two rays that bound the cone), with
    P and Q so named that Q is anticlockwise of P as seen from the source.
    """
    count = first.size - 1
    tails = np.empty(64 * count, np.int64)
    heads = np.empty(64 * count, np.int64)
    sizes = np.empty(64 * count, np.float64)
    arcs = 0
    best = np.full(count, np.inf)
    seen = np.empty(count, np.int64)
    # A ring of windows is begun below the budget and has at most two successors for each of its windows.
    room = 3 * max(budget, np.diff(first).max())
    names = np.empty((room, 3), np.int64)
    plane = np.empty((room, 8), np.float64)
    for source in range(count):
        n_seen = queued = 0
        for at in range(first[source], first[source + 1]):
            side = opposite[at]
            following = side - 2 if side % 3 == 2 else side + 1
            p, q = starts[side], starts[following]
            x, y, width = apex_x[side], apex_y[side], lengths[side]
            for vertex, distance in ((p, np.hypot(x, y)), (q, np.hypot(x - width, y))):
                if best[vertex] == np.inf:
                    seen[n_seen] = vertex
                    n_seen += 1
                best[vertex] = min(best[vertex], distance)
            if twins[side] >= 0:
                names[queued] = (twins[side], p, q)
                plane[queued] = (-x, -y, width - x, -y, -x, -y, width - x, -y)
                queued += 1
        window = ring_end = 0
        while window < queued:
            if window == ring_end:
                if window >= budget:
                    break
                ring_end = queued
            side, p, q = names[window]
            p_x, p_y, q_x, q_y, low_x, low_y, high_x, high_y = plane[window]
            window += 1
            width = lengths[side]
            along_x, along_y = (q_x - p_x) / width, (q_y - p_y) / width
            following = side - 2 if side % 3 == 2 else side + 1
            last = following - 2 if following % 3 == 2 else following + 1
            if starts[side] == p:
                x, past_p, past_q = apex_x[side], twins[last], twins[following]
            else:
                x, past_p, past_q = width - apex_x[side], twins[following], twins[last]
            apex, y = apexes[side], apex_y[side]
            a_x, a_y = p_x + x * along_x + y * along_y, p_y + x * along_y - y * along_x
            beyond_low = low_x * a_y - low_y * a_x >= 0
            before_high = a_x * high_y - a_y * high_x >= 0
            visible = beyond_low and before_high
            if visible and apex != source:
                if best[apex] == np.inf:
                    seen[n_seen] = apex
                    n_seen += 1
                best[apex] = min(best[apex], np.hypot(a_x, a_y))
            if beyond_low and past_p >= 0:
                names[queued] = (past_p, p, apex)
                end_x, end_y = (a_x, a_y) if visible else (high_x, high_y)
                plane[queued] = (p_x, p_y, a_x, a_y, low_x, low_y, end_x, end_y)
                queued += 1
            if before_high and past_q >= 0:
                names[queued] = (past_q, apex, q)
                end_x, end_y = (a_x, a_y) if visible else (low_x, low_y)
                plane[queued] = (a_x, a_y, q_x, q_y, end_x, end_y, high_x, high_y)
                queued += 1
        if arcs + n_seen > tails.size:
            tails = np.concatenate((tails, np.empty(tails.size + n_seen, np.int64)))
            heads = np.concatenate((heads, np.empty(heads.size + n_seen, np.int64)))
            sizes = np.concatenate((sizes, np.empty(sizes.size + n_seen, np.float64)))
        for at in range(n_seen):
            vertex = seen[at]
            tails[arcs], heads[arcs], sizes[arcs] = source, vertex, best[vertex]
            best[vertex] = np.inf
            arcs += 1
    return tails[:arcs], heads[:arcs], sizes[:arcs]
