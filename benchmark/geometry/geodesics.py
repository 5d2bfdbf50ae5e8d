"""Geodesic distances on a triangle mesh."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from benchmark.errors import UnsupportedShape
from benchmark.geometry.cleaning import connected_components
from benchmark.geometry.geodesic_graph import geodesic_graph
from benchmark.geometry.mesh import FloatArray, Mesh
from benchmark.geometry.shortest_paths import shortest_paths

#: The graph of the latest mesh, for methods that request a few rows at a time.
_graph_of = lru_cache(maxsize=1)(geodesic_graph)


def all_pairs(mesh: Mesh) -> FloatArray:
    """Compute the geodesic distances between all pairs of vertices.

    Parameters
    ----------
    mesh
        A mesh with a single component.

    Returns
    -------
    numpy.ndarray
        Shape (n, n), symmetric with zero diagonal, in units of the mesh. The two directions are averaged, as rounding
        differs between them.

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
        hint = "join them (benchmark.geometry.bridging) or keep the largest, and drop unreferenced vertices"
        raise UnsupportedShape(problem, hint)
    return shortest_paths(_graph_of(mesh), indices)


def rounded(matrix: FloatArray) -> FloatArray:
    """Round distances to single precision; the result is float64.

    Seven digits are four more than the accuracy, and rounding removes most last-bit differences between
    processors, so that methods start from the same numbers on any machine.
    """
    return matrix.astype(np.float32).astype(np.float64)
