"""Lines and numbers of mesh files that are text."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import UnreadableMesh
from benchmark.geometry.mesh import FloatArray, IntArray
from benchmark.text import counted

_NUMBER = re.compile(
    r"[-+]?((\d+\.?\d*|\.\d+)(e[-+]?\d+)?|nan(\(.*\))?|inf(inity)?)", re.ASCII | re.IGNORECASE
)

#: Largest whole number that double precision tells from its neighbours.
_LARGEST_INTEGER = 2**53


def plain_text(data: bytes) -> bytes:
    """Return text in ASCII, without comments and byte-order marks, with one kind of line break.

    Each line ends with one. A text that is cut off within its last number cannot be told from one
    without a last line break; ``data check`` and a run name both. Any other cut contradicts the
    counts or the last line.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = data.decode("utf-16").encode()
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"#" in text:
        text = re.sub(rb"(?<!\S)#[^\n]*", b"\n", text)
    return text if text.endswith(b"\n") else text + b"\n"


def ends_within_line(data: bytes) -> bool:
    """Return whether the last line of a text has no line break, as in a text that is cut off."""
    return not data.rstrip(b" \t\0").endswith((b"\n", b"\r"))


def check_end(data: bytes, corners: IntArray, n_vertices: int) -> None:
    """Raise ``UnreadableMesh`` if a text without counts seems to be cut off.

    It ends within a line, and vertices have no face.
    """
    if ends_within_line(data) and len(np.unique(corners)) < n_vertices:
        raise UnreadableMesh(
            "its last line has no line break, and vertices have no face: it may be cut off",
            "fetch or export it again, or add a line break if it is whole",
        )


def filled_lines(text: bytes) -> list[bytes]:
    """Return the lines that are not blank."""
    return [line for line in text.split(b"\n") if line.strip()]


def parse_numbers(text: bytes) -> FloatArray:
    """Parse decimal numbers that are separated by blanks.

    Unlike ``float``, this refuses ``1_0`` and digits of other scripts.

    Parameters
    ----------
    text
        Numbers in ASCII, such as ``b"1 -2.5 3e-4"``.

    Returns
    -------
    numpy.ndarray
        Shape (k,); empty for blanks alone.

    Raises
    ------
    ValueError
        If a word is no number; the message quotes the first one.
    UnreadableMesh
        If the numbers have decimal commas.
    """
    if not text.strip():
        return np.empty(0)
    try:
        return np.fromstring(text.decode("ascii"), sep=" ")
    except (DeprecationWarning, ValueError) as error:
        if re.search(rb"\d,\d", text):
            problem = "numbers have decimal commas"
            raise UnreadableMesh(problem, "export with LC_NUMERIC=C") from error
        words = text.decode("latin-1").split()
        first_wrong = next((word for word in words if not _NUMBER.fullmatch(word)), "")
        raise ValueError(f"expected a number, not '{first_wrong:.20}'") from error


def parse_table(lines: Sequence[bytes], widths: Collection[int] = (3,)) -> FloatArray:
    """Parse lines of coordinates, and return the first three numbers of each, shape (lines, 3).

    Parameters
    ----------
    lines
        The lines.
    widths
        How many numbers a line may have. Those after the third are colours or normals, and ignored.
        If there are four, the last is the weight of homogeneous coordinates, which must be 1.

    Raises
    ------
    ValueError
        If a line has another number of them, or something that is no number.
    """
    counts = {len(line.split()) for line in lines}
    other = counts.difference(widths)
    if other:
        raise ValueError(f"a line has {counted(min(other), 'number')}, not {min(widths)}")
    if 4 in counts and (_fourth_numbers(lines) != 1).any():
        raise ValueError("a line has a fourth number, which is not 1")
    if len(counts) == 1:  # nearly always: read all numbers at once
        table = parse_numbers(b" ".join(lines)).reshape(len(lines), counts.pop())
        return table[:, :3]
    first_three = [b" ".join(line.split()[:3]) for line in lines]
    return parse_numbers(b" ".join(first_three)).reshape(len(lines), 3)


def _fourth_numbers(lines: Sequence[bytes]) -> FloatArray:
    """Return the fourth numbers of the lines of four."""
    rows = [line.split() for line in lines]
    return parse_numbers(b" ".join(row[3] for row in rows if len(row) == 4))


def whole_numbers(numbers: NDArray[np.number]) -> IntArray:
    """Return vertex indices as integers; raise ``ValueError`` if one is not a whole number."""
    is_small = np.abs(numbers) <= _LARGEST_INTEGER
    if not is_small.all() or (numbers != np.floor(numbers)).any():
        raise ValueError("a vertex index is not a whole number")
    return numbers.astype(np.int64)


def is_padding(rest: bytes) -> bool:
    """Return whether what follows the rows of a file says nothing."""
    return not rest.strip(b"\0 \t\r\n")


def rows_of(prefix: str, table: NDArray[Any]) -> bytes:
    """Return three numbers a line, in full precision, behind a prefix."""
    return "".join(f"{prefix}{a!r} {b!r} {c!r}\n" for a, b, c in table.tolist()).encode()
