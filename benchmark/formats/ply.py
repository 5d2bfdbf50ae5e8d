"""PLY, as text or binary in either byte order: faces count vertices from 0.

The elements ``vertex`` and ``face`` are read, with properties of any number and in any order.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.formats.ascii import (
    filled_lines,
    is_padding,
    parse_numbers,
    plain_text,
    whole_numbers,
)
from benchmark.formats.base import Format, MeshArrays
from benchmark.geometry.mesh import IntArray, Mesh

#: Sign of the byte order of each format of a header; numbers of text are parsed as doubles.
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}

#: Types of numbers of a header, as numpy writes them.
_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}

Run = NDArray[Any]
"""Rows of an element whose lists are of the same lengths, as a structured array."""


class _Field(NamedTuple):
    """A property of an element.

    Parameters
    ----------
    name
        Its name.
    type
        Type of its numbers, as numpy writes it.
    size_type
        Type of the length of a list; "" for a number.
    """

    name: str
    type: str
    size_type: str


class _Element(NamedTuple):
    """An element of a header."""

    name: str
    n_rows: int
    fields: list[_Field]


def read(data: bytes, _: Path) -> MeshArrays:
    """Return the vertices and polygons of a PLY file, text or binary.

    Parameters
    ----------
    data
        Bytes of the file.

    Returns
    -------
    vertices : numpy.ndarray
        Shape (n, 3).
    corners : numpy.ndarray
        Vertices of all polygons one after the other, counted from 0, shape (k,); empty for a point
        cloud, without sizes.
    sizes : numpy.ndarray
        Number of corners of each polygon, shape (m,).

    Raises
    ------
    ValueError
        If the header is not understood, or other data follow than it announces.
    """
    header, body = _split_header(data)
    elements, is_text = _elements(header)
    names = [element.name for element in elements]
    is_known = "vertex" in names and "tristrips" not in names
    if not is_known or len(names) > len({*names}):
        raise ValueError(
            f"it has the elements {', '.join(names) or 'none'}, not vertex and face alone"
        )
    lines: list[bytes] = []
    if is_text:
        lines = filled_lines(plain_text(body))
        body = parse_numbers(b" ".join(lines)).tobytes()
    # The numbers of a text are now floats in bytes, and read like those of a binary file.
    runs = _runs(elements, body)
    if is_text:
        _check_lines(lines, runs)
    vertices = np.concatenate(list(map(_coordinates, runs["vertex"]))).astype(np.float64)
    is_point_cloud = "face" not in names
    if is_point_cloud:
        return vertices, np.empty(0, dtype=np.int64)
    corners, sizes = _polygons(runs["face"])
    return vertices, corners, sizes


def _polygons(faces: Sequence[Run]) -> tuple[IntArray, IntArray]:
    """Return the corners of all polygons one after the other, and how many each polygon has.

    Parameters
    ----------
    faces
        Rows of the faces, in runs of polygons with equal numbers of corners.
    """
    fields = faces[0].dtype.names or ()
    name_of_corners = "vertex_index" if "vertex_index" in fields else "vertex_indices"
    corners_of_runs = [run[name_of_corners] for run in faces]
    sizes = np.concatenate([np.full(len(run), run.shape[1]) for run in corners_of_runs])
    corners = np.concatenate([run.ravel() for run in corners_of_runs])
    return whole_numbers(corners), sizes


def _coordinates(run: Run) -> NDArray[Any]:
    """Return the coordinates in rows of vertices, shape (n, 3)."""
    return np.stack([run["x"], run["y"], run["z"]], axis=1)


def _split_header(data: bytes) -> tuple[list[str], bytes]:
    """Return the lines of the header behind ``ply``, and what follows it."""
    breaks = (b"\r\n", b"\n", b"\r")
    end = next((end for end in breaks if data.startswith(b"ply" + end)), b"\n")
    head, mark, body = data.partition(end + b"end_header" + end)
    if not data.startswith(b"ply" + end) or not mark:
        raise ValueError("it does not begin with a header between the lines 'ply' and 'end_header'")
    # Comments may hold any characters, of which other bytes than these end no line.
    return head.decode("latin-1").split(end.decode())[1:], body


def _elements(lines: Sequence[str]) -> tuple[list[_Element], bool]:
    """Parse the header of a PLY file.

    It says how numbers are written (``format``), and names each ``element``, such as ``vertex``,
    with the number of its rows and the fields (``property``) of a row. A field may be a list.

    Parameters
    ----------
    lines
        Lines of the header.

    Returns
    -------
    elements : list of _Element
        What the file holds, such as vertices and faces, with the fields of a row of each.
    is_text : bool
        Whether the numbers are text, not binary.

    Raises
    ------
    ValueError
        If a line is not understood.
    """
    elements: list[_Element] = []
    order: str | None = None  # byte order of the numbers, "" for text; None before its line
    for line in lines:
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if order is None and name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, count] if order is not None and re.fullmatch(
                "[0-9]{1,18}", count
            ):
                elements.append(_Element(name, int(count), []))
            case ["property", kind, name] if elements and kind in _TYPES:
                field = _Field(name, _type_in_file(kind, order), "")
                elements[-1].fields.append(field)
            case ["property", "list", size, kind, name] if (
                elements and {size, kind} <= _TYPES.keys()
            ):
                field = _Field(name, _type_in_file(kind, order), _type_in_file(size, order))
                elements[-1].fields.append(field)
            case _:
                raise ValueError(f"the line '{line:.80}' of its header is not read")
    return elements, order == ""


def _type_in_file(kind: str, order: str | None) -> str:
    """Return the type of numbers, as numpy writes it, in the byte order of a file."""
    return order + _TYPES[kind] if order else "<f8"


def _runs(elements: Sequence[_Element], body: bytes) -> Mapping[str, Sequence[Run]]:
    """Return the rows of each element; raise ``ValueError`` if something follows them."""
    runs: dict[str, list[Run]] = {}
    at = 0
    for element in elements:
        runs[element.name] = _element_runs(body, at, element)
        at += sum(run.nbytes for run in runs[element.name])
    if not is_padding(body[at:]):
        raise ValueError(f"{len(body) - at} bytes follow the rows that its header announces")
    return runs


def _check_lines(lines: Sequence[bytes], runs: Mapping[str, Sequence[Run]]) -> None:
    """Raise ``ValueError`` unless each line of a text holds one row."""
    widths: list[int] = []
    for run in chain.from_iterable(runs.values()):
        widths += [run.itemsize // 8] * len(run)
    if widths != [len(line.split()) for line in lines]:
        raise ValueError("its lines are not the rows that its header announces")


def _element_runs(data: bytes, at: int, element: _Element) -> list[Run]:
    """Return the rows of an element in runs: consecutive rows whose lists have equal lengths.

    A row may hold lists, such as the corners of a polygon. Only rows with lists of the same lengths
    can be read as one array, which is much faster.

    Parameters
    ----------
    data
        Numbers of the file; those of a text are converted.
    at
        Where the element begins.
    element
        Name, number of rows and fields.

    Returns
    -------
    list of numpy.ndarray
        Structured arrays; a single empty one for an element without rows.

    Raises
    ------
    ValueError
        If the data end before the rows that are announced.
    """
    runs: list[Run] = []
    n_left = element.n_rows
    n_tried = n_left
    while n_left or not runs:
        run, is_cut = _run_at(data, at, element, n_left, n_tried)
        # After a cut, one row is tried, then twice as many each time: short runs cost little.
        n_tried = 1 if is_cut else 2 * n_tried
        runs.append(run)
        at += run.nbytes
        n_left -= len(run)
    return runs


def _run_at(data: bytes, at: int, element: _Element, n_left: int, n_tried: int) -> tuple[Run, bool]:
    """Return the rows from a place on whose lists have the lengths of those of the first row.

    Parameters
    ----------
    data
        Numbers of the file.
    at
        Where the first row begins.
    element
        Name and fields of a row.
    n_left
        Number of rows from there on.
    n_tried
        Largest number of rows to return.

    Returns
    -------
    run : numpy.ndarray
        Structured array of the rows.
    is_cut : bool
        Whether it ends because the lists of the next row have other lengths.

    Raises
    ------
    ValueError
        If the data end before the first row does.
    """
    row, lengths = _row_at(data, at, element, n_left)
    n_that_fit = (len(data) - at) // max(row.itemsize, 1)
    n_rows = min(n_left, n_tried, n_that_fit)
    if n_left and not (n_rows and row.itemsize):
        raise ValueError(f"{n_left} rows of {element.name} announced, but it ends before them")
    run = np.frombuffer(data, row, n_rows, at) if n_rows else np.empty(0, row)
    differs = np.zeros(len(run), dtype=bool)
    for name, length in lengths.items():
        differs |= run[name] != length
    if differs.any():
        return run[: differs.argmax()], True
    return run, False


def _row_at(
    data: bytes, at: int, element: _Element, count: int
) -> tuple[np.dtype[Any], dict[str, int]]:
    """Return the layout of the row that begins at a place, with the lengths of its lists.

    Parameters
    ----------
    data
        Bytes of the file behind the header.
    at
        Place in the bytes at which the row begins.
    element
        Name and fields of the row.
    count
        Number of rows from there. If it is 0, lists count as empty.

    Returns
    -------
    layout : numpy.dtype
        Fields of the row; before each list stands its length, as ``"NAME size"``.
    lengths : dict
        Length of each list by the name of the field that holds it.

    Raises
    ------
    ValueError
        If the length of a list is no whole number.
    """
    layout: list[Any] = []
    lengths: dict[str, int] = {}
    for field in element.fields:
        if not field.size_type:
            layout.append((field.name, field.type))
            continue
        # A list begins behind the fields before it, with its length.
        name = f"{field.name} size"
        layout.append((name, field.size_type))
        lengths[name] = 0
        if count and at < len(data):
            row_so_far = np.frombuffer(data, layout, 1, at)
            if not float(row_so_far[name][0]).is_integer():
                raise ValueError("its rows are not those that its header announces")
            lengths[name] = int(whole_numbers(row_so_far[name])[0])
        layout.append((field.name, field.type, (lengths[name],)))
    return np.dtype(layout), lengths


def write(mesh: Mesh) -> bytes:
    """Return a mesh as the bytes of a binary PLY file, with coordinates in double precision."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {mesh.n_vertices}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {mesh.n_faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(mesh.n_faces, dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    faces["corners"] = mesh.faces
    return header.encode("ascii") + mesh.vertices.astype("<f8").tobytes() + faces.tobytes()


FORMAT = Format(
    module=__name__,
    extensions=(".ply",),
    first_vertex=0,
    read=read,
    write=write,
    preference=2,
)
