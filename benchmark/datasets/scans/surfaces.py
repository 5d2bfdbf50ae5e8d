"""Modifications of scanned surfaces: wrapping, re-triangulation, and welding of nearly touching parts."""

from __future__ import annotations

import igl
import numpy as np
import pymeshlab
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmark.geometry.cleaning import compact, largest_component
from benchmark.geometry.mesh import Mesh, Points
from benchmark.geometry.preparation import filtered

LARGEST_LOSS = 0.4
"""Maximum fraction of the area that a fault may remove; larger faults are omitted, so that a person remains visible."""


def face_normals(mesh: Mesh) -> Points:
    """Return the unit normals of the triangles, shape (m, 3)."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True).clip(min=np.finfo(float).tiny))


def kept_part(mesh: Mesh, kept: NDArray[np.bool_]) -> Mesh:
    """Return the largest component of the kept triangles, or the unchanged mesh if too little would remain.

    Parameters
    ----------
    mesh
        A surface.
    kept
        Mask of the kept triangles, shape (m,).
    """
    if not kept.any():
        return mesh
    rest = largest_component(compact(mesh.vertices, mesh.faces[kept]))
    return rest if rest.area > (1 - LARGEST_LOSS) * mesh.area else mesh


SETTLED = 3.0
"""Maximum distance for projecting the skin onto the body, as a multiple of the offset; farther away, it spans a gap."""


def wrapped(mesh: Mesh, ball: float, offset: float) -> Mesh:
    """Wrap a surface in a skin and project the skin back [Portaneri et al. 2022, "Alpha wrapping with an offset"].

    Parameters
    ----------
    mesh
        A surface.
    ball
        Radius of the ball that must fit into cavities entered by the skin, as a fraction of the bounding box diagonal.
    offset
        Offset of the skin, as a fraction of the bounding box diagonal.
    """
    skin = filtered(
        mesh,
        "generate_alpha_wrap",
        alpha=pymeshlab.PercentageValue(100 * ball),
        offset=pymeshlab.PercentageValue(100 * offset),
    )
    squares, _, feet = igl.point_mesh_squared_distance(skin.vertices, mesh.vertices, mesh.faces.astype(np.int64))
    near = squares < (SETTLED * offset * np.linalg.norm(np.ptp(mesh.vertices, axis=0))) ** 2
    return skin.with_vertices(np.where(near[:, None], feet, skin.vertices))


SIDE = 2.2
"""Grid cell size for about the target number of vertices, relative to the root of the mean area per vertex."""


def subdivided(mesh: Mesh, times: int) -> Mesh:
    """Split each triangle into four, repeatedly."""
    vertices, faces = igl.upsample(mesh.vertices, mesh.faces.astype(np.int64), times)
    return Mesh(vertices, faces.astype(np.int32))


def clustered(mesh: Mesh, n_vertices: int) -> Mesh:
    """Merge the vertices in each cell of a grid into their mean [Rossignac and Borrel 1993].

    Parameters
    ----------
    mesh
        A surface.
    n_vertices
        Approximate number of vertices.
    """
    cell = SIDE / 2 * (mesh.area / n_vertices) ** 0.5
    clusters = filtered(mesh, "meshing_decimation_clustering", threshold=pymeshlab.PureValue(cell))
    # The order of triangles from the filter depends on memory addresses.
    first = clusters.faces.argmin(axis=1)[:, None]
    faces = np.take_along_axis(clusters.faces, (first + np.arange(3)) % 3, axis=1)
    return Mesh(clusters.vertices, faces[np.lexsort(faces.T[::-1])])


def collapsed(mesh: Mesh, n_vertices: int) -> Mesh:
    """Decimate a surface by collapsing edges onto existing vertices, to about ``n_vertices``."""
    return filtered(
        mesh,
        "meshing_decimation_quadric_edge_collapse",
        targetfacenum=2 * n_vertices,
        targetperc=0.0,
        qualitythr=0.5,
        preserveboundary=True,
        boundaryweight=1.0,
        preservenormal=True,
        preservetopology=False,
        optimalplacement=False,
        planarquadric=False,
        planarweight=0.001,
        qualityweight=False,
        autoclean=True,
        selected=False,
    )


OPPOSED = -0.5
"""Maximum cosine between the normals of facing triangles."""

ASIDE = 0.5
"""Minimum cosine between the normals of facing triangles and the line between their centres."""


def welded(mesh: Mesh, gap: float) -> Mesh:
    """Close gaps: remove their walls and join the rims halfway.

    A triangle is a wall if a facing triangle is nearer than the gap width. The remaining surface ends at the mouth of
    the gap, where each vertex moves to the midpoint between itself and the nearest vertex on the other side.

    Parameters
    ----------
    mesh
        A surface with outward normals.
    gap
        Gap width, in units of the vertices.
    """
    normals, centres = face_normals(mesh), mesh.vertices[mesh.faces].mean(axis=1)
    one, other = cKDTree(centres).query_pairs(gap, output_type="ndarray").T
    opposed = np.einsum("pk,pk->p", normals[one], normals[other]) < OPPOSED
    one, other = one[opposed], other[opposed]
    ways = centres[other] - centres[one]
    least = ASIDE * np.linalg.norm(ways, axis=1)
    facing = np.einsum("pk,pk->p", normals[one], ways) > least
    facing &= np.einsum("pk,pk->p", normals[other], -ways) > least
    walls = np.zeros(mesh.n_faces, dtype=bool)
    walls[one[facing]] = walls[other[facing]] = True
    rim = np.intersect1d(mesh.faces[walls], mesh.faces[~walls])
    directions = np.zeros_like(mesh.vertices)
    np.add.at(directions, mesh.faces[walls].ravel(), np.repeat(normals[walls], 3, axis=0))
    return kept_part(mesh.with_vertices(_met(mesh.vertices, directions, rim, gap)), ~walls)


def _met(before: Points, directions: Points, rim: NDArray[np.int32], gap: float) -> Points:
    """Move each rim vertex to the midpoint between itself and the nearest facing vertex across the gap."""
    vertices = np.array(before)
    if len(rim) < 2:
        return vertices
    directions = directions[rim] / np.linalg.norm(directions[rim], axis=1, keepdims=True).clip(min=1e-12)
    places = vertices[rim]
    distances, near = cKDTree(places).query(places, k=min(12, len(rim)), distance_upper_bound=gap)
    reached = np.isfinite(distances)
    near = np.where(reached, near, 0)
    across = reached & (np.einsum("nk,nmk->nm", directions, directions[near]) < OPPOSED)
    first = across.argmax(axis=1)
    met = across[np.arange(len(rim)), first]
    vertices[rim[met]] = (places[met] + places[near[met, first[met]]]) / 2
    return vertices
