"""Interpolation from the vertices of a decimated mesh to points near its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from benchmark.geometry.mesh import Mesh, Points

__all__ = ["SurfaceMap", "nearest_on_surface", "vertex_normals"]

#: Number of candidate triangles, those with the nearest centres, in the search for one on the same side.
_CANDIDATES = 30


@dataclass(frozen=True, eq=False)
class SurfaceMap:
    """Positions of points on a mesh.

    Parameters
    ----------
    corners
        The three vertices of the triangle of each point, shape (m, 3).
    weights
        Barycentric coordinates of each point, shape (m, 3), none negative; they sum to 1.
    distances
        Distance of each point to its position on the mesh, shape (m,), in units of the mesh.
    """

    corners: NDArray[np.int64]
    weights: Points
    distances: Points

    def carry(self, values: ArrayLike) -> Points:
        """Interpolate values at the mesh vertices, shape (n, k), linearly at the points; returns shape (m, k)."""
        at_corners = np.asarray(values, dtype=np.float64)[self.corners]
        return np.asarray(np.einsum("mc,mck->mk", self.weights, at_corners))


def nearest_on_surface(mesh: Mesh, points: ArrayLike, normals: ArrayLike) -> SurfaceMap:
    """Find the nearest position on a mesh for each point, on a triangle with a similar normal if possible.

    If two parts of a body are close together, a point of one may be nearer to the decimated surface of the other. The
    parts face each other, so their normals differ. If the nearest triangle faces away from the normal of a point, its
    neighbours on the same side are searched instead.

    Parameters
    ----------
    mesh
        Mesh to project onto.
    points, normals
        The points and their surface normals, each of shape (m, 3).

    Returns
    -------
    SurfaceMap
        Triangles and barycentric coordinates.
    """
    import igl

    queries, directions = np.asarray(points, dtype=np.float64), np.asarray(normals, dtype=np.float64)
    nearest = igl.point_mesh_squared_distance(queries, mesh.vertices, mesh.faces.astype(np.int64))
    triangles, places = np.array(nearest[1], dtype=np.int64), np.array(nearest[2])
    corners = mesh.vertices[mesh.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    turned = np.flatnonzero(np.einsum("mk,mk->m", facing[triangles], directions) < 0)
    if len(turned):
        others, at = _same_side(corners, facing, queries[turned], directions[turned])
        known = others >= 0
        triangles[turned[known]], places[turned[known]] = others[known], at[known]
    weights = _barycentric(corners[triangles], places)
    distances = np.linalg.norm(places - queries, axis=1)
    return SurfaceMap(mesh.faces[triangles].astype(np.int64), weights, distances)


def vertex_normals(mesh: Mesh) -> Points:
    """Return area-weighted vertex normals, not normalised, shape (n, 3)."""
    corners = mesh.vertices[mesh.faces]
    of_faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros((mesh.n_vertices, 3))
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], of_faces)
    return normals


def _same_side(corners: Points, facing: Points, points: Points, directions: Points) -> tuple[NDArray[np.int64], Points]:
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
