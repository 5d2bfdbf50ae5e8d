"""Minimal reader of level 5 MATLAB files (versions 5 to 7.2) for the TOSCA struct ``surface``.

General readers trust the sizes in a file, although a few kilobytes may expand to gigabytes or declare an array that
exceeds the memory.

References
----------
The MathWorks, "MAT-File Format", 2020 (chapter 1).
"""

from __future__ import annotations

import itertools
import math
import zlib
from collections.abc import Iterator, Mapping

import numpy as np

from benchmark.geometry.formats.parsing import Arrays, FloatArray, whole

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_STRUCT, _FIRST_NUMERIC, _LAST_NUMERIC = 2, 6, 15
_COMPLEX = 0x0800

#: Number types on disk.
_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}

#: Maximum decompressed size relative to the file size. Coordinates compress to a half, triangles to a tenth; only data
#: without information, such as a million equal numbers, compresses to a thousandth.
LARGEST_EXPANSION = 100


def read_mat(data: bytes) -> Arrays:
    """Read the MATLAB struct ``surface`` of TOSCA: X, Y, Z and the 1-based triangles TRIV."""
    if data[:10] == b"MATLAB 7.3" or data[:4] == b"\x89HDF":
        raise ValueError("MATLAB 7.3 files are not understood; save it with '-v7'")
    order = {b"IM": "<", b"MI": ">"}.get(data[126:_HEADER])
    if order is None:
        raise ValueError("it is no MATLAB file of level 5")
    fields = _surface(data, order)
    columns = [_numbers(fields, axis, order) for axis in ("X", "Y", "Z")]
    if len({column.size for column in columns}) > 1:
        raise ValueError("X, Y and Z differ in length")
    triangles = _numbers(fields, "TRIV", order)
    if triangles.ndim != 2 or triangles.shape[1] != 3:
        raise ValueError("TRIV has not three columns")
    return np.stack([column.ravel() for column in columns], axis=1), whole(triangles) - 1


def _surface(data: bytes, order: str) -> Mapping[str, memoryview]:
    """Return the fields of the struct, each the content of a matrix."""
    budget = LARGEST_EXPANSION * len(data)
    for kind, content in _elements(memoryview(data)[_HEADER:], order):
        inner_kind, inner = kind, content
        if kind == _COMPRESSED:
            inflater = zlib.decompressobj()
            inflated = inflater.decompress(content, max(budget, 1))
            budget -= len(inflated)
            if not inflater.eof:
                reason = "is cut off" if budget > 0 else f"expands to more than {LARGEST_EXPANSION} times the file"
                raise ValueError(f"a compressed variable {reason}")
            ((inner_kind, inner),) = _first(_elements(memoryview(inflated), order), 1)
        if inner_kind == _MATRIX:
            parts = _elements(inner, order)
            (_, flags), (_, size), (_, name) = _first(parts, 3)
            if bytes(name) == b"surface":
                if _flags(flags, order) & 0xFF != _STRUCT or math.prod(_shape(size, order)) != 1:
                    raise ValueError("'surface' is not one struct")
                return _fields(parts, order)
    raise ValueError("there is no variable 'surface'")


def _fields(parts: Iterator[tuple[int, memoryview]], order: str) -> Mapping[str, memoryview]:
    (_, length), (_, names) = _first(parts, 2)
    width = int(np.frombuffer(length, f"{order}i4", 1)[0])
    if width < 1:
        raise ValueError("the fields of 'surface' have no names")
    stored = [bytes(names[at : at + width]) for at in range(0, len(names), width)]
    pairs = zip(stored, parts, strict=False)
    return {name.partition(b"\0")[0].decode("latin-1"): content for name, (_, content) in pairs}


def _numbers(fields: Mapping[str, memoryview], name: str, order: str) -> FloatArray:
    """Return a field as a real matrix of any numeric class, read in column-major order."""
    if name not in fields:
        raise ValueError(f"'surface' has no field {name}")
    (_, flags), (_, size), _, (kind, content) = _first(_elements(fields[name], order), 4)
    bits = _flags(flags, order)
    if not _FIRST_NUMERIC <= bits & 0xFF <= _LAST_NUMERIC or bits & _COMPLEX or kind not in _KINDS:
        raise ValueError(f"field {name} holds no real numbers")
    shape = _shape(size, order)
    numbers = np.frombuffer(content, order + _KINDS[kind])
    if math.prod(shape) != len(numbers):
        raise ValueError(f"field {name} announces {shape} numbers but holds {len(numbers)}")
    return numbers.astype(np.float64).reshape(shape, order="F")


def _flags(content: memoryview, order: str) -> int:
    return int(np.frombuffer(content, f"{order}u4", 1)[0])


def _shape(content: memoryview, order: str) -> tuple[int, ...]:
    shape = tuple(np.frombuffer(content, f"{order}i4").tolist())
    if min(shape, default=-1) < 0:
        raise ValueError("an array has no size")
    return shape


def _first(parts: Iterator[tuple[int, memoryview]], count: int) -> list[tuple[int, memoryview]]:
    elements = list(itertools.islice(parts, count))
    if len(elements) < count:
        raise ValueError("a variable is cut off")
    return elements


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield type and content of each data element; a small element stores its content in its tag."""
    at = 0
    while at + 8 <= len(data):
        kind, size = (int(word) for word in np.frombuffer(data[at : at + 8], f"{order}u4"))
        begins = at + 8
        if kind >> 16:
            kind, size, begins = kind & 0xFFFF, kind >> 16, at + 4
            if size > 4:
                raise ValueError(f"a small element holds {size} bytes")
        if begins + size > len(data):
            raise ValueError("it is cut off")
        yield kind, data[begins : begins + size]
        # Elements begin at multiples of eight bytes, except after compressed elements.
        at = begins + size if kind == _COMPRESSED else at + 8 * math.ceil((begins - at + size) / 8)
