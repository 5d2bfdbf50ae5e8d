"""Surfaces of a given area, for files that hold no size."""

from __future__ import annotations

import math

from benchmark.geometry.mesh import Mesh


def scaled_to_area(mesh: Mesh, area: float) -> Mesh:
    """Return a mesh scaled to an area; one without area stays as it is, and is refused later."""
    if mesh.area <= 0:
        return mesh
    return mesh.with_vertices(math.sqrt(area / mesh.area) * mesh.vertices)


def key_with_area(key: str, area: float) -> str:
    """Return the key of a mesh that is scaled to an area; the key of the file if that is 0."""
    return f"{key} scaled to area {area!r}" if area else key
