"""Requirements of spectral and MDS methods on a shape."""

from __future__ import annotations

from benchmark.api.contracts import Shape, UnsupportedShape
from benchmark.geometry.cleaning import connected_components

MINIMUM_VERTICES = 4
"""Three coordinates and a residual need four points: any three points lie in a plane."""

MOST_WITH_ALL_PAIRS = 20_000
"""Maximum number of vertices for all pairwise distances: their 3 GiB fit into an ordinary memory a few times."""


def require_vertices(shape: Shape, minimum: int = MINIMUM_VERTICES) -> None:
    """Raise ``UnsupportedShape`` unless the shape has at least ``minimum`` vertices and one face."""
    n_vertices = shape.mesh.n_vertices
    if n_vertices < minimum or not shape.mesh.n_faces:
        raise UnsupportedShape(
            f"{shape.identifier}: {n_vertices} vertices and {shape.mesh.n_faces} faces, "
            f"where at least {minimum} vertices and one face are needed",
            "check how the shape was cut or decimated",
        )


def require_connected(shape: Shape) -> None:
    """Raise ``UnsupportedShape`` unless the edges connect all vertices.

    The Laplacian of a surface in several pieces has several zero eigenvalues, so "the first non-constant
    eigenfunction" would separate the pieces instead of describing the surface.
    """
    components = int(connected_components(shape.mesh).max(initial=-1)) + 1
    if components > 1:
        raise UnsupportedShape(
            f"{shape.identifier}: the surface is in {components} pieces",
            "keep the largest component or bridge the pieces first",
        )


def require_pairs(shape: Shape) -> None:
    """Raise ``UnsupportedShape`` if the shape has too many vertices for all pairwise distances."""
    if shape.mesh.n_vertices > MOST_WITH_ALL_PAIRS:
        raise UnsupportedShape(
            f"{shape.identifier}: {shape.mesh.n_vertices} vertices, where the distances of all pairs are kept of "
            f"{MOST_WITH_ALL_PAIRS} at most",
            "decimate the surface, or choose a method that needs a few rows, such as accelerated-mds",
        )
