"""Geodesic distances on a triangle mesh, with a choice of solvers."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from benchmark.errors import UnsupportedShape, check_known
from benchmark.geometry.cleaning import connected_components, fans_per_vertex
from benchmark.geometry.geodesic_graph import geodesic_graph
from benchmark.geometry.mesh import FloatArray, IntArray, Mesh
from benchmark.geometry.shortest_paths import shortest_paths


@lru_cache(maxsize=1)
def _graph_of(mesh: Mesh) -> csr_array:
    """Return the cached graph of the latest mesh, for methods that request a few rows at a time."""
    return geodesic_graph(mesh)


def _heat(mesh: Mesh, sources: IntArray) -> FloatArray:
    import potpourri3d

    try:
        solver = potpourri3d.MeshHeatMethodDistanceSolver(mesh.vertices, mesh.faces)
    except RuntimeError as error:
        problem = f"the heat method cannot treat this mesh ({error})"
        raise UnsupportedShape(problem, "use another solver, or clean the mesh") from error
    return np.stack([solver.compute_distance(int(source)) for source in sources])


def _exact(mesh: Mesh, sources: IntArray) -> FloatArray:
    import igl

    # On anything but a proper manifold, libigl reads out of bounds and crashes the process.
    if (mesh.edges.counts > 2).any() or (fans_per_vertex(mesh) > 1).any() or not (mesh.edge_lengths > 0).all():
        problem = "the exact solver needs a manifold without edges of length zero"
        raise UnsupportedShape(problem, "clean the mesh (benchmark.geometry.cleaning), or use another solver")
    faces = mesh.faces.astype(np.int64)
    everywhere = np.arange(mesh.n_vertices, dtype=np.int64)
    distances = np.stack([igl.exact_geodesic(mesh.vertices, faces, VS=at, VT=everywhere) for at in sources[:, None]])
    straight = np.linalg.norm(mesh.vertices[sources][:, None, :] - mesh.vertices[None, :, :], axis=2)
    # libigl returns 0, not infinity, for unreached vertices; no geodesic is shorter than the straight line.
    if not (np.isfinite(distances).all() and (distances >= straight * (1 - 1e-6)).all()):
        raise UnsupportedShape("the exact solver did not reach every vertex", "clean the mesh: it is not a manifold")
    return distances


_BY_NAME: dict[str, Callable[[Mesh, IntArray], FloatArray]] = {
    "geodesic-graph": lambda mesh, sources: shortest_paths(_graph_of(mesh), sources),
    "dijkstra": lambda mesh, sources: shortest_paths(mesh.edge_graph(), sources),
    "heat": _heat,
    "exact": _exact,
}
SOLVERS: tuple[str, ...] = tuple(_BY_NAME)
DEFAULT_SOLVER: str = "geodesic-graph"


def all_pairs(mesh: Mesh, solver: str = DEFAULT_SOLVER) -> FloatArray:
    """Compute the geodesic distances between all pairs of vertices.

    Parameters
    ----------
    mesh
        A mesh with a single component.
    solver
        A name from :data:`SOLVERS`.

    Returns
    -------
    numpy.ndarray
        Shape (n, n), symmetric with zero diagonal, in units of the mesh. The two directions are averaged, as they
        differ slightly in the heat method.

    Raises
    ------
    UnsupportedShape
        If the mesh has more than one component, or the solver does not support it.
    ConfigurationError
        If the solver is unknown.
    """
    distances = from_sources(mesh, np.arange(mesh.n_vertices), solver)
    distances = (distances + distances.T) / 2
    np.fill_diagonal(distances, 0.0)
    return distances


def from_sources(mesh: Mesh, sources: ArrayLike, solver: str = DEFAULT_SOLVER) -> FloatArray:
    """Compute the geodesic distances from some vertices to all vertices.

    Parameters
    ----------
    mesh
        A mesh with a single component.
    sources
        Vertex indices, shape (k,).
    solver
        As in :func:`all_pairs`.

    Returns
    -------
    numpy.ndarray
        Shape (k, n), in units of the mesh.

    Raises
    ------
    UnsupportedShape
        If the mesh has more than one component, a source is not a vertex, or the solver does not support the mesh.
    ConfigurationError
        If the solver is unknown.
    """
    check_known("geodesic solver", [solver], SOLVERS)
    indices = np.asarray(sources, dtype=np.int64).reshape(-1)
    if indices.size and not (indices.min() >= 0 and indices.max() < mesh.n_vertices):
        problem = f"a source lies outside the {mesh.n_vertices} vertices"
        raise UnsupportedShape(problem, "count vertices from 0 and leave none negative")
    components = int(connected_components(mesh).max(initial=-1)) + 1
    if components != 1:
        problem = f"the mesh has {components} components, so some geodesic distances do not exist"
        hint = "join them (benchmark.geometry.bridging) or keep the largest, and drop unreferenced vertices"
        raise UnsupportedShape(problem, hint)
    if not indices.size:
        return np.empty((0, mesh.n_vertices))
    return _BY_NAME[solver](mesh, indices)


def rounded(matrix: FloatArray) -> FloatArray:
    """Round distances to single precision; the result is float64.

    Seven digits are four more than the accuracy of any solver, and rounding removes most last-bit differences between
    processors, so that methods start from the same numbers on any machine.
    """
    return matrix.astype(np.float32).astype(np.float64)
