"""The Stanford polygon format, ASCII or binary with either byte order."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.formats.parsing import (
    Arrays,
    FloatArray,
    IntArray,
    corner_count,
    counted_lines,
    counted_polygons,
    fans,
    parsed,
    shown,
    table,
    whole,
    whole_number,
)

_TYPES = {
    **{b"char": "i1", b"int8": "i1", b"uchar": "u1", b"uint8": "u1", b"short": "i2", b"int16": "i2", b"ushort": "u2"},
    **{b"uint16": "u2", b"int": "i4", b"int32": "i4", b"uint": "u4", b"uint32": "u4", b"float": "f4"},
    **{b"float32": "f4", b"double": "f8", b"float64": "f8"},
}
_ORDERS = {b"binary_little_endian": "<", b"binary_big_endian": ">", b"ascii": ""}

#: Names of the list of corners.
_CORNERS = (b"vertex_indices", b"vertex_index")


class _Property(NamedTuple):
    """A value or list in a row; ``length`` is the type of the count before a list, empty for a single value."""

    name: bytes
    kind: str
    length: str = ""


class _Element(NamedTuple):
    name: bytes
    rows: int
    properties: list[_Property]

    @property
    def corners(self) -> int | None:
        """Index of the list of corners among the properties."""
        lists = [at for at, column in enumerate(self.properties) if column.name in _CORNERS and column.length]
        return lists[0] if lists else None


def read_ply(data: bytes) -> Arrays:
    """Read vertices and faces; other elements are ignored."""
    ends = data.find(b"end_header")
    begins = data.find(b"\n", ends) + 1
    if not data.startswith(b"ply") or ends < 0 or not begins:
        raise ValueError("the header does not run from 'ply' to 'end_header'")
    order, elements = _header(data[:ends])
    rows = _Binary(data, begins, order) if order else _Ascii(counted_lines(data[begins:]))
    vertices, faces = None, None
    for element in elements:
        if not element.properties:
            continue
        if element.rows > rows.most:
            raise ValueError(f"{element.rows} rows of element {shown(element.name)} announced, fewer found")
        if element.name == b"vertex":
            vertices = _vertices(element, rows)
        elif element.name == b"face" and element.corners is not None:
            faces = rows.polygons(element, element.corners)
        else:
            rows.skip(element)
    if rows.is_left:
        raise ValueError("more follows than the header announces")
    if vertices is None or faces is None:
        raise ValueError("there is no element 'vertex', or no element 'face' with a list 'vertex_indices'")
    return vertices, faces


def _header(text: bytes) -> tuple[str, list[_Element]]:
    order: str | None = None
    elements: dict[bytes, _Element] = {}
    properties: list[_Property] | None = None
    for line in text.splitlines():
        match line.split():
            case [b"format", encoding, _]:
                order = _ORDERS.get(encoding)
            case [b"element", name, count]:
                if name in elements:
                    raise ValueError(f"element {shown(name)} stands twice")
                properties = []
                elements[name] = _Element(name, whole_number(count), properties)
            case [b"property", kind, name]:
                _add(properties, name, kind)
            case [b"property", b"list", count, kind, name]:
                _add(properties, name, kind, count)
    if order is None:
        raise ValueError("the header names no known format")
    return order, list(elements.values())


def _add(properties: list[_Property] | None, name: bytes, kind: bytes, count: bytes = b"") -> None:
    if properties is None or kind not in _TYPES or count not in {b"", *_TYPES}:
        raise ValueError(f"property {shown(name)} has no known type, or no element")
    length = _TYPES[count] if count else ""
    if length.startswith("f"):
        raise ValueError(f"the length of list {shown(name)} is no integer")
    properties.append(_Property(name, _TYPES[kind], length))


def _vertices(element: _Element, rows: _Ascii | _Binary) -> FloatArray:
    if any(column.length for column in element.properties):
        raise ValueError("a vertex holds a list")
    columns = rows.columns(element)
    if not columns.keys() >= {b"x", b"y", b"z"}:
        raise ValueError("the vertices have no x, y and z")
    return np.stack([np.asarray(columns[axis], dtype=np.float64) for axis in (b"x", b"y", b"z")], axis=1)


class _Ascii:
    """Rows of an ASCII file, one line each, element by element."""

    def __init__(self, lines: Sequence[bytes]) -> None:
        self._lines = lines
        self._at = 0

    @property
    def most(self) -> int:
        """Maximum number of remaining rows."""
        return len(self._lines) - self._at

    @property
    def is_left(self) -> bool:
        """Whether any lines remain."""
        return self.most > 0

    def skip(self, element: _Element) -> None:
        self._at += element.rows

    def columns(self, element: _Element) -> Mapping[bytes, NDArray[np.number]]:
        width = len(element.properties)
        rows = table(self._take(element.rows), least=width)
        if rows.shape[1] != width:
            raise ValueError(f"a line of element {shown(element.name)} has not {width} numbers")
        return {column.name: rows[:, at] for at, column in enumerate(element.properties)}

    def polygons(self, element: _Element, corners_at: int) -> IntArray:
        lines = self._take(element.rows)
        if len(element.properties) == 1:
            return counted_polygons(lines)
        sizes, corners = [], []
        for line in lines:
            tokens = line.split()
            at = 0
            for place, column in enumerate(element.properties):
                size = 1
                if column.length:
                    size = whole_number(tokens[at]) if at < len(tokens) else 0
                    at += 1
                if place == corners_at:
                    sizes.append(corner_count(size))
                    corners.append(b" ".join(tokens[at : at + size]))
                at += size
            if at != len(tokens):
                raise ValueError("a line of element 'face' has too few or too many numbers")
        return fans(whole(parsed(corners, sum(sizes))), sizes)

    def _take(self, count: int) -> Sequence[bytes]:
        lines = self._lines[self._at : self._at + count]
        self._at += count
        return lines


class _Binary:
    """Rows of a binary file, element by element."""

    def __init__(self, data: bytes, begins: int, order: str) -> None:
        self._data = data
        self._at = begins
        self._order = order

    @property
    def most(self) -> int:
        """Maximum number of remaining rows; each has at least one byte."""
        return len(self._data) - self._at

    @property
    def is_left(self) -> bool:
        """Whether anything but white space remains."""
        return bool(self._data[self._at :].strip())

    def skip(self, element: _Element) -> None:
        if any(column.length for column in element.properties):
            self._walk(element, None)
        else:
            self.columns(element)

    def columns(self, element: _Element) -> Mapping[bytes, NDArray[np.number]]:
        record = np.dtype([(str(at), self._order + column.kind) for at, column in enumerate(element.properties)])
        rows = self._records(record, element.rows)
        if rows is None:
            raise ValueError(f"{element.rows} rows of element {shown(element.name)} announced, fewer found")
        self._at += rows.nbytes
        return {column.name: rows[str(at)] for at, column in enumerate(element.properties)}

    def polygons(self, element: _Element, corners_at: int) -> IntArray:
        # Most files contain only triangles: read every list as if it had three items, then check.
        fields: list[tuple[str, str] | tuple[str, str, int]] = []
        for at, column in enumerate(element.properties):
            item = self._order + column.kind
            fields += (
                [(f"length{at}", self._order + column.length), (f"item{at}", item, 3)]
                if column.length
                else [(f"item{at}", item)]
            )
        rows = self._records(np.dtype(fields), element.rows)
        if rows is not None:
            lists = [at for at, column in enumerate(element.properties) if column.length]
            if all((rows[f"length{at}"] == 3).all() for at in lists):
                self._at += rows.nbytes
                return whole(rows[f"item{corners_at}"])
        return self._walk(element, corners_at)

    def _records(self, record: np.dtype[np.void], count: int) -> NDArray[np.void] | None:
        """Return the next rows of a fixed size; None if the file is too short."""
        if len(self._data) - self._at < count * record.itemsize:
            return None
        return np.frombuffer(self._data, record, count, self._at) if count else np.empty(0, record)

    def _walk(self, element: _Element, corners_at: int | None) -> IntArray:
        """Read row by row; returns the triangles of the list at ``corners_at``, none for None."""
        steps = [
            (
                np.dtype(column.kind).itemsize,
                struct.Struct(self._order + np.dtype(column.length).char) if column.length else None,
                place == corners_at,
            )
            for place, column in enumerate(element.properties)
        ]
        data, at = self._data, self._at
        sizes: list[int] = []
        corners = bytearray()
        for _ in range(element.rows):
            for width, counter, is_corners in steps:
                size = 1
                if counter is not None:
                    (size,) = counter.unpack_from(data, at)
                    at += counter.size
                    if size < 0:
                        raise ValueError("a list has a negative length")
                if is_corners:
                    sizes.append(corner_count(size))
                    corners += data[at : at + size * width]
                at += size * width
            if at > len(data):
                raise ValueError(f"element {shown(element.name)} is cut off")
        self._at = at
        if corners_at is None:
            return np.empty((0, 3), dtype=np.int64)
        kind = self._order + element.properties[corners_at].kind
        return fans(whole(np.frombuffer(bytes(corners), kind)), sizes)
