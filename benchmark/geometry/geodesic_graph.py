"""Graphs over the vertices of a mesh whose shortest paths approximate geodesics."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.sparse import csr_array

from benchmark.geometry.mesh import FloatArray, IntArray, Mesh, sides_of

#: Default number of windows per vertex.
WINDOWS = 800

#: The same for thin meshes: rings reach far along their triangles, not across. Measured in
#: docs/measurements.md.
WINDOWS_OF_THIN = 2**16

#: A triangle is thin if its longest side is more than so many times its height.
THIN = 7.0

#: Share of such triangles above which a mesh is thin.
SHARE_OF_THIN = 0.1

#: Tangent of the angle below which a vertex lies on the boundary ray of a window, not inside the
#: window. The ray runs through a vertex, whose own windows cover the surface behind it. Regular
#: triangulations put many vertices on such rays; without this margin, rounding would decide which
#: of them split a window and thus how far windows reach.
GRAZING = 1e-9


def geodesic_graph(mesh: Mesh, windows: int | None = None) -> csr_array:
    """Return the graph of the straight geodesics between nearby vertices.

    Every shortest path on a triangle mesh is a chain of straight geodesics between vertices
    [Mitchell, Mount and Papadimitriou 1987]. The graph of *all* straight geodesics would therefore
    yield exact distances: the saddle vertex graph [Ying, Wang and He 2013]. As in that work, only
    geodesics in the neighbourhood of each vertex are kept. Each arc is a path on the surface, so
    that distances are never too short.

    The triangles around a vertex are unfolded into the plane. A *window* is the cone of straight
    lines from the vertex through a side of a triangle. A vertex inside the cone adds an arc, and
    splits the window in two. Windows are followed breadth first, ring by ring, until there are
    ``windows`` of them, so that the neighbourhood adapts to the size of the triangles.

    Parameters
    ----------
    mesh
        Any triangle mesh; windows end at boundaries and at edges with more than two faces.
    windows
        Number of windows to follow from each vertex; the ring that reaches it is completed. Larger
        values are slower and more accurate. None means :data:`WINDOWS`, or :data:`WINDOWS_OF_THIN`
        for meshes of thin triangles.

    Returns
    -------
    scipy.sparse.csr_array
        Lengths of the mesh edges and the arcs, in units of the mesh, symmetric, shape (n, n).
    """
    sides = _Sides(mesh)
    skips_detours = False
    if windows is None:
        skips_detours = _is_thin(mesh, sides)
        windows = WINDOWS_OF_THIN if skips_detours else WINDOWS
    # Group the sides by the vertex opposite: those of vertex v are
    # by_apex[offsets[v] : offsets[v + 1]].
    by_apex = np.argsort(sides.apexes, kind="stable")
    n_opposite = np.bincount(sides.apexes, minlength=mesh.n_vertices)
    offsets = np.concatenate(([0], np.cumsum(n_opposite)))
    first_names, first_plane = _first_windows(sides, by_apex)
    passages, moves = _passages(sides)
    tails, heads, lengths = _follow_windows(
        first_names,
        first_plane,
        passages,
        moves,
        _ends_of_passages(sides) if skips_detours else np.empty((0, 2), np.int64),
        offsets,
        windows,
        _most_windows(windows, int(n_opposite.max(initial=0))),
    )
    return _undirected(mesh.n_vertices, tails, heads, lengths)


def _is_thin(mesh: Mesh, sides: _Sides) -> bool:
    """Return whether many triangles of a mesh are long and thin.

    Around a fan of thin triangles, windows multiply at each turn, so that more of them are needed.
    """
    longest = sides.lengths.reshape(-1, 3).max(axis=1)
    # The height over the longest side is twice the area over its length.
    is_thin = longest**2 > THIN * 2 * mesh.face_areas
    return bool(is_thin.mean() > SHARE_OF_THIN)


def _most_windows(windows: int, most_first: int) -> int:
    """Return how many windows of one source are stored at most.

    Successors of the last ring are not stored. If that is the first ring, it has one window for
    each triangle at the source. If not, fewer than ``windows`` come before it, and each of those in
    the ring before has at most two successors. A window is written before it is counted, which
    takes one more place.

    Parameters
    ----------
    windows
        Number of windows at which the last ring begins.
    most_first
        Largest number of triangles at a vertex.
    """
    return max(3 * windows, most_first) + 1


def _first_windows(sides: _Sides, opposite: IntArray) -> tuple[IntArray, FloatArray]:
    """Return the first window through each side opposite a vertex.

    Returns
    -------
    names : numpy.ndarray
        Ends P and Q of the side, and the passage through it, shape (sides, 3).
    plane : numpy.ndarray
        Coordinates of P and of Q, shape (sides, 4).
    """
    starts = sides.starts[opposite]
    x = sides.apex_x[opposite]
    y = sides.apex_y[opposite]
    passages = _passage(sides, sides.twins[opposite], starts)
    names = np.stack((starts, sides.ends[opposite], passages), axis=1)
    return names, np.stack((-x, -y, sides.lengths[opposite] - x, -y), axis=1)


def _ends_of_passages(sides: _Sides) -> IntArray:
    """Return the vertices P and Q of each passage, shape (passages, 2); see :func:`_passages`."""
    forward_and_backward = (sides.starts, sides.ends, sides.ends, sides.starts)
    return np.stack(forward_and_backward, axis=1).reshape(-1, 2)


def _passages(sides: _Sides) -> tuple[IntArray, FloatArray]:
    """Return what a straight line meets that enters a triangle through one of its sides.

    A *passage* is a way into a triangle through a side PQ. It reaches the third corner of the
    triangle, the apex, and goes on through one of the other two sides: past P or past Q. Each side
    s has two passages, which differ in the names of its ends: P is the start of the side in passage
    2 s, and its end in passage 2 s + 1.

    Parameters
    ----------
    sides
        The sides of all triangles.

    Returns
    -------
    names : numpy.ndarray
        The vertex at the apex, the next passage past P and that past Q, -1 at a border; shape
        (passages, 3).
    moves : numpy.ndarray
        Coordinates of the apex along PQ and perpendicular to it, from P, in units of the length of
        PQ; shape (passages, 2).
    """
    # The other two sides of the triangle, as sides of its neighbours: that from the end of the side
    # to the apex, and that from the apex to the start of the side.
    beyond_end = _turn(sides.twins, 1)
    beyond_start = _turn(sides.twins, 2)
    # The columns of ``names`` with P at the start of the side, and with P at its end.
    forward = (
        sides.apexes,
        _passage(sides, beyond_start, sides.starts),
        _passage(sides, beyond_end, sides.apexes),
    )
    backward = (
        sides.apexes,
        _passage(sides, beyond_end, sides.ends),
        _passage(sides, beyond_start, sides.apexes),
    )
    names = np.stack((*forward, *backward), axis=1).reshape(-1, 3)
    # The apex as seen from the start of the side, and from its end.
    width = np.where(sides.lengths > 0, sides.lengths, 1.0)
    along = sides.apex_x / width
    beside = sides.apex_y / width
    moves = np.stack((along, beside, 1.0 - along, beside), axis=1).reshape(-1, 2)
    return names, moves


def _passage(sides: _Sides, twins: IntArray, start: IntArray) -> IntArray:
    """Return the passages through sides with P at a given vertex of each; -1 without a side."""
    return np.where(twins >= 0, 2 * twins + (sides.starts[twins] != start), -1)


def _turn(of_sides: IntArray, steps: int) -> IntArray:
    """Return for each side the value of the side ``steps`` later around its triangle."""
    return np.roll(of_sides.reshape(-1, 3), -steps, axis=1).ravel()


class _Sides:
    """The sides of all triangles; side 3 f + k runs from corner k to corner k + 1 of face f.

    ``starts``, ``ends`` and ``apexes`` are the vertices at both ends and at the opposite corner.
    ``twins`` is the side of the adjacent triangle along the same edge, -1 if it is not unique.
    ``apex_x`` and ``apex_y`` are coordinates of the opposite corner relative to the start of the
    side: parallel and perpendicular to it.
    """

    def __init__(self, mesh: Mesh) -> None:
        """Compute the geometry of all sides of the triangles of a mesh.

        Each triangle has three sides, so that all attributes have shape (3 m,):

        - ``starts``, ``ends``: the vertices at both ends of a side;
        - ``apexes``: the vertex opposite;
        - ``lengths``: the length of the side;
        - ``apex_x``, ``apex_y``: the position of the apex along the side, and its distance from it;
        - ``twins``: the side of the neighbouring triangle at the same edge, -1 for none.
        """
        self.starts, self.ends = sides_of(mesh.faces)
        self.apexes = _turn(self.starts, 2)
        along = mesh.vertices[self.ends] - mesh.vertices[self.starts]
        towards_apex = mesh.vertices[self.apexes] - mesh.vertices[self.starts]
        self.lengths = np.linalg.norm(along, axis=1)
        along /= np.where(self.lengths > 0, self.lengths, 1.0)[:, None]
        self.apex_x = (towards_apex * along).sum(axis=1)
        self.apex_y = np.linalg.norm(towards_apex - self.apex_x[:, None] * along, axis=1)

        # Twins are the two sides at each edge between two triangles, unless its ends coincide.
        edges = mesh.edges
        inner = edges.first[edges.counts == 2]
        first = edges.grouped_sides[inner]
        second = edges.grouped_sides[inner + 1]
        has_length = self.lengths[first] > 0
        self.twins = np.full(len(self.starts), -1, dtype=np.int64)
        self.twins[first[has_length]] = second[has_length]
        self.twins[second[has_length]] = first[has_length]


def _undirected(count: int, tails: IntArray, heads: IntArray, lengths: FloatArray) -> csr_array:
    """Build a graph from arcs, at most one from each vertex to each other.

    Opposite arcs get the shorter length.
    """
    # In a sparse matrix, no entry means 0: the shorter arc needs the larger value. Bits of lengths
    # rise with them.
    largest = np.iinfo(np.int64).max
    arcs = csr_array((largest - lengths.view(np.int64), (tails, heads)), shape=(count, count))
    both = arcs.maximum(arcs.T.tocsr())
    shortest = (largest - both.data).view(np.float64)
    return csr_array((shortest, both.indices, both.indptr), shape=(count, count))


@njit(cache=True, nogil=True)
def _follow_windows(first_names, first_plane, passages, moves, ends, first, budget, room):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Collect the arcs of :func:`geodesic_graph`.

    The source lies at the origin of every unfolded plane. A window consists of a passage through a
    side PQ and, in the plane, P, Q and the two rays that bound the cone. Q is anticlockwise of P as
    seen from the source.
    """
    count = first.size - 1
    # Room for 64 arcs per vertex to begin with; the arrays grow below if there are more.
    tails = np.empty(64 * count, np.int64)
    heads = np.empty(64 * count, np.int64)
    squares = np.empty(64 * count, np.float64)
    arcs = 0
    best = np.full(count, np.inf)
    # Distinct vertices with a finite ``best``, without the source; one extra entry, as a vertex is
    # written before it is counted.
    seen = np.empty(count, np.int64)
    queue = np.empty(room, np.int64)
    plane = np.empty((room, 8), np.float64)
    for source in range(count):
        best[source] = 0.0
        near = slice(first[source], first[source + 1])
        n_seen, queued = _begin_windows(
            first_names[near], first_plane[near], seen, best, queue, plane
        )
        window = 0
        ring_end = 0
        last_ring = False
        while window < queued:
            if window == ring_end:
                if window >= budget:
                    break
                ring_end = queued
                last_ring = ring_end >= budget
            passage = queue[window]
            p_x = plane[window, 0]
            p_y = plane[window, 1]
            q_x = plane[window, 2]
            q_y = plane[window, 3]
            low_x = plane[window, 4]
            low_y = plane[window, 5]
            high_x = plane[window, 6]
            high_y = plane[window, 7]
            is_detour = len(ends) and _is_detour(
                best[ends[passage, 0]], best[ends[passage, 1]], plane[window]
            )
            window += 1
            if is_detour:
                continue
            apex = passages[passage, 0]
            past_p = passages[passage, 1]
            past_q = passages[passage, 2]
            along = moves[passage, 0]
            beside = moves[passage, 1]
            width_x = q_x - p_x
            width_y = q_y - p_y
            a_x = p_x + along * width_x + beside * width_y
            a_y = p_y + along * width_y - beside * width_x
            beyond_low = low_x * a_y - low_y * a_x > GRAZING * abs(low_x * a_x + low_y * a_y)
            before_high = a_x * high_y - a_y * high_x > GRAZING * abs(a_x * high_x + a_y * high_y)
            # The apex side is unpredictable: writing first and counting afterwards is faster than
            # branching.
            visible = beyond_low & before_high
            square = a_x * a_x + a_y * a_y if visible else np.inf
            seen[n_seen] = apex
            n_seen += (square < np.inf) & (best[apex] == np.inf)
            best[apex] = min(best[apex], square)
            if last_ring:
                continue
            # The window between P and the apex, then that between the apex and Q.
            ray_x = a_x if visible else high_x
            ray_y = a_y if visible else high_y
            queue[queued] = past_p
            _place(plane[queued], p_x, p_y, a_x, a_y, low_x, low_y, ray_x, ray_y)
            queued += beyond_low & (past_p >= 0)
            ray_x = a_x if visible else low_x
            ray_y = a_y if visible else low_y
            queue[queued] = past_q
            _place(plane[queued], a_x, a_y, q_x, q_y, ray_x, ray_y, high_x, high_y)
            queued += before_high & (past_q >= 0)
        if arcs + n_seen > tails.size:
            tails = _enlarged(tails, n_seen)
            heads = _enlarged(heads, n_seen)
            squares = _enlarged(squares, n_seen)
        _store_arcs(source, seen[:n_seen], best, tails[arcs:], heads[arcs:], squares[arcs:])
        arcs += n_seen
    return tails[:arcs], heads[:arcs], np.sqrt(squares[:arcs])


