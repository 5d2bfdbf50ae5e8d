"""Facts of triangles, and parts of surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.cleaning import compact, largest_component
from benchmark.geometry.mesh import Mesh, Points

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
