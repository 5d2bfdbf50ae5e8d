"""Meshes as other libraries hold them: trimesh, Open3D, PyMeshLab, arrays, and files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmark.datasets.mesh_files import read_surface
from benchmark.errors import InvalidMesh
from benchmark.geometry.mesh import Mesh

#: What is taken as a mesh, in words.
TAKEN = (
    "a trimesh.Trimesh, an Open3D TriangleMesh, a pymeshlab.Mesh, a pair of arrays (vertices, "
    "faces), or the path of a mesh file"
)


def as_mesh(given: Any, faces: Any = None) -> Mesh:
    """Return a mesh of another library, or in a file, as a mesh of the suite.

    Vertices keep their order.

    Parameters
    ----------
    given
        A ``trimesh.Trimesh``, an Open3D ``TriangleMesh`` of either kind, a ``pymeshlab.Mesh``, a
        pair of arrays, the path of a file, or coordinates of vertices, shape (n, 3).
    faces
        Vertex indices of the triangles, shape (m, 3), if the vertices alone are given.

    Raises
    ------
    InvalidMesh
        If it is none of these, or no valid mesh.
    UnreadableMesh
        If a file cannot be read.
    """
    if faces is not None:
        return Mesh(given, faces)
    if isinstance(given, Mesh):
        return given
    if isinstance(given, str | Path):
        return read_surface(Path(given))
    if isinstance(given, tuple | list) and len(given) == 2:
        return Mesh(given[0], given[1])
    vertices, triangles = _vertices_and_triangles(given)
    if vertices is None or triangles is None:
        problem = f"a {type(given).__module__}.{type(given).__name__} is no triangle mesh"
        raise InvalidMesh(problem, f"pass {TAKEN}")
    return Mesh(vertices, triangles)


def _vertices_and_triangles(given: Any) -> tuple[Any, Any]:
    """Return the arrays of a mesh, or of a cloud of points, of another library.

    The library is recognised by attributes of the object, so that none has to be imported.

    Returns
    -------
    vertices, triangles : array or None
        Coordinates, and vertex indices of the corners; None for what the object lacks.
    """
    if hasattr(given, "to_legacy"):  # a mesh of Open3D that is held in tensors
        given = given.to_legacy()
    if hasattr(given, "vertex_matrix"):  # PyMeshLab
        return given.vertex_matrix(), given.face_matrix()
    vertices = getattr(given, "vertices", None)
    if vertices is None:
        return None, None
    faces = getattr(given, "faces", None)  # trimesh, whose ``triangles`` are coordinates
    if faces is not None:
        return vertices, faces
    return vertices, getattr(given, "triangles", None)  # Open3D
