"""Interpolation from the vertices of a decimated mesh to points near its surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from benchmark.geometry.mesh import FloatArray, IntArray, Mesh, Points

#: Number of candidate triangles, those with the nearest centres, in the search for one on the same side.
_CANDIDATES = 30


def interpolate(mesh: Mesh, values: ArrayLike, points: ArrayLike, normals: ArrayLike) -> tuple[Points, FloatArray]:
    """Interpolate values at the vertices of a mesh linearly at points near its surface.

    Each point takes the values at the nearest position on the mesh, on a triangle with a similar normal if possible. If
    two parts of a body are close together, a point of one may be nearer to the decimated surface of the other. The
    parts face each other, so their normals differ. If the nearest triangle faces away from the normal of a point, its
    neighbours on the same side are searched instead.

    Parameters
    ----------
    mesh
        The mesh, with n vertices.
    values
        Values at its vertices, shape (n, k).
    points, normals
        The points and their surface normals, each of shape (m, 3).

    Returns
    -------
    values : numpy.ndarray
        Shape (m, k).
    distances : numpy.ndarray
        Distance of each point to its position on the mesh, shape (m,), in units of the mesh.
    """
    import igl

    queries, directions = np.asarray(points, dtype=np.float64), np.asarray(normals, dtype=np.float64)
    nearest = igl.point_mesh_squared_distance(queries, mesh.vertices, mesh.faces.astype(np.int64))
    triangles, places = np.array(nearest[1], dtype=np.int64), np.array(nearest[2])
    corners = mesh.vertices[mesh.faces]
    facing = mesh.face_normals
    turned = np.flatnonzero(np.einsum("mk,mk->m", facing[triangles], directions) < 0)
    if len(turned):
        others, at = _same_side(corners, facing, queries[turned], directions[turned])
        known = others >= 0
        triangles[turned[known]], places[turned[known]] = others[known], at[known]
    weights = _barycentric(corners[triangles], places)
    at_corners = np.asarray(values, dtype=np.float64)[mesh.faces[triangles]]
    return np.einsum("mc,mck->mk", weights, at_corners), np.linalg.norm(places - queries, axis=1)


def vertex_normals(mesh: Mesh) -> Points:
    """Return area-weighted vertex normals, not normalised, shape (n, 3)."""
    normals = np.zeros((mesh.n_vertices, 3))
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], mesh.face_normals)
    return normals


def _same_side(corners: Points, facing: Points, points: Points, directions: Points) -> tuple[IntArray, Points]:
    """Return the nearest triangle on the same side, or -1, and the position on it, among those with nearest centres."""
    from trimesh.triangles import closest_point

    count = min(_CANDIDATES, len(corners))
    _, near = cKDTree(corners.mean(axis=1)).query(points, k=count)
    near = np.asarray(near).reshape(len(points), count)
    places = closest_point(corners[near.ravel()], np.repeat(points, count, axis=0)).reshape(len(points), count, 3)
    distances = np.linalg.norm(places - points[:, None], axis=2)
    distances[np.einsum("mck,mk->mc", facing[near], directions) <= 0] = np.inf
    best = distances.argmin(axis=1)
    rows = np.arange(len(points))
    triangles = np.where(np.isfinite(distances[rows, best]), near[rows, best], -1)
    return triangles, places[rows, best]


def _barycentric(corners: Points, places: Points) -> Points:
    """Return barycentric coordinates of positions on triangles, shape (m, 3), clipped to the triangle."""
    from trimesh.triangles import points_to_barycentric

    weights = np.clip(np.nan_to_num(points_to_barycentric(corners, places, method="cramer")), 0.0, 1.0)
    total = weights.sum(axis=1, keepdims=True)
    return np.asarray(np.where(total > 0, weights / np.where(total > 0, total, 1.0), 1.0 / 3.0))
