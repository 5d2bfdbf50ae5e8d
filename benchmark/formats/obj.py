"""Wavefront OBJ: faces count vertices from 1; a negative corner counts back from the latest vertex.

Vertices, faces and their groups are read. Splines (``curv``, ``surf``) and other files (``call``)
are refused.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from benchmark.errors import UnreadableMesh
from benchmark.formats.ascii import (
    check_end,
    parse_numbers,
    parse_table,
    plain_text,
    rows_of,
    whole_numbers,
)
from benchmark.formats.base import Format, MeshArrays
from benchmark.geometry.mesh import IntArray, Mesh

_VERTEX = re.compile(rb"(?m)^[ \t]*v[ \t]+(\S.*)")
_FACE = re.compile(rb"(?m)^[ \t]*fo?[ \t]+(\S.*)")

#: Numbers of texture and normal behind the vertex of a corner: ``/1``, ``//2`` or ``/1/2``.
_TEXTURE_AND_NORMAL = re.compile(rb"/-?[0-9]*(?:/-?[0-9]*)?(?!\S)")

#: A line that begins with another word than those that say nothing of the surface.
_OTHER_LINE = re.compile(
    rb"(?m)^[ \t]*(?!(?:v[tnp]?|fo?|[lpgos]|mg|mtllib|usemtl|usemap|maplib|bevel|[cd]_interp|lod"
    rb"|shadow_obj|trace_obj)(?:[ \t]|$))([^ \t\n]+)"
)


def read(data: bytes, _: Path) -> MeshArrays:
    """Return the vertices and polygons of an OBJ file.

    Parameters
    ----------
    data
        Bytes of the file.

    Returns
    -------
    vertices : numpy.ndarray
        Shape (n, 3).
    corners : numpy.ndarray
        Vertices of all polygons one after the other, counted from 1, shape (k,).
    sizes : numpy.ndarray
        Number of corners of each polygon, shape (m,).

    Raises
    ------
    ValueError
        If there are no vertices, or a number is wrong.
    UnreadableMesh
        If it has lines that change the shape and are not read.
    """
    text = plain_text(data).replace(b"\\\n", b" ")  # a backslash continues a line
    vertices = list(_VERTEX.finditer(text))
    polygons = list(_FACE.finditer(text))
    if not vertices:
        raise ValueError("there is no line of a vertex, 'v x y z'")
    other = _OTHER_LINE.search(text)
    if other:
        word = other[1].decode("ascii", "backslashreplace")
        problem = f"it has lines '{word:.20}', which are not read"
        raise UnreadableMesh(problem, "export one file of triangles")
    sizes = np.array([len(polygon[1].split()) for polygon in polygons], dtype=np.int64)
    words = _TEXTURE_AND_NORMAL.sub(b"", b" ".join(polygon[1] for polygon in polygons))
    indices = whole_numbers(parse_numbers(words))
    if len(indices) != sizes.sum():
        raise ValueError("a corner of a face begins with a slash, and names no vertex")
    # Negative numbers count back from the last vertex before the polygon: -1 is that vertex.
    vertex_starts = np.array([vertex.start() for vertex in vertices])
    face_starts = np.array([polygon.start() for polygon in polygons], dtype=np.int64)
    n_vertices_before = np.repeat(np.searchsorted(vertex_starts, face_starts), sizes)
    corners = _counted_from_1(indices, n_vertices_before)
    check_end(data, corners, len(vertices))
    # Coordinates, with or without a weight and a colour. All of these must be numbers: a line break
    # may be missing, and a face follow.
    lines = [vertex[1] for vertex in vertices]
    parse_numbers(b" ".join(lines))
    return parse_table(lines, (3, 4, 6, 7)), corners, sizes


def _counted_from_1(indices: IntArray, latest: IntArray) -> IntArray:
    """Return corners that count forwards.

    Negative ones count back from the latest vertex before them.
    """
    forwards = indices + latest + 1
    is_missing = indices + latest < 0  # it counts back beyond the first vertex
    return np.where(indices < 0, np.where(is_missing, -1, forwards), indices)


def write(mesh: Mesh) -> bytes:
    """Return the content of an OBJ file."""
    return rows_of("v ", mesh.vertices) + rows_of("f ", mesh.faces + 1)


FORMAT = Format(
    module=__name__,
    extensions=(".obj",),
    first_vertex=1,
    read=read,
    write=write,
    extensions_beside=(".mtl",),
    preference=1,
)
