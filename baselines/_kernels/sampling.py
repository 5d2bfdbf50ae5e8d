"""Sampling of vertices evenly over a surface, by distances along its edges."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from baselines._kernels.orientation import largest
from benchmark.api.contracts import FloatArray, Shape
from benchmark.geometry.mesh import edges_of


def farthest_points(shape: Shape, count: int) -> list[int]:
    """Sample vertices so that each is as far as possible, along edges, from the previous ones.

    The first vertex is that of :func:`farthest_from_centre`. The choice follows any relabelling of the vertices, and
    any rigid motion as long as no two candidates tie; the first by its coordinates wins a tie.

    Parameters
    ----------
    shape
        A connected shape.
    count
        Number of samples.

    Returns
    -------
    list of int
        At most n vertex indices.
    """
    graph, vertices = edge_graph(shape), shape.mesh.vertices
    return _spread(graph, vertices, _farthest_from_centre(graph, vertices), count)


def farthest_from_centre(shape: Shape) -> int:
    """Return the vertex farthest, along edges, from the geodesic centre.

    The centre is the vertex with the smallest maximum distance to four mutually far vertices. This needs five rows of
    distances instead of all.
    """
    return _farthest_from_centre(edge_graph(shape), shape.mesh.vertices)


def squares_between(samples: list[int], rows: FloatArray) -> FloatArray:
    """Return the squared distances between the samples, symmetric to the last bit, shape (k, k).

    Parameters
    ----------
    samples
        Vertices from which the distances are known, k of them.
    rows
        Their distances to all vertices, shape (k, n).
    """
    squares = rows[:, samples] ** 2
    return (squares + squares.T) / 2


def stress_of_rows(points: FloatArray, sources: list[int], rows: FloatArray) -> float:
    """Return the normalised stress over the pairs with known geodesic distance.

    Parameters
    ----------
    points
        Positions of all vertices, shape (n, 3).
    sources
        Vertices from which the distances are known, k of them.
    rows
        Their distances to all vertices, shape (k, n).
    """
    distances = np.linalg.norm(points[sources][:, None] - points, axis=2)
    return float(((distances - rows) ** 2).sum() / (rows**2).sum())


def _farthest_from_centre(graph: csr_array, vertices: FloatArray) -> int:
    outermost = largest(((vertices - vertices.mean(axis=0)) ** 2).sum(axis=1), vertices)
    far = _spread(graph, vertices, outermost, 4)
    centre = largest(-dijkstra(graph, indices=far).max(axis=0), vertices)
    return largest(dijkstra(graph, indices=centre), vertices)


def _spread(graph: csr_array, vertices: FloatArray, first: int, count: int) -> list[int]:
    chosen = [first]
    nearest = dijkstra(graph, indices=first)
    while len(chosen) < min(count, len(nearest)):
        chosen.append(largest(nearest, vertices))
        # No vertex is farther than this from its nearest sample, so the search can stop there.
        np.minimum(nearest, dijkstra(graph, indices=chosen[-1], limit=nearest.max()), out=nearest)
    return chosen


def edge_graph(shape: Shape) -> csr_array:
    """Return the edge lengths of a shape as a symmetric sparse matrix, shape (n, n)."""
    vertices, n = shape.mesh.vertices, shape.mesh.n_vertices
    ends = edges_of(shape.mesh.faces).ends
    start, end = np.concatenate([ends, ends[:, ::-1]]).T
    lengths = np.linalg.norm(vertices[start] - vertices[end], axis=1)
    return csr_array(coo_array((lengths, (start, end)), shape=(n, n)))
