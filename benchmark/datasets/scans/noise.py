"""Errors of a scanner: misaligned views, noise, outliers and holes."""

from __future__ import annotations

import numpy as np

from benchmark.datasets.scans.surfaces import face_normals, kept_part
from benchmark.geometry.interpolation import vertex_normals
from benchmark.geometry.mesh import Mesh, Points

SHARPNESS = 4.0
"""Sharpness of the seams between views: weights are exponentials of it times the cosine between view and surface."""

FAR_SHARE, FAR = 0.002, 5.0
"""Share of the vertices that are far off, and how much farther than the others."""


def misaligned(mesh: Mesh, views: int, deviation: float, random: np.random.Generator) -> Mesh:
    """Surface put together from views each of which has slipped by a vector of its own.

    Parameters
    ----------
    mesh
        A surface that looks outward.
    views
        How many.
    deviation
        Standard deviation of each coordinate of a slip, in units of the vertices.
    random
        Source of directions and slips.
    """
    directions = random.normal(size=(views, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = vertex_normals(mesh)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(min=np.finfo(float).tiny)
    weights = np.exp(SHARPNESS * normals @ directions.T)
    slips = random.normal(scale=deviation, size=(views, 3))
    return mesh.with_vertices(mesh.vertices + weights / weights.sum(axis=1, keepdims=True) @ slips)


def noisy(mesh: Mesh, deviation: float, random: np.random.Generator) -> Mesh:
    """Surface whose vertices are moved in all directions, a few of them far.

    Parameters
    ----------
    mesh
        A surface.
    deviation
        Standard deviation of each coordinate, in units of the vertices.
    random
        Source of the noise.
    """
    far = 1 + (FAR - 1) * (random.random(mesh.n_vertices) < FAR_SHARE)
    return mesh.with_vertices(mesh.vertices + random.normal(scale=deviation, size=(mesh.n_vertices, 3)) * far[:, None])


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