@njit(cache=True, nogil=True)
def _begin_windows(names, ends, seen, best, queue, plane):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Begin the search from a source: write the windows through the sides opposite the source.

    Parameters
    ----------
    names
        Ends P and Q of each of these sides, and the passage through it, -1 for none; shape (sides,
        3).
    ends
        Coordinates of P and of Q in the plane with the source at the origin, shape (sides, 4).
    seen
        Written: the vertices that are reached.
    best
        Updated: the least squared distance of each vertex from the source; infinite if not reached.
    queue
        Written: the passage of each window.
    plane
        Written: coordinates of P, of Q, and of the two rays that bound each window, shape (room,
        8).

    Returns
    -------
    n_seen : int
        Number of vertices in ``seen``.
    queued : int
        Number of windows in ``queue``.
    """
    n_seen = 0
    queued = 0
    for number in range(len(names)):
        p_x = ends[number, 0]
        p_y = ends[number, 1]
        q_x = ends[number, 2]
        q_y = ends[number, 3]
        for vertex, square in (
            (names[number, 0], p_x * p_x + p_y * p_y),
            (names[number, 1], q_x * q_x + q_y * q_y),
        ):
            # A vertex is written in any case. The count advances, which keeps it, at its first
            # distance.
            seen[n_seen] = vertex
            n_seen += (square < np.inf) & (best[vertex] == np.inf)
            best[vertex] = min(best[vertex], square)
        if names[number, 2] >= 0:  # the rays of a first window go through P and Q themselves
            queue[queued] = names[number, 2]
            _place(plane[queued], p_x, p_y, q_x, q_y, p_x, p_y, q_x, q_y)
            queued += 1
    return n_seen, queued


@njit(cache=True, nogil=True)
def _enlarged(values, count):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return an array of twice the size, with ``count`` more entries."""
    return np.concatenate((values, np.empty(values.size + count, values.dtype)))


