"""Changes of a scanned surface: wrapped, re-triangulated, welded where parts nearly touch."""

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
"""Share of the area beyond which a fault is left out: what remains must show a person."""


def face_normals(mesh: Mesh) -> Points:
    """Return the unit normals of the triangles, shape (m, 3)."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True).clip(min=np.finfo(float).tiny))


def kept_part(mesh: Mesh, kept: NDArray[np.bool_]) -> Mesh:
    """Largest component of some triangles, or the mesh as it is if too little were left.

    Parameters
    ----------
    mesh
        A surface.
    kept
        Which triangles remain, shape (m,).
    """
    if not kept.any():
        return mesh
    rest = largest_component(compact(mesh.vertices, mesh.faces[kept]))
    return rest if rest.area > (1 - LARGEST_LOSS) * mesh.area else mesh


SETTLED = 3.0
"""Multiple of the offset up to which the skin falls back onto the body; farther away it spans a gap."""


def wrapped(mesh: Mesh, ball: float, offset: float) -> Mesh:
    """Wrap a surface in a skin that settles on it [Portaneri et al. 2022, "Alpha wrapping with an offset"].

    Parameters
    ----------
    mesh
        A surface.
    ball
        Radius of the ball that must fit into what the skin enters, as a share of the diagonal of the bounding box.
    offset
        Distance at which the skin is made, as a share of the same.
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
"""Edges of the grid of clusters, in roots of the mean area of a vertex, that leave about as many as asked for."""


def subdivided(mesh: Mesh, times: int) -> Mesh:
    """Surface with each triangle cut into four, several times."""
    vertices, faces = igl.upsample(mesh.vertices, mesh.faces.astype(np.int64), times)
    return Mesh(vertices, faces.astype(np.int32))


def clustered(mesh: Mesh, n_vertices: int) -> Mesh:
    """Surface whose vertices are the means of what falls into the cells of a grid [Rossignac and Borrel 1993].

    Parameters
    ----------
    mesh
        A surface.
    n_vertices
        Vertices to come near to.
    """
    cell = SIDE / 2 * (mesh.area / n_vertices) ** 0.5
    clusters = filtered(mesh, "meshing_decimation_clustering", threshold=pymeshlab.PureValue(cell))
    # The filter gives the triangles in an order that hangs on where they lay in memory.
    first = clusters.faces.argmin(axis=1)[:, None]
    faces = np.take_along_axis(clusters.faces, (first + np.arange(3)) % 3, axis=1)
    return Mesh(clusters.vertices, faces[np.lexsort(faces.T[::-1])])


def collapsed(mesh: Mesh, n_vertices: int) -> Mesh:
    """Surface with its shortest edges collapsed onto vertices that it had, until so many are left."""
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
"""Largest cosine between the normals of two triangles that face each other."""

ASIDE = 0.5
"""Least share of the way between them that lies along the normal of either."""


def welded(mesh: Mesh, gap: float) -> Mesh:
    """Surface without the walls of gaps, whose rims meet halfway.

    A triangle is a wall if another one that faces it is nearer than the gap. What is left of either side ends at the
    mouth of the gap, where each vertex moves to the middle between itself and the nearest one across.

    Parameters
    ----------
    mesh
        A surface that looks outward.
    gap
        Width, in units of the vertices.
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
    """Vertices, those of a rim in the middle between themselves and the nearest across the gap that looks back."""
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
