"""Matrices of distances in text: numbers with or without names of rows and columns."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.delimited import (
    TextRows,
    ambiguous,
    cells_of,
    lines_of,
    separators_of,
    usual_separator,
)
from benchmark.errors import ConfigurationError

#: A number whose comma may divide thousands.
_THOUSANDS = re.compile(r"[1-9]\d{0,2},\d{3}")


def read_text_matrix(content: bytes, n_rows: int, n_columns: int, hint: str) -> Any:
    """Read a matrix from a text of numbers, with or without names of its rows and columns.

    Parameters
    ----------
    content
        The text; values are separated by commas, semicolons, tabs or spaces.
    n_rows, n_columns
        Expected shape, by which names in the first row or column are told from numbers; 0 columns
        for a square matrix.
    hint
        Advice for the error if it cannot be read.

    Returns
    -------
    numpy.ndarray or pandas.DataFrame
        A frame if the text names rows or columns.

    Raises
    ------
    ConfigurationError
        If the rows differ in length, or numbers have commas for points.
    """
    lines = lines_of(content)
    # Most files hold numbers alone, which numpy reads much faster.
    matrix = _plain_numbers(lines)
    if matrix is not None:
        expected = (n_rows, n_columns) if n_columns else (len(matrix), len(matrix))
        if matrix.shape == expected:
            return matrix

    rows = _rows_of(lines)
    if len(rows) > 1 and len(rows[0]) == len(rows[1]) - 1:
        rows[0].insert(0, "")  # R writes a first row without a cell above the names of the rows
    _check_widths(rows, lines, hint)
    if n_columns:
        has_head, has_names = _names_of_rectangle(rows, n_rows, n_columns)
    else:
        has_head, has_names = _names_of_square(rows, n_rows)

    return _numbers_and_names(rows, has_head=has_head, has_names=has_names)


def _numbers_and_names(rows: TextRows, *, has_head: bool, has_names: bool) -> Any:
    """Return rows of text as an array of numbers, or as a data frame if they have names.

    Parameters
    ----------
    rows
        The cells of each row.
    has_head
        Whether the first row names the columns.
    has_names
        Whether the first column names the rows.

    Raises
    ------
    ConfigurationError
        If numbers have commas for points.
    """
    from pandas import DataFrame

    column_names = None
    if has_head:
        column_names = rows[0]
        rows = rows[1:]
    row_names = None
    if has_names:
        row_names = [row[0] for row in rows]
        rows = [row[1:] for row in rows]
        if column_names:
            column_names = column_names[1:]  # without the corner
    _check_commas(rows)
    values = np.array([list(map(_number, row)) for row in rows], dtype=object)
    if not (has_head or has_names):
        return values
    return DataFrame(values, row_names, column_names)


def _plain_numbers(lines: Sequence[str]) -> NDArray[np.float64] | None:
    """Read lines that hold nothing but numbers, the fast way; None if they are others."""
    separator = next((mark for mark in ";\t," if mark in lines[0]), None)
    try:
        # Python takes 1_0 as a number.
        plain = [line.encode("ascii").replace(b"_", b"?").decode() for line in lines]
        return np.loadtxt(plain, delimiter=separator, ndmin=2)
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
    """Return whether cells are numbers but for the first row, the first column and the diagonal."""
    body = rows[1:] or rows
    return all(_count_texts(row[1:]) <= 1 for row in body)


def _count_texts(cells: Iterable[str]) -> int:
    """Return how many cells are no numbers."""
    return sum(not _is_number(cell) for cell in cells)


def _check_widths(rows: TextRows, lines: Sequence[str], hint: str) -> None:
    """Check that all rows of a text have the same number of values.

    Parameters
    ----------
    rows
        The values of each row.
    lines
        The lines from which they come, for the error.
    hint
        Advice for the error, if there is none that fits better.

    Raises
    ------
    ConfigurationError
        If they differ; the error says what the text seems to be: one triangle of a matrix, or a
        matrix below a title.
    """
    widths = [len(row) for row in rows]
    # The first row is left out: it may have names, or no value of a triangle.
    differences = {after - before for before, after in pairwise(widths[1:])}
    if len(rows) > 3 and differences in ({1}, {-1}):
        problem = "its rows get longer or shorter, as in one triangle of a matrix"
        raise ConfigurationError(problem, "write the whole matrix")
    all_but_first_agree = len(set(widths[1:])) == 1
    if len(rows) > 2 and all_but_first_agree and widths[0] != widths[1]:
        problem = f"its first line, '{lines[0].strip():.60}', is no row of the matrix"
        raise ConfigurationError(problem, "delete the first line")
    for number, width in enumerate(widths, 1):
        if width != widths[0]:
            problem = f"row {number} has length {width}, not {widths[0]}"
            raise ConfigurationError(problem, hint)


def _names_of_rectangle(rows: TextRows, n_rows: int, n_columns: int) -> tuple[bool, bool]:
    """Return whether the first row and the first column of M x N distances hold names."""
    has_head = len(rows) == n_rows + 1 or not all(map(_is_number, rows[0][1:]))
    first_column = [row[0] for row in rows[1:]]
    has_names = len(rows[0]) == n_columns + 1 or not all(map(_is_number, first_column))
    return has_head, has_names


def _names_of_square(rows: TextRows, count: int) -> tuple[bool, bool]:
    """Return whether the first row and the first column of N x N distances hold names.

    If numbers may be names or distances, the corner decides, or else the number of labels.
    """
    width = len(rows[0])
    if len(rows) != width:
        return len(rows) == width + 1, len(rows) == width - 1
    has_corner = not _is_number(rows[0][0])
    has_numbers_on_diagonal = any(map(_is_number, _diagonal(rows)))
    has_both = has_corner and (has_numbers_on_diagonal or count == width - 1)
    return has_both, has_both


def _diagonal(rows: TextRows) -> Iterator[str]:
    """Yield the cells of the diagonal of a square, without the corner."""
    for place in range(1, len(rows)):
        yield rows[place][place]


def _is_number(cell: str) -> bool:
    """Return whether a cell is a number."""
    return isinstance(_number(cell), float)


def _number(cell: str) -> Any:
    """Return a cell as a number, in which a comma is decimal.

    What is none stays, as it may lie on the diagonal.
    """
    if "_" in cell or not cell.isascii():  # which Python takes as numbers
        return repr(cell)
    try:
        return float(cell.replace(",", "."))
    except ValueError:
        return cell


def _check_commas(rows: TextRows) -> None:
    """Raise ``ConfigurationError`` if commas of numbers may be decimal or divide thousands."""
    cells = [*chain.from_iterable(rows)]
    with_commas = [cell for cell in cells if "," in cell and _is_number(cell)]
    if not with_commas:
        return
    if all(map(_THOUSANDS.fullmatch, with_commas)) or any("." in cell for cell in cells):
        raise ConfigurationError(
            "commas may be decimal or divide thousands", "write decimal points"
        )
