"""STL, as text or binary, which lists three positions a triangle and no vertices.

Corners at exactly the same position become a single vertex; vertices are counted from 0.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmark.errors import UnreadableMesh
from benchmark.formats.ascii import is_padding, parse_numbers, plain_text
from benchmark.formats.base import Format, MeshArrays
from benchmark.geometry.cleaning import merge_duplicates
from benchmark.geometry.mesh import FloatArray
from benchmark.text import counted

#: Bytes of a binary file before the number of its triangles.
_HEADER = 80

#: A triangle of a binary file.
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", 9), ("attribute", "<u2")])

#: A corner, or the end of a facet.
_CORNER_OR_END = re.compile(rb"(?m)^[ \t]*(?:vertex[ \t]+(\S+[ \t]+\S+[ \t]+\S+)[ \t]*$|endfacet)")


def read(data: bytes, _: Path) -> MeshArrays:
    """Return the distinct corners of an STL file, and its triangles."""
    corners = _binary_corners(data)
    if corners is None:
        corners = _ascii_corners(data)
    vertices, place = merge_duplicates(corners.reshape(-1, 3))
    return vertices, place.reshape(-1, 3)


def _binary_corners(data: bytes) -> FloatArray | None:
    """Return nine coordinates a triangle; None unless the file has the announced size."""
    start = _HEADER + 4
    end = start + _FACET.itemsize * int.from_bytes(data[_HEADER:start], "little")
    if not start < end <= len(data) or not is_padding(data[end:]):
        return None
    return np.frombuffer(data[start:end], _FACET)["corners"].astype(np.float64)


def _ascii_corners(data: bytes) -> FloatArray:
    """Return the coordinates of all corners in an STL file of text, shape (9 * triangles,).

    Parameters
    ----------
    data
        Bytes of the file: ``facet``, ``outer loop``, three lines ``vertex x y z``, and so on, from
        ``solid`` to ``endsolid``.

    Raises
    ------
    ValueError
        If it is no such file or cut off, or a facet has other than three corners.
    UnreadableMesh
        If its line breaks are missing.
    """
    if data.lstrip()[:5].lower() != b"solid":
        raise ValueError(
            f"{len(data)} bytes are neither an ASCII STL nor as many triangles as it announces"
        )
    if b"endsolid" not in data[-200:].lower():
        raise ValueError("it does not end with 'endsolid'")
    text = plain_text(data).partition(b"\n")[2].lower()
    # Texts of three numbers for each corner; an empty text for the end of each facet.
    corners = _CORNER_OR_END.findall(text)
    if not corners and b"endfacet" in data.lower():
        problem = "its line breaks are missing"
        raise UnreadableMesh(problem, "write each facet, loop and vertex on its own line")
    _check_facets(corners)
    return parse_numbers(b" ".join(corners))


def _check_facets(corners: Sequence[bytes]) -> None:
    """Raise ``ValueError`` if a facet has other than three corners; an empty text ends each."""
    ends = np.flatnonzero([not corner for corner in corners])
    n_corners = np.diff(ends, prepend=-1) - 1  # of each facet
    wrong = np.flatnonzero(n_corners != 3)
    if wrong.size:
        number = counted(int(n_corners[wrong[0]]), "vertex", "vertices")
        raise ValueError(f"facet {wrong[0] + 1} of {len(ends)} has {number}")


FORMAT = Format(
    module=__name__,
    extensions=(".stl",),
    first_vertex=0,
    read=read,
    preference=3,
)