@njit(cache=True, nogil=True)
def _is_detour(square_p, square_q, row):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return whether a window leads nowhere by a shortest path.

    That is so if each path through the window is longer than a path by way of P or of Q, the ends
    of its side [Xin and Wang 2009, theorem 3.2].

    Parameters
    ----------
    square_p, square_q
        Squares of the least known distances of P and Q from the source; infinite if unknown.
    row
        Coordinates of P, of Q, and of the two rays that bound the window, low at P and high at Q;
        the source is the origin. Shape (8,).
    """
    p_x, p_y, q_x, q_y = row[0], row[1], row[2], row[3]
    low_x, low_y, high_x, high_y = row[4], row[5], row[6], row[7]
    # The vertex v is P, then Q. Of all points behind the window, those on the ray farthest from v
    # gain least by a way through v. It is enough to compare both ways to where that ray crosses PQ.
    for square, v_x, v_y, ray_x, ray_y in (
        (square_p, p_x, p_y, high_x, high_y),
        (square_q, q_x, q_y, low_x, low_y),
    ):
        # How far P and Q lie to the left of the ray, as cross products.
        from_p = ray_x * p_y - ray_y * p_x
        from_q = ray_x * q_y - ray_y * q_x
        if square < np.inf and from_p != from_q:
            share = from_p / (from_p - from_q)
            x = p_x + share * (q_x - p_x)
            y = p_y + share * (q_y - p_y)
            if np.sqrt(square) + np.hypot(x - v_x, y - v_y) < (1.0 - GRAZING) * np.hypot(x, y):
                return True
    return False


@njit(cache=True, nogil=True, inline="always")
def _place(row, p_x, p_y, q_x, q_y, low_x, low_y, high_x, high_y):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write P, Q and the two rays of a window."""
    row[0] = p_x
    row[1] = p_y
    row[2] = q_x
    row[3] = q_y
    row[4] = low_x
    row[5] = low_y
    row[6] = high_x
    row[7] = high_y


@njit(cache=True, nogil=True)
def _store_arcs(source, seen, best, tails, heads, squares):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write the arcs from the source to the seen vertices, and forget them."""
    for number in range(seen.size):
        vertex = seen[number]
        tails[number] = source
        heads[number] = vertex
        squares[number] = best[vertex]
        best[vertex] = np.inf
    best[source] = np.inf
