"""Scanner errors: misaligned views, noise, outliers and holes."""

from __future__ import annotations

import numpy as np

from benchmark.datasets.scans.surfaces import face_normals, kept_part
from benchmark.geometry.interpolation import vertex_normals
from benchmark.geometry.mesh import Mesh, Points

SHARPNESS = 4.0
"""Sharpness of seams between views: weights are exponentials of it times the cosine between view and normal."""

FAR_SHARE, FAR = 0.002, 5.0
"""Fraction of outlier vertices, and their noise relative to the other vertices."""


def misaligned(mesh: Mesh, views: int, deviation: float, random: np.random.Generator) -> Mesh:
    """Merge a surface from views that are misaligned by individual translations.

    Parameters
    ----------
    mesh
        A surface with outward normals.
    views
        Number of views.
    deviation
        Standard deviation per coordinate of a translation, in units of the vertices.
    random
        Random generator for directions and translations.
    """
    directions = random.normal(size=(views, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = vertex_normals(mesh)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(min=np.finfo(float).tiny)
    weights = np.exp(SHARPNESS * normals @ directions.T)
    slips = random.normal(scale=deviation, size=(views, 3))
    return mesh.with_vertices(mesh.vertices + weights / weights.sum(axis=1, keepdims=True) @ slips)


def noisy(mesh: Mesh, deviation: float, random: np.random.Generator) -> Mesh:
    """Add Gaussian noise to the vertices, with a few outliers.

    Parameters
    ----------
    mesh
        A surface.
    deviation
        Standard deviation per coordinate, in units of the vertices.
    random
        Random generator.
    """
    far = 1 + (FAR - 1) * (random.random(mesh.n_vertices) < FAR_SHARE)
    return mesh.with_vertices(mesh.vertices + random.normal(scale=deviation, size=(mesh.n_vertices, 3)) * far[:, None])


ALONG = 0.7
"""Minimum cosine between the normal of a triangle and the direction of a blind end."""


def patched(mesh: Mesh, radii: Points, random: np.random.Generator) -> Mesh:
    """Remove a round patch of each radius, in units of the vertices, around random triangles."""
    normals, centres = face_normals(mesh), mesh.vertices[mesh.faces].mean(axis=1)
    kept = np.ones(mesh.n_faces, dtype=bool)
    for radius in radii:
        middle = random.integers(mesh.n_faces)
        near = np.linalg.norm(centres - centres[middle], axis=1) < radius
        # Keep the other side of an arm, which is also near.
        kept &= ~(near & (normals @ normals[middle] > 0))
    return kept_part(mesh, kept)


def blind(mesh: Mesh, direction: Points, depth: float) -> Mesh:
    """Remove the outermost end of a surface in a direction, such as soles or the crown of the head.

    Parameters
    ----------
    mesh
        A surface with outward normals.
    direction
        Unit vector, shape (3,).
    depth
        Depth of the removed part from the outermost point, in units of the vertices.
    """
    heights = mesh.vertices[mesh.faces].mean(axis=1) @ direction
    return kept_part(mesh, ~((heights > heights.max() - depth) & (face_normals(mesh) @ direction > ALONG)))
