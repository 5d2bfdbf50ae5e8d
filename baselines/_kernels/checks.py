"""What a shape must have before a spectral or MDS method may treat it."""

from __future__ import annotations

from benchmark.contracts import Shape, UnsupportedShape

MINIMUM_VERTICES = 4
"""Three coordinates and a residual need four points: any three points lie in a plane."""


def require_vertices(shape: Shape, minimum: int = MINIMUM_VERTICES) -> None:
    """Raise ``UnsupportedShape`` unless the shape has at least ``minimum`` vertices and one face."""
    found = shape.mesh.n_vertices
    if found < minimum or not shape.mesh.n_faces:
        raise UnsupportedShape(
            f"{shape.identifier}: {found} vertices and {shape.mesh.n_faces} faces, "
            f"where at least {minimum} vertices and one face are needed",
            "check how the shape was cut or decimated",
        )


def require_connected(shape: Shape) -> None:
    """Raise ``UnsupportedShape`` unless the edges join all vertices into one component.

    The Laplacian of a surface in several pieces has several zero eigenvalues, so "the first non-constant
    eigenfunction" would tell the pieces apart instead of describing the surface.
    """
    import numpy as np
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    faces, n = shape.mesh.faces, shape.mesh.n_vertices
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    graph = coo_array((np.ones(len(start), dtype=np.int8), (start, end)), shape=(n, n))
    components = connected_components(graph, directed=False, return_labels=False)
    if components > 1:
        raise UnsupportedShape(
            f"{shape.identifier}: the surface is in {components} pieces",
            "keep the largest component or bridge the pieces first",
        )
