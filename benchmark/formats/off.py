"""Geomview OFF, as text: faces count vertices from 0.

A vertex may go on with a normal, a colour or a texture, as the header says (``NOFF``, ``COFF``,
``STOFF``), and a face with a colour.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from benchmark.errors import UnreadableMesh
from benchmark.formats.ascii import (
    filled_lines,
    parse_numbers,
    parse_table,
    plain_text,
    rows_of,
    whole_numbers,
)
from benchmark.formats.base import Format, MeshArrays
from benchmark.geometry.mesh import IntArray, Mesh
from benchmark.text import counted

_HEADER = re.compile(
    rb"(?:((?:ST)?C?N?C?)OFF)?\s*(\d{1,12})\s+(\d{1,12})(?:[ \t]+\d+)?[ \t]*\n", re.IGNORECASE
)

#: Headers of vertices with other coordinates than three.
_OTHER_DIMENSION = re.compile(rb"(?:ST)?C?N?(?:4n?|n)OFF")


def read(data: bytes, _: Path) -> MeshArrays:
    """Return the vertices and polygons of an OFF file.

    Parameters
    ----------
    data
        Bytes of the file: the word OFF, numbers of vertices and faces, a line for each vertex, and
        one for each face: the number of its corners, and these, counted from 0. Both may have
        colours.

    Returns
    -------
    vertices : numpy.ndarray
        Shape (n, 3).
    corners : numpy.ndarray
        Vertices of all polygons one after the other, shape (k,). If all are triangles, it may be
        an array of shape (m, 3), and sizes are left out.
    sizes : numpy.ndarray
        Number of corners of each polygon, shape (m,).

    Raises
    ------
    ValueError
        If the header is wrong, or another number of lines follows.
    """
    text = plain_text(data).lstrip()
    header = _HEADER.match(text)
    if not header:
        _check_kind(text)
        raise ValueError(
            "it does not begin with OFF (or with ST, C and N before it, in this order) and the "
            "numbers of vertices and faces"
        )
    n_vertices = int(header[2])
    n_faces = int(header[3])
    body = text[header.end() :]
    lines = filled_lines(body)
    if len(lines) in (1, n_vertices + n_faces):
        # The usual case, which is read as one array: coordinates and triangles alone.
        triangle_mesh = _triangle_mesh(body, n_vertices, n_faces)
        if triangle_mesh:
            return triangle_mesh
    if len(lines) != n_vertices + n_faces:
        raise ValueError(
            f"{n_vertices} vertices and {n_faces} faces announced, but {len(lines)} lines follow"
        )
    lines_of_vertices = lines[:n_vertices]
    width = _numbers_of_a_vertex(header[1] or b"")
    _check_colours(lines_of_vertices, width)
    vertices = parse_table(lines_of_vertices, (width, width + 3, width + 4))
    corners, sizes = _counted_polygons(lines[n_vertices:])
    return vertices, corners, sizes


def _check_kind(text: bytes) -> None:
    """Raise ``UnreadableMesh`` if it is a kind of OFF that is not read."""
    first = text[:100].split()
    if first and _OTHER_DIMENSION.fullmatch(first[0]):
        raise UnreadableMesh("n-dimensional OFF is not read", "export three coordinates a vertex")
    if first[1:2] == [b"BINARY"]:
        raise UnreadableMesh("binary OFF is not read", "export it as text, or as .ply")


def _check_colours(lines: Sequence[bytes], width: int) -> None:
    """Raise ``UnreadableMesh`` if each vertex has one number more than it should."""
    if lines and {len(line.split()) for line in lines} == {width + 1}:
        problem = "each vertex has one number behind its coordinates, such as a packed colour"
        raise UnreadableMesh(problem, "export it without colours")


def _numbers_of_a_vertex(prefix: bytes) -> int:
    """Return how many numbers a vertex has without its colour, from what stands before OFF."""
    width = 3
    if b"N" in prefix.upper():
        width += 3
    if b"S" in prefix.upper():
        width += 2
    return width


def _counted_polygons(lines: Sequence[bytes]) -> tuple[IntArray, IntArray]:
    """Parse lines of the number of corners, the corners, and perhaps a colour."""
    rows = [line.split() for line in lines]
    sizes = whole_numbers(parse_numbers(b" ".join(row[0] for row in rows)))
    corners: list[bytes] = []
    for number, (row, size) in enumerate(zip(rows, sizes, strict=True), 1):
        if len(row) <= size or (size == 0 and len(row) > 1):
            count = counted(len(row) - 1, "corner")
            raise ValueError(f"face {number} of {len(rows)} has {count}, not {size}")
        corners += row[1 : 1 + size]
    return whole_numbers(parse_numbers(b" ".join(corners))), sizes


def _triangle_mesh(body: bytes, n_vertices: int, n_faces: int) -> MeshArrays | None:
    """Read the vertices and triangles of an OFF file, if it holds nothing else.

    Parameters
    ----------
    body
        All bytes behind the header.
    n_vertices, n_faces
        Numbers that the header announces.

    Returns
    -------
    tuple or None
        Vertices, shape (n, 3), and triangles, shape (m, 3); None if the file holds anything else.
    """
    try:
        numbers = parse_numbers(body)
    except ValueError:
        return None
    # Three numbers a vertex; four a triangle, of which the first is 3.
    n_coordinates = 3 * n_vertices
    if len(numbers) != n_coordinates + 4 * n_faces:
        return None
    vertices = numbers[:n_coordinates].reshape(-1, 3)
    faces = numbers[n_coordinates:].reshape(-1, 4)
    are_triangles = (faces[:, 0] == 3).all()
    if not are_triangles:
        return None
    return vertices, whole_numbers(faces[:, 1:])


def write(mesh: Mesh) -> bytes:
    """Return the content of an OFF file."""
    header = b"OFF\n%d %d 0\n" % (mesh.n_vertices, mesh.n_faces)
    return header + rows_of("", mesh.vertices) + rows_of("3 ", mesh.faces)


FORMAT = Format(
    module=__name__,
    extensions=(".off",),
    first_vertex=0,
    read=read,
    write=write,
    preference=0,
)
