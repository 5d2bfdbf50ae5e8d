"""Surface that no scanner saw: patches anywhere, and what looks away from it."""

from __future__ import annotations

import numpy as np

from benchmark.datasets.scans.surfaces import face_normals, kept_part
from benchmark.geometry.mesh import Mesh, Points

ALONG = 0.7
"""Least cosine between the normal of a triangle and the direction in which a blind end looks."""


def patched(mesh: Mesh, radii: Points, random: np.random.Generator) -> Mesh:
    """Surface without a round patch of each radius, in units of the vertices, around vertices that are drawn."""
    normals, centres = face_normals(mesh), mesh.vertices[mesh.faces].mean(axis=1)
    kept = np.ones(mesh.n_faces, dtype=bool)
    for radius in radii:
        middle = random.integers(mesh.n_faces)
        near = np.linalg.norm(centres - centres[middle], axis=1) < radius
        # The other side of an arm is as near.
        kept &= ~(near & (normals @ normals[middle] > 0))
    return kept_part(mesh, kept)


def blind(mesh: Mesh, direction: Points, depth: float) -> Mesh:
    """Surface without its outermost end in a direction, such as soles or the crown of the head.

    Parameters
    ----------
    mesh
        A surface that looks outward.
    direction
        Unit vector, shape (3,).
    depth
        How far from the outermost point on, in units of the vertices.
    """
    heights = mesh.vertices[mesh.faces].mean(axis=1) @ direction
    return kept_part(mesh, ~((heights > heights.max() - depth) & (face_normals(mesh) @ direction > ALONG)))
