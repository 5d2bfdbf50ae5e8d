"""The contents of mesh files as arrays: OFF, OBJ, PLY, STL, MAT and the ``.vert``/``.tri`` pair.

Every reader takes bytes and returns vertices and faces (n, 3), 0-based, in the order of the file; polygons are cut into
fans. What is not understood raises ``ValueError`` with the reason; :mod:`benchmark.geometry.io` adds the file name.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

Arrays = tuple[NDArray[np.float64], NDArray[np.int64]]


def read_off(data: bytes) -> Arrays:
    """Read the Object File Format of Geomview: comments, counts on the first or the next line, polygons, colours."""
    if b"#" in data:
        data = re.sub(rb"#[^\n]*", b"", data)
    header = re.match(rb"\s*(?:ST)?(?:C?N?|N?C?)OFF\s+(\d+)\s+(\d+)(?:[ \t]+\d+)?\s*", data)
    if header is None:
        raise ValueError("the header is not OFF followed by the counts of vertices and faces")
    n_vertices, n_faces = int(header[1]), int(header[2])
    lines = [line for line in data[header.end() :].splitlines() if line.strip()]
    if len(lines) < n_vertices + n_faces:
        raise ValueError(f"{n_vertices} vertices and {n_faces} faces announced, but only {len(lines)} lines follow")
    vertices = _table(lines[:n_vertices])[:, :3]
    return vertices, _counted_polygons(lines[n_vertices : n_vertices + n_faces])


def read_obj(data: bytes) -> Arrays:
    """Read the vertices and faces of Wavefront OBJ; texture, normals, groups and materials are passed over."""
    lines = [line.strip() for line in data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()]
    vertex_lines = [line[2:] for line in lines if line.startswith((b"v ", b"v\t"))]
    face_lines = [line[2:] for line in lines if line.startswith((b"f ", b"f\t"))]
    if not vertex_lines:
        raise ValueError("there is no line of a vertex, 'v x y z'")
    vertices = _table(vertex_lines)[:, :3]
    joined = re.sub(rb"/\S*", b"", b"\n".join(face_lines))
    polygons = [line.partition(b"#")[0].split() for line in joined.splitlines()]
    if b"-" not in joined:
        return vertices, _fans(polygons) - 1
    # Negative indices count back from the last vertex before the face.
    before = np.cumsum([line.startswith((b"v ", b"v\t")) for line in lines])
    at_face = before[[line.startswith((b"f ", b"f\t")) for line in lines]]
    absolute = [
        [int(token) if int(token) > 0 else int(count) + int(token) + 1 for token in polygon]
        for polygon, count in zip(polygons, at_face, strict=True)
    ]
    return vertices, _fans(absolute) - 1


def read_stl(data: bytes) -> Arrays:
    """Read STL, ascii or binary; corners at exactly the same position become one vertex."""
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(data, record, offset=84)["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid" and b"vertex" in data:
        corners = _table(re.findall(rb"^\s*vertex\s+([^\n]*)", data, re.MULTILINE))
        if len(corners) % 3 or len(corners) != 3 * len(re.findall(rb"^\s*endfacet", data, re.MULTILINE)):
            raise ValueError("a facet has not three vertices or does not end")
    else:
        raise ValueError(f"{len(data)} bytes are neither an ascii STL nor a binary one of {count} triangles")
    corners = corners + 0.0  # -0.0 and 0.0 are one position
    _, first, inverse = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return corners[np.sort(first)], rank[inverse.reshape(-1)].reshape(-1, 3).astype(np.int64)


def read_mat(data: bytes) -> Arrays:
    """Read the MATLAB struct ``surface`` of TOSCA: X, Y, Z and the 1-based triangles TRIV."""
    surface = loadmat(io.BytesIO(data), squeeze_me=True, struct_as_record=False, variable_names=["surface"])["surface"]
    vertices = np.stack([np.asarray(getattr(surface, axis), dtype=np.float64).ravel() for axis in "XYZ"], axis=1)
    return vertices, _integers(np.asarray(surface.TRIV, dtype=np.float64).reshape(-1, 3)) - 1


def read_vert_tri(vert: bytes, tri: bytes) -> Arrays:
    """Read the ascii pair of TOSCA; triangles count from 1, as published, unless one of them names vertex 0."""
    vertices = _table(vert.splitlines())
    faces = _integers(_table(tri.splitlines()))
    if vertices.shape[1] != 3 or faces.shape[1] != 3:
        raise ValueError("a line of the .vert or .tri file has not three numbers")
    return vertices, faces - (1 if faces.size and faces.min() > 0 else 0)


_PLY_TYPES = {
    **{"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2"},
    **{"uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4"},
    **{"double": "f8", "float64": "f8"},
}
# Name, type, and type of the count in front of a list; None for a scalar.
_Property = tuple[str, str, str | None]
_Element = tuple[str, int, list[_Property]]


def read_ply(data: bytes) -> Arrays:
    """Read the Stanford polygon format, ascii or binary of either byte order."""
    header = re.match(rb"ply\r?\n.*?end_header[ \t]*(?:\r\n|\n)", data, re.DOTALL)
    if header is None:
        raise ValueError("the header does not run from 'ply' to 'end_header'")
    encoding, elements = _ply_header(header[0].decode("ascii", errors="replace"))
    body = data[header.end() :]
    read: Callable[[bytes, _Element], tuple[dict[str, Any], bytes]]
    if encoding == "ascii":
        read = _ply_ascii
    else:
        order = "<" if encoding == "binary_little_endian" else ">"

        def read(body: bytes, element: _Element) -> tuple[dict[str, Any], bytes]:
            return _ply_binary(body, element, order)

    columns: dict[str, dict[str, Any]] = {}
    for element in elements:
        columns[element[0]], body = read(body, element)
    vertex, face = columns["vertex"], columns.get("face", {})
    polygons = face.get("vertex_indices", face.get("vertex_index"))
    if polygons is None:
        raise ValueError("there is no element 'face' with a list 'vertex_indices'")
    return np.stack([np.asarray(vertex[axis], dtype=np.float64) for axis in "xyz"], axis=1), _fans(polygons)


def _ply_header(text: str) -> tuple[str, list[_Element]]:
    encoding, elements = "", list[_Element]()
    for line in text.splitlines():
        match line.split():
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as name, _]:
                encoding = name
            case ["element", name, count]:
                elements.append((name, int(count), []))
            case ["property", "list", count_type, item_type, name]:
                elements[-1][2].append((name, _PLY_TYPES[item_type], _PLY_TYPES[count_type]))
            case ["property", scalar, name]:
                elements[-1][2].append((name, _PLY_TYPES[scalar], None))
    if not encoding or "vertex" not in [name for name, _, _ in elements]:
        raise ValueError("the header names no known format or no element 'vertex'")
    return encoding, elements


def _ply_ascii(body: bytes, element: _Element) -> tuple[dict[str, Any], bytes]:
    name, count, properties = element
    parts = body.lstrip().split(b"\n", count)
    lines, rest = parts[:count], parts[count] if len(parts) > count else b""
    if len(lines) < count or (count and not lines[-1].strip()):
        raise ValueError(f"{count} lines of element '{name}' announced, fewer found")
    if not any(listed for _, _, listed in properties):
        table = _table(lines, least=len(properties))
        if count and table.shape[1] != len(properties):
            raise ValueError(f"a line of element '{name}' has not {len(properties)} numbers")
        return {key: table[:, at] for at, (key, _, _) in enumerate(properties)} if count else {}, rest
    columns: dict[str, Any] = {key: [] for key, _, _ in properties}
    for line in lines:
        tokens = iter(line.split())
        for key, _, listed in properties:
            first = next(tokens)
            columns[key].append([int(next(tokens)) for _ in range(int(first))] if listed else float(first))
    return columns, rest


def _ply_binary(body: bytes, element: _Element, order: str) -> tuple[dict[str, Any], bytes]:
    _, count, properties = element
    # Most files hold triangles alone: read every list as if it had three items and check.
    fields: list[Any] = []
    for at, (_, kind, listed) in enumerate(properties):
        fields += (
            [(f"count{at}", order + listed), (f"item{at}", order + kind, 3)]
            if listed
            else [(f"item{at}", order + kind)]
        )
    record = np.dtype(fields)
    if len(body) >= count * record.itemsize:
        rows = np.frombuffer(body, record, count)
        if all((rows[f"count{at}"] == 3).all() for at, (_, _, listed) in enumerate(properties) if listed):
            triangles = {key: rows[f"item{at}"] for at, (key, _, _) in enumerate(properties)}
            return triangles, body[count * record.itemsize :]
    columns: dict[str, list[Any]] = {key: [] for key, _, _ in properties}
    offset = 0
    for _ in range(count):
        for key, kind, listed in properties:
            length = 1
            if listed:
                length = int(np.frombuffer(body, order + listed, 1, offset)[0])
                offset += np.dtype(listed).itemsize
            items = np.frombuffer(body, order + kind, length, offset)
            offset += items.nbytes
            columns[key].append(items.tolist() if listed else items[0])
    return columns, body[offset:]


def _table(lines: list[bytes], least: int = 3) -> NDArray[np.float64]:
    """Parse lines with the same number of numbers each, at least ``least``; empty lines are passed over."""
    lines = [line for line in lines if line.strip()]
    if not lines:
        return np.empty((0, 3))
    width = len(lines[0].split())
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            numbers = np.fromstring(b" ".join(lines).decode("ascii"), sep=" ")
        except (DeprecationWarning, UnicodeDecodeError) as error:
            raise ValueError("a coordinate is not a number") from error
    if len(numbers) != width * len(lines) or width < least:
        raise ValueError("a line of coordinates has too few or too many numbers")
    return numbers.reshape(-1, width)


def _integers(numbers: NDArray[np.float64]) -> NDArray[np.int64]:
    whole = np.where(np.isfinite(numbers), numbers, 0.5)
    if (whole != np.floor(whole)).any() or (np.abs(whole) > 2**53).any():
        raise ValueError("a vertex index is not an integer")
    return whole.astype(np.int64)


def _counted_polygons(lines: list[bytes]) -> NDArray[np.int64]:
    """Parse lines that hold the number of corners, the corners, and perhaps a colour."""
    if all(line.lstrip()[:2] in (b"3 ", b"3\t") for line in lines):
        try:
            return _integers(_table(lines)[:, 1:4]) if lines else np.empty((0, 3), dtype=np.int64)
        except (ValueError, IndexError):
            pass  # lines of different length: some faces have colours
    polygons = []
    for line in lines:
        tokens = line.split()
        corners = tokens[1 : 1 + int(tokens[0])]
        if len(corners) < int(tokens[0]):
            raise ValueError("a face has fewer corners than it announces")
        polygons.append(corners)
    return _fans(polygons)


def _fans(polygons: Any) -> NDArray[np.int64]:
    """Cut polygons, given as lists of vertex indices, into fans of triangles around their first corner."""
    if isinstance(polygons, np.ndarray):
        return _integers(polygons.astype(np.float64))
    sizes = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    if (sizes < 3).any():
        raise ValueError("a face has fewer than three corners")
    if (sizes == 3).all():
        return np.array(polygons, dtype=np.int64).reshape(-1, 3)
    triangles = [
        (polygon[0], polygon[corner], polygon[corner + 1])
        for polygon in polygons
        for corner in range(1, len(polygon) - 1)
    ]
    return np.array(triangles, dtype=np.int64)
