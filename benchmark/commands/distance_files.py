"""Read distance matrices and labels of other programs; code in their files never runs."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.labels import classes_of, names_of, read_labels
from benchmark.delimited import (
    TextRows,
    ambiguous,
    cells_of,
    lines_of,
    separators_of,
    usual_separator,
)
from benchmark.errors import ConfigurationError, one_line
from benchmark.files import check_expansion, load_arrays, named_errors, read_file

_HINT = "write the matrix as .npy, .npz, .txt, .csv, .mat (-v7), or .matrix of PSB"

#: Largest size of a file in bytes.
_LARGEST = 2**31

#: What a text file of numbers may contain.
_NUMERALS = b"0123456789.,;+-eEinfaN \t\r\n"

#: Smallest distance of a file in the right order of bytes.
_SMALLEST = 1e-30

Labels = dict[str, str] | list[str]
Orders = Mapping[str, Sequence[str]]


def as_labels(labels: Any) -> tuple[Labels, Orders]:
    """Return the class of each shape, by name if the shapes have names, and the orders that their rows may have.

    Parameters
    ----------
    labels
        A mapping by name, a pandas series or frame of one column, one axis of values, or the path
        of a ``.cla`` file, of text with lines ``label`` or ``name label``, or of a folder of
        shapes.

    Raises
    ------
    ConfigurationError
        If there are no labels, a name appears twice, or a shape has no label.
    DatasetError
        If the folder or the ``.cla`` file cannot be read.
    """
    if isinstance(labels, str | Path):
        return _read_labels(Path(labels))
    classes = classes_of(labels)
    return classes, _orders_of_numbers(classes) if isinstance(classes, dict) else {}


def _read_labels(path: Path) -> tuple[Labels, Orders]:
    if path.is_dir():
        return _folder_labels(path)
    if path.suffix.lower() == ".cla":
        from benchmark.datasets.folder import read_cla  # lazy: most labels are in no folder

        classes = {str(number): label for number, label in read_cla(path).items()}
        return classes, {"list": list(classes), "number": sorted(classes, key=int)}
    labels = read_labels(path)
    return labels, _orders_of_numbers(labels) if isinstance(labels, dict) else {}


def _orders_of_numbers(names: Iterable[str]) -> Orders:
    """Return the orders of names that are the numbers of rows; none for other names, whose order is that of rows."""
    from benchmark.datasets.base import natural_key  # lazy, as above

    numbers = sorted(names, key=natural_key)
    return {"list": [*names], "number": numbers} if are_row_numbers(numbers) else {}


def _folder_labels(folder: Path) -> tuple[dict[str, str], Orders]:
    from benchmark.datasets.base import natural_key
    from benchmark.datasets.folder import class_list, folder_set, read_cla

    shapes = folder_set(folder).shapes
    labels = {entry.identifier: entry.subject for entry in shapes}
    listing = [
        entry.identifier
        for entry in sorted(shapes, key=lambda entry: entry.path.parts if entry.path else ())
    ]
    orders = {"listing": listing, "natural": list(labels)}
    if source := class_list([folder]):
        by_number = dict(zip(sorted(numbers := read_cla(source)), labels, strict=True))
        orders["natural"] = sorted(labels, key=natural_key)
        orders |= {"list": [by_number[number] for number in numbers], "number": list(labels)}
    return labels, orders


def as_distances(
    distances: object, count: int = 0, n_columns: int = 0
) -> tuple[NDArray[np.float64], tuple[str, ...], tuple[str, ...]]:
    """Return a matrix of distances and the names of its rows and columns, () if they have none.

    Parameters
    ----------
    distances
        A path, an array, or a pandas frame whose index or columns name the shapes. The diagonal of
        a square matrix may hold anything.
    count, n_columns
        Numbers of labels, which decide if the first row and column of a text file may be names or
        distances; 0 columns for a square matrix.

    Raises
    ------
    ConfigurationError
        If a file cannot be read, or they are not one matrix of real numbers, N x N if it has to be
        square.
    """
    content: Any = (
        _read(Path(distances), count, n_columns) if isinstance(distances, str | Path) else distances
    )
    what = str(distances) if isinstance(distances, str | Path) else "the distances"
    rows, columns = tuple[str, ...](), tuple[str, ...]()
    if hasattr(content, "columns"):
        content, rows, columns = _without_names(content, is_square=not n_columns)
    if isinstance(content, np.ma.MaskedArray):
        content = np.ma.filled(content.astype(np.float64), np.nan)
    try:
        matrix = np.asarray(content)
        if matrix.ndim == 2 and matrix.dtype.kind == "O":
            matrix = matrix.copy()
            if not n_columns:
                np.fill_diagonal(matrix, 0)
            matrix = matrix.astype(np.float64)
    except Exception as error:  # of any library
        raise ConfigurationError(
            f"{what}: not a matrix of numbers: {one_line(error)}", _HINT
        ) from error
    is_matrix = matrix.ndim == 2 and (n_columns or matrix.shape[0] == matrix.shape[1])
    if not is_matrix or not matrix.size or matrix.dtype.kind not in "iufb":
        needed = "M x N" if n_columns else "N x N"
        found = f"an array of shape {matrix.shape}, {matrix.dtype},"
        if matrix.ndim == 0:
            found = f"one value of type {type(content).__name__}"
        hint = "pass scipy.spatial.distance.squareform of it" if matrix.ndim == 1 else _HINT
        raise ConfigurationError(f"{what}: {found} is no {needed} matrix", hint)
    return matrix.astype(np.float64), rows, columns


def _without_names(frame: Any, *, is_square: bool) -> tuple[Any, tuple[str, ...], tuple[str, ...]]:
    """Return the values of a frame and the names of rows and columns; if it is square, columns in their order."""
    rows, columns = names_of(frame.index), names_of(frame.columns)
    if not is_square:
        return frame.to_numpy(), tuple(rows), tuple(columns)
    rows = columns if are_row_numbers(rows) else rows
    columns = rows if are_row_numbers(columns) else columns
    if sorted(rows) != sorted(columns) or len({*rows}) < len(rows):
        problem = "rows and columns of the distances have different names, or a name appears twice"
        raise ConfigurationError(problem, "name both like the shapes")
    places = {name: place for place, name in enumerate(columns)}
    return frame.to_numpy()[:, [places[name] for name in rows]], tuple(rows), tuple(rows)


def are_row_numbers(names: Sequence[str]) -> bool:
    """Return whether names merely count from 0 or 1, as pandas and R write for rows without names."""
    return any(
        [*names] == [str(number) for number in range(first, first + len(names))] for first in (0, 1)
    )


def _read(path: Path, count: int, n_columns: int) -> Any:
    from scipy.io import loadmat  # lazy

    suffix = path.suffix.lower()
    with named_errors(path, "matrix of distances", ConfigurationError, _HINT):
        content = read_file(path, _LARGEST)
        if content.startswith((b"\x89HDF", b"MATLAB 7.3")):
            raise ConfigurationError("it is an HDF5 file, such as MATLAB writes with -v7.3", _HINT)
        if suffix == ".npy":
            return load_arrays(content)
        if suffix == ".npz":
            with load_arrays(content) as archive:
                if sum(part.file_size for part in archive.zip.infolist()) > _LARGEST:
                    raise ConfigurationError(f"its arrays hold more than {_LARGEST:,} bytes", _HINT)
                if archive.zip.testzip():
                    raise ValueError("a checksum is wrong")
                return _matrix_of(archive, (count, n_columns))
        if suffix == ".mat":
            check_expansion(content)
            variables = loadmat(
                io.BytesIO(content)
            )  # all of them, which finds where the file is cut
            return _matrix_of(variables, (count, n_columns))
        if suffix == ".matrix" and content.translate(None, _NUMERALS):
            return _read_psb(content, (count, n_columns))
        return _read_text(lines_of(content), (count, n_columns))


def _matrix_of(found: Mapping[str, Any], size: tuple[int, int]) -> Any:
    """Return the only matrix of a file, with names if a list of as many different texts there names its rows."""
    from pandas import DataFrame

    arrays = {
        name: value
        for name, value in found.items()
        if isinstance(value, np.ndarray) and value.size > 1
    }
    real = {name: value.shape for name, value in arrays.items() if value.dtype.kind in "iuf"}
    matrix = arrays[
        _only(
            [name for name, shape in real.items() if shape == (size if size[1] else shape[:1] * 2)]
        )
    ]
    for texts in (
        value.ravel() for value in arrays.values() if value.dtype.kind in "SUO" and not size[1]
    ):
        try:
            names = names_of(texts)
        except ConfigurationError:  # they are something else
            continue
        if len({*names}) == len(matrix) == len(names):
            return DataFrame(matrix, names, names)
    return matrix


def _read_psb(content: bytes, size: tuple[int, int]) -> NDArray[np.float32]:
    """Read the distances of the tools of the Princeton Shape Benchmark: N x N floats, rows in the order of the list."""
    matrix = np.frombuffer(content, dtype="<f4").reshape(
        size if size[1] else (math.isqrt(len(content) // 4),) * 2
    )
    if ((matrix != 0) & (np.abs(matrix) < _SMALLEST)).any():
        raise ConfigurationError(
            f"it has numbers below {_SMALLEST}", "write it with the lowest byte first"
        )
    return matrix


def _only(names: Sequence[str]) -> str:
    """Return the name of the only matrix of a file."""
    if len(names) != 1 and "distances" not in names:
        problem = f"it has {len(names)} full matrices of real numbers: {', '.join(sorted(names)) or 'none'}"
        raise ConfigurationError(problem, "name the right one 'distances'")
    return names[0] if len(names) == 1 else "distances"


def _read_text(lines: Sequence[str], size: tuple[int, int]) -> Any:
    """Read numbers, with or without names in the first row, in the first column, or in both."""
    from pandas import DataFrame

    count, n_columns = size
    matrix = _plain_numbers(lines)
    if matrix is not None and matrix.shape == (size if n_columns else matrix.shape[:1] * 2):
        return matrix
    rows = _rows_of(lines)
    if len(rows) > 1 and len(rows[0]) == len(rows[1]) - 1:
        rows[0].insert(0, "")  # R leaves out the corner
    _check_widths(rows, lines)
    width = len(rows[0])
    inner = any(_is_number(row[place]) for place, row in enumerate(rows) if 0 < place < width)
    if n_columns:
        top = len(rows) == count + 1 or not all(map(_is_number, rows[0][1:]))
        left = width == n_columns + 1 or not all(_is_number(row[0]) for row in rows[1:])
    elif (
        len(rows) == width
    ):  # if numbers may be names or distances, the corner or else the number of labels decides
        top = left = not _is_number(rows[0][0]) and (inner or count == width - 1)
    else:
        top, left = len(rows) == width + 1, len(rows) == width - 1
    body = [row[left:] for row in rows[top:]]
    values = np.array(_numbers(body), dtype=object)
    if not (top or left):
        return values
    return DataFrame(
        values, [row[0] for row in rows[top:]] if left else None, rows[0][left:] if top else None
    )


def _plain_numbers(lines: Sequence[str]) -> NDArray[np.float64] | None:
    """Read lines that hold nothing but numbers, the fast way; None if they are others."""
    marks = [mark for mark in ";\t," if mark in lines[0]]
    try:
        # Python takes 1_0 as a number.
        plain = [line.encode("ascii").replace(b"_", b"?").decode() for line in lines]
        return np.loadtxt(plain, delimiter=marks[0] if marks else None, ndmin=2)
    except ValueError:
        return None


def _rows_of(lines: Sequence[str]) -> TextRows:
    """Return the cells of lines; where several separators divide them, those between numbers.

    Raises
    ------
    ConfigurationError
        If several separators divide the lines into different cells, none or all of them numbers.
    """
    separators = separators_of(lines, has_short_first=True)
    splits = {mark: cells_of(lines, mark) for mark in separators}
    numbers = {mark: rows for mark, rows in splits.items() if _divides_numbers(rows)}
    different = {str(rows): mark for mark, rows in (numbers or splits).items()}
    if len(different) > 1:
        raise ambiguous(list(different.values()))
    for mark in different.values():
        return splits[mark]
    return cells_of(lines, usual_separator(lines))


def _divides_numbers(rows: TextRows) -> bool:
    """Return whether cells are numbers, but for the first row and column and one cell of a row, the diagonal."""
    return all(sum(not _is_number(cell) for cell in row[1:]) <= 1 for row in rows[1:] or rows)


def _check_widths(rows: TextRows, lines: Sequence[str]) -> None:
    """Raise ``ConfigurationError`` if rows have different lengths; the message says what they may be."""
    widths = [len(row) for row in rows]
    steps = {after - before for before, after in pairwise(widths[1:])}
    if len(rows) > 3 and steps in ({1}, {-1}):
        problem = "its rows get longer or shorter, as in one triangle of a matrix"
        raise ConfigurationError(problem, "write the whole matrix")
    if len(rows) > 2 and len({*widths[1:]}) == 1 and widths[0] != widths[1]:
        problem = f"its first line, '{lines[0].strip():.60}', is no row of the matrix"
        raise ConfigurationError(problem, "delete the first line")
    for number, width in enumerate(widths, 1):
        if width != widths[0]:
            problem = f"row {number} has length {width}, not {widths[0]}"
            raise ConfigurationError(problem, _HINT)


def _is_number(cell: str) -> bool:
    return isinstance(_number(cell), float)


def _number(cell: str) -> Any:
    """Return a cell as a number, in which a comma is decimal; what is none stays, as it may lie on the diagonal."""
    try:
        return (
            repr(cell) if "_" in cell or not cell.isascii() else float(cell.replace(",", "."))
        )  # 1_0 is none
    except ValueError:
        return cell


def _numbers(rows: Sequence[Sequence[str]]) -> list[list[Any]]:
    cells = [cell for row in rows for cell in row]
    if commas := [cell for cell in cells if "," in cell and _is_number(cell)]:
        may_be_thousands = all(re.fullmatch(r"[1-9]\d{0,2},\d{3}", cell) for cell in commas)
        if may_be_thousands or any("." in cell for cell in cells):
            raise ConfigurationError(
                "commas may be decimal or divide thousands", "write decimal points"
            )
    return [[_number(cell) for cell in row] for row in rows]
