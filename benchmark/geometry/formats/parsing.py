"""Helpers of the readers: parsing of numbers and whole numbers, and triangulation of polygons.

Python's converters accept numbers that are invalid in mesh files (``1_0``, digits of other scripts), so numbers are
parsed by numpy, and counts are validated before conversion.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Arrays = tuple[FloatArray, IntArray]

_MOST_DIGITS = 18
"""Number of digits that always fit in 64 bits."""


def content_lines(data: bytes) -> list[bytes]:
    """Return the nonblank lines, stripped of white space."""
    return [line for line in map(bytes.strip, data.splitlines()) if line]


def counted_lines(data: bytes) -> list[bytes]:
    """Return :func:`content_lines`, but reject an unterminated last line, whose last number may be truncated."""
    if data[-1:].strip():
        raise ValueError("its last line does not end, so it may be cut off (if it is whole, add a line break)")
    return content_lines(data)


def whole_number(token: bytes) -> int:
    """Parse a count or an index in ASCII digits; raises ``ValueError`` for anything else."""
    if not token.isdigit() or len(token) > _MOST_DIGITS:
        raise ValueError(f"{shown(token)} is not a whole number")
    return int(token)


def shown(token: bytes) -> str:
    """Return the beginning of a token, escaped for error messages."""
    return repr(token[:20].decode("ascii", errors="backslashreplace"))


def parsed(lines: Sequence[bytes], count: int) -> FloatArray:
    """Parse the numbers of some lines; raises ``ValueError`` unless there are exactly ``count`` numbers."""
    if not count:
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # numpy below 2.3 does not raise
        try:
            numbers = np.fromstring(b" ".join(lines).decode("ascii"), sep=" ")
        except (DeprecationWarning, ValueError) as error:
            raise ValueError("what should be a number is none") from error
    if len(numbers) != count:
        raise ValueError(f"{count} numbers expected, {len(numbers)} found")
    return numbers


def table(lines: Sequence[bytes], least: int = 3) -> FloatArray:
    """Parse nonblank lines with the same number of values each, at least ``least``."""
    if not lines:
        return np.empty((0, least))
    widths = {len(line.split()) for line in lines}
    width = max(widths)
    if len(widths) > 1 or width < least:
        raise ValueError("a line has too few or too many numbers")
    return parsed(lines, width * len(lines)).reshape(-1, width)


def whole(numbers: NDArray[np.number]) -> IntArray:
    """Convert numbers to vertex indices; raises ``ValueError`` if one is not a whole number."""
    if numbers.dtype.kind in "iu":
        return numbers.astype(np.int64)
    with np.errstate(invalid="ignore"):
        is_whole = (numbers == np.floor(numbers)) & (np.abs(numbers) <= 2**53)
    if not is_whole.all():
        raise ValueError("a vertex index is not a whole number")
    return numbers.astype(np.int64)


def counted_polygons(lines: Sequence[bytes]) -> IntArray:
    """Parse lines with the number of corners, the corners, and optionally a colour; returns triangles."""
    if all(line[:2] in (b"3 ", b"3\t") for line in lines):
        try:
            return whole(table(lines, least=4)[:, 1:4])
        except ValueError:
            pass  # lines of different length: some faces have colours
    sizes, corners = [], []
    for line in lines:
        first, *others = line.split()
        size = corner_count(whole_number(first))
        if len(others) < size:
            raise ValueError("a face has fewer corners than it announces")
        sizes.append(size)
        corners.append(b" ".join(others[:size]))
    return fans(whole(parsed(corners, sum(sizes))), sizes)


def corner_count(size: int) -> int:
    """Return the number of corners of a face; raises ``ValueError`` for fewer than three."""
    if size < 3:
        raise ValueError("a face has fewer than three corners")
    return size


def fans(corners: IntArray, sizes: Sequence[int]) -> IntArray:
    """Split polygons into triangle fans around their first corner.

    Parameters
    ----------
    corners
        Concatenated vertices of all polygons.
    sizes
        Number of corners of each polygon, at least three.
    """
    of_polygon = np.asarray(sizes, dtype=np.int64)
    starts = np.cumsum(of_polygon) - of_polygon
    triangles = of_polygon - 2
    first = np.repeat(starts, triangles)
    within = np.arange(len(first)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([corners[first], corners[first + within + 1], corners[first + within + 2]], axis=1)
