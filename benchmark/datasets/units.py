"""Meshes of files in the units of their data set."""

from __future__ import annotations

import math

from benchmark.geometry.mesh import Mesh


def mesh_in_metres(mesh: Mesh, unit: float) -> Mesh:
    """Return a mesh in metres, whose file has a unit of so many metres."""
    return mesh.with_vertices(unit * mesh.vertices)


def of_unit_area(mesh: Mesh) -> Mesh:
    """Return a mesh scaled to unit area; it must have one."""
    return mesh.with_vertices(1 / math.sqrt(mesh.area) * mesh.vertices)
