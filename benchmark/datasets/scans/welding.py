"""Parts that nearly touch become one: closed hands, thighs, armpits; by the triangles, at little cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmark.datasets.scans.surfaces import face_normals, kept_part
from benchmark.geometry.mesh import Mesh, Points

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
    found = np.isfinite(distances)
    near = np.where(found, near, 0)
    across = found & (np.einsum("nk,nmk->nm", directions, directions[near]) < OPPOSED)
    first = across.argmax(axis=1)
    met = across[np.arange(len(rim)), first]
    vertices[rim[met]] = (places[met] + places[near[met, first[met]]]) / 2
    return vertices
