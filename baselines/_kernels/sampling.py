"""Vertices that are spread over a surface, from distances along its edges."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from benchmark.contracts import FloatArray, Shape
from benchmark.geometry.edges import edges_of


def farthest_points(shape: Shape, count: int) -> list[int]:
    """Sample vertices so that each is as far as possible, along edges, from those before it.

    The first vertex is the one that :func:`farthest_from_centre` gives. The choice follows any relabelling of the
    vertices, as long as no two candidates tie, and any rigid motion.

    Parameters
    ----------
    shape
        A shape in one piece.
    count
        Number of samples.

    Returns
    -------
    list of int
        At most n vertex indices.
    """
    graph = _edge_graph(shape)
    return _spread(graph, _farthest_from_centre(graph, _outermost(shape)), count)


def farthest_from_centre(shape: Shape) -> int:
    """Return the vertex farthest, along edges, from the geodesic centre.

    The centre is the vertex whose largest distance to four mutually far vertices is smallest: five rows of distances
    instead of all.
    """
    return _farthest_from_centre(_edge_graph(shape), _outermost(shape))


def stress_of_rows(points: FloatArray, sources: list[int], rows: FloatArray) -> float:
    """Normalised stress over the pairs whose geodesic distance is known.

    Parameters
    ----------
    points
        Positions of all vertices, shape (n, 3).
    sources
        Vertices from which the distances are known, k of them.
    rows
        Their distances to all vertices, shape (k, n).
    """
    found = np.linalg.norm(points[sources][:, None] - points, axis=2)
    return float(((found - rows) ** 2).sum() / (rows**2).sum())


def _farthest_from_centre(graph: csr_array, outermost: int) -> int:
    far = _spread(graph, outermost, 4)
    centre = int(dijkstra(graph, indices=far).max(axis=0).argmin())
    return int(dijkstra(graph, indices=centre).argmax())


def _outermost(shape: Shape) -> int:
    vertices = shape.mesh.vertices
    return int(((vertices - vertices.mean(axis=0)) ** 2).sum(axis=1).argmax())


def _spread(graph: csr_array, first: int, count: int) -> list[int]:
    chosen = [first]
    nearest = dijkstra(graph, indices=first)
    while len(chosen) < min(count, len(nearest)):
        chosen.append(int(nearest.argmax()))
        # No vertex is farther from its nearest sample than the new one was, so the search may end there.
        np.minimum(nearest, dijkstra(graph, indices=chosen[-1], limit=nearest[chosen[-1]]), out=nearest)
    return chosen


def _edge_graph(shape: Shape) -> csr_array:
    vertices, n = shape.mesh.vertices, shape.mesh.n_vertices
    ends = edges_of(shape.mesh.faces).ends
    start, end = np.concatenate([ends, ends[:, ::-1]]).T
    lengths = np.linalg.norm(vertices[start] - vertices[end], axis=1)
    return csr_array(coo_array((lengths, (start, end)), shape=(n, n)))
