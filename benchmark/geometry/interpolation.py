"""Interpolation from the vertices of a decimated mesh to points near its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from benchmark.geometry.mesh import Mesh, Points

__all__ = ["SurfaceMap", "nearest_on_surface", "vertex_normals"]

#: Triangles of the right side that are looked at, those with the nearest centres.
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
        How far each point was from its place on the mesh, shape (m,), in units of the mesh.
    """

    corners: NDArray[np.int64]
    weights: Points
    distances: Points

    def carry(self, values: ArrayLike) -> Points:
        """Values at the vertices of the mesh, shape (n, k), interpolated linearly at the points, shape (m, k)."""
        at_corners = np.asarray(values, dtype=np.float64)[self.corners]
        return np.asarray(np.einsum("mc,mck->mk", self.weights, at_corners))


def nearest_on_surface(mesh: Mesh, points: ArrayLike, normals: ArrayLike) -> SurfaceMap:
    """Find the nearest place on a mesh for each point, on a triangle that looks the same way where there is one.

    Where two parts of a body lie close together, a point of one may be nearer to the decimated surface of the other;
    but the two face each other, so that the normal tells them apart. Of a point whose nearest triangle looks the other
    way, the triangles around that look its way are searched again.

    Parameters
    ----------
    mesh
        The mesh.
    points, normals
        The points and which way the surface looks there, each of shape (m, 3).

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
    """Direction in which the surface looks at each vertex, the mean over its triangles by area, shape (n, 3)."""
    corners = mesh.vertices[mesh.faces]
    of_faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros((mesh.n_vertices, 3))
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], of_faces)
    return normals


def _same_side(corners: Points, facing: Points, points: Points, directions: Points) -> tuple[NDArray[np.int64], Points]:
    """Nearest triangle that looks the same way, or -1, and the place on it, among those with the nearest centres."""
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
    """Barycentric coordinates of places on triangles, shape (m, 3), cut to what lies inside."""
    from trimesh.triangles import points_to_barycentric

    weights = np.clip(np.nan_to_num(points_to_barycentric(corners, places, method="cramer")), 0.0, 1.0)
    total = weights.sum(axis=1, keepdims=True)
    return np.asarray(np.where(total > 0, weights / np.where(total > 0, total, 1.0), 1.0 / 3.0))
