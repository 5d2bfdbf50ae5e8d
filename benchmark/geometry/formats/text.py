"""OFF, OBJ, the ``.vert``/``.tri`` pair, and STL."""

from __future__ import annotations

import re

import numpy as np

from benchmark.geometry.formats.parsing import (
    Arrays,
    content_lines,
    corner_count,
    counted_lines,
    counted_polygons,
    fans,
    parsed,
    table,
    whole,
    whole_number,
)


def read_off(data: bytes) -> Arrays:
    """Read Geomview OFF, with comments, counts on the first or the next line, polygons and colours."""
    if b"#" in data:
        data = re.sub(rb"#[^\n]*", b" ", data)
    header = re.match(rb"\s*(?:ST)?(?:C?N?|N?C?)OFF\s+([0-9]+)\s+([0-9]+)(?:[ \t]+[0-9]+)?\s*", data)
    if header is None:
        raise ValueError("the header is not OFF followed by the counts of vertices and faces")
    n_vertices, n_faces = whole_number(header[1]), whole_number(header[2])
    lines = counted_lines(data[header.end() :])
    if len(lines) != n_vertices + n_faces:
        raise ValueError(f"{n_vertices} vertices and {n_faces} faces announced, but {len(lines)} lines follow")
    vertices = table(lines[:n_vertices])[:, :3]
    return vertices, counted_polygons(lines[n_vertices:])


def read_obj(data: bytes) -> Arrays:
    """Read the vertices and faces of Wavefront OBJ; textures, normals, groups and materials are ignored."""
    lines = content_lines(data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" "))
    is_vertex = [line.startswith((b"v ", b"v\t")) for line in lines]
    is_face = [line.startswith((b"f ", b"f\t")) for line in lines]
    if not any(is_vertex):
        raise ValueError("there is no line of a vertex, 'v x y z'")
    vertices = table([line[2:] for line, of_vertex in zip(lines, is_vertex, strict=True) if of_vertex])[:, :3]
    faces = [line[2:].partition(b"#")[0] for line, of_face in zip(lines, is_face, strict=True) if of_face]
    corners = re.sub(rb"/\S*", b"", b"\n".join(faces)).split(b"\n") if faces else []
    sizes = [corner_count(len(polygon.split())) for polygon in corners]
    indices = whole(parsed(corners, sum(sizes)))
    # Negative indices count back from the last vertex before the face; 0 is invalid.
    before = np.repeat(np.cumsum(is_vertex)[np.asarray(is_face, dtype=bool)], sizes)
    return vertices, fans(np.where(indices < 0, indices + before, indices - 1), sizes)


def read_vert_tri(vert: bytes, tri: bytes) -> Arrays:
    """Read the TOSCA ASCII pair; triangles are 1-based, as published, unless one of them contains vertex 0."""
    vertices = table(content_lines(vert))
    faces = whole(table(content_lines(tri)))
    if vertices.shape[1] != 3 or faces.shape[1] != 3:
        raise ValueError("a line of the .vert or .tri file has not three numbers")
    return vertices, faces - (1 if faces.size and faces.min() > 0 else 0)


_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(data: bytes) -> Arrays:
    """Read ASCII or binary STL; corners at exactly the same position become a single vertex."""
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if len(data) == 84 + _FACET.itemsize * count:
        corners = np.frombuffer(data, _FACET, offset=84)["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid" and b"vertex" in data:
        lines = content_lines(data)
        if not lines[-1].startswith(b"endsolid"):
            raise ValueError("it does not end with 'endsolid'")
        corners = table([line[7:] for line in lines if line.startswith((b"vertex ", b"vertex\t"))])
        if len(corners) % 3 or len(corners) != 3 * sum(line.startswith(b"endfacet") for line in lines):
            raise ValueError("a facet has not three vertices or does not end")
        if corners.shape[1] != 3:
            raise ValueError("a vertex has not three coordinates")
    else:
        raise ValueError(f"{len(data)} bytes are neither an ascii STL nor a binary one of {count} triangles")
    corners = corners + 0.0  # -0.0 equals 0.0
    _, first, inverse = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return corners[np.sort(first)], rank[inverse.reshape(-1)].reshape(-1, 3).astype(np.int64)
