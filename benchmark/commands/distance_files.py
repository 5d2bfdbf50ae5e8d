"""Read distance matrices of other programs; code in their files never runs."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.commands.distance_text import read_text_matrix
from benchmark.commands.shape_labels import are_row_numbers
from benchmark.datasets.labels import names_of
from benchmark.errors import ConfigurationError, one_line
from benchmark.files import check_expansion, load_arrays, named_errors, read_file

_HINT = "write the matrix as .npy, .npz, .txt, .csv, .mat (-v7), or .matrix of PSB"

#: Largest size of a file in bytes.
_LARGEST = 2**31

#: What a text file of numbers may contain.
_NUMERALS = b"0123456789.,;+-eEinfaN \t\r\n"

#: Smallest distance of a file in the right order of bytes.
_SMALLEST = 1e-30

#: Largest whole number up to which floats tell all whole numbers apart.
_LARGEST_WHOLE = 2**53

#: First bytes of files of HDF5.
_HDF5 = (b"\x89HDF", b"MATLAB 7.3")


class NamedDistances(NamedTuple):
    """A matrix of distances, and the names of its rows and columns, () if they have none."""

    matrix: NDArray[np.float64]
    rows: tuple[str, ...]
    columns: tuple[str, ...]


def as_distances(distances: object, n_rows: int = 0, n_columns: int = 0) -> NamedDistances:
    """Return distances as one matrix of floats, with the names of its rows and columns, if any.

    Parameters
    ----------
    distances
        A path, an array, or a pandas frame whose index or columns name the shapes. The diagonal of
        a square matrix may hold anything.
    n_rows, n_columns
        Expected shape, by which names in the first row or column of a text file are told from
        distances; 0 columns for a square matrix.

    Raises
    ------
    ConfigurationError
        If a file cannot be read, or does not hold one matrix of real numbers, N x N if
        ``n_columns`` is 0.
    """
    content: Any = distances
    what = "the distances"  # in errors
    if isinstance(distances, str | Path):
        content = _read(Path(distances), n_rows, n_columns)
        what = str(distances)
    rows: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    is_square = not n_columns
    if hasattr(content, "columns"):  # a pandas frame
        content, rows, columns = _values_and_names(content, is_square=is_square)
    try:
        matrix = _as_array(content, is_square=is_square)
    except Exception as error:  # of any library
        problem = f"{what}: not a matrix of numbers: {one_line(error)}"
        raise ConfigurationError(problem, _HINT) from error
    _check_is_matrix(matrix, what, content, is_square=is_square)
    return NamedDistances(matrix.astype(np.float64), rows, columns)


def _as_array(content: Any, *, is_square: bool) -> NDArray[Any]:
    """Return values as an array, with NaN for what is masked, and numbers for texts of numbers."""
    if isinstance(content, np.ma.MaskedArray):
        return np.asarray(np.ma.filled(content.astype(np.float64), np.nan))
    matrix = np.asarray(content)
    if matrix.ndim != 2 or matrix.dtype.kind != "O":
        return matrix
    matrix = matrix.copy()
    if is_square:
        np.fill_diagonal(matrix, 0)
    return matrix.astype(np.float64)


def _check_is_matrix(matrix: NDArray[Any], what: str, content: Any, *, is_square: bool) -> None:
    """Check that an array is a matrix of real numbers.

    Parameters
    ----------
    matrix
        The array.
    what
        What the error calls it, such as its file.
    content
        The object from which the array was made.
    is_square
        Whether it has to be square.

    Raises
    ------
    ConfigurationError
        If it is no such matrix, or holds whole numbers that floats cannot represent.
    """
    has_shape = matrix.ndim == 2 and (not is_square or matrix.shape[0] == matrix.shape[1])
    if has_shape and matrix.size and matrix.dtype.kind in "iufb":
        if matrix.dtype.kind in "iu" and matrix.max() > _LARGEST_WHOLE:
            problem = f"{what}: whole numbers up to {matrix.max()} are rounded as floats"
            raise ConfigurationError(problem, "divide them by their unit")
        return
    needed = "N x N" if is_square else "M x N"
    given = f"an array of shape {matrix.shape}, {matrix.dtype},"
    hint = _HINT
    if matrix.ndim == 0:
        given = f"one value of type {type(content).__name__}"
    if matrix.ndim == 1 or (matrix.ndim == 2 and 1 in matrix.shape):
        hint = "pass scipy.spatial.distance.squareform of it"
    raise ConfigurationError(f"{what}: {given} is no {needed} matrix", hint)


def _values_and_names(
    frame: Any, *, is_square: bool
) -> tuple[NDArray[Any], tuple[str, ...], tuple[str, ...]]:
    """Return the distances in a pandas frame, with the names of its rows and columns.

    Parameters
    ----------
    frame
        The frame. Pandas numbers rows and columns that were given no names: 0, 1, 2, ...
    is_square
        Whether rows and columns stand for the same shapes. The columns are then brought into the
        order of the rows.

    Returns
    -------
    values : numpy.ndarray
        The distances, shape (rows, columns).
    rows, columns : tuple of str
        Names of rows and columns; their numbers as texts, if they have none.

    Raises
    ------
    ConfigurationError
        If rows and columns stand for the same shapes, but have different names, or a name appears
        twice.
    """
    rows = names_of(frame.index)
    columns = names_of(frame.columns)
    if not is_square:
        return frame.to_numpy(), tuple(rows), tuple(columns)

    # If only the rows or only the columns have names, these hold for both.
    if are_row_numbers(rows):
        rows = columns
    if are_row_numbers(columns):
        columns = rows
    if sorted(rows) != sorted(columns) or len({*rows}) < len(rows):
        problem = "rows and columns of the distances have different names, or a name appears twice"
        raise ConfigurationError(problem, "name both like the shapes")
    column_of = {name: number for number, name in enumerate(columns)}
    values = frame.to_numpy()[:, [column_of[name] for name in rows]]
    return values, tuple(rows), tuple(rows)


# Files
# ------------------------------------------------------------------------------------------------


def _read(path: Path, n_rows: int, n_columns: int) -> Any:
    """Read a matrix of distances from a file of any accepted format.

    Parameters
    ----------
    path
        The file; its extension, and for ``.matrix`` its content, tell the format.
    n_rows, n_columns
        Expected shape; 0 columns for a square matrix.

    Returns
    -------
    numpy.ndarray or pandas.DataFrame
        A frame if the file names rows or columns.

    Raises
    ------
    ConfigurationError
        If the file cannot be read.
    """
    suffix = path.suffix.lower()
    with named_errors(path, "matrix of distances", ConfigurationError, _HINT):
        content = read_file(path, _LARGEST)
        if content.startswith(_HDF5):
            raise ConfigurationError("it is an HDF5 file, such as MATLAB writes with -v7.3", _HINT)
        if suffix in (".npy", ".npz"):
            return _read_arrays(content, n_rows, n_columns)
        if suffix == ".mat":
            return _read_mat(content, n_rows, n_columns)
        # A binary file of the Princeton Shape Benchmark, unless it holds characters of numbers
        # alone: other programs write text with this extension.
        if suffix == ".matrix" and content.translate(None, _NUMERALS):
            return _read_psb(content, n_rows, n_columns)
        return read_text_matrix(content, n_rows, n_columns, _HINT)


def _read_arrays(content: bytes, n_rows: int, n_columns: int) -> Any:
    """Return the array of a file of NumPy, or the only matrix of an archive of arrays."""
    loaded = load_arrays(content)
    if isinstance(loaded, np.ndarray):
        return loaded
    with loaded as archive:
        if sum(part.file_size for part in archive.zip.infolist()) > _LARGEST:
            raise ConfigurationError(f"its arrays hold more than {_LARGEST:,} bytes", _HINT)
        if archive.zip.testzip():
            raise ValueError("a checksum is wrong")
        return _matrix_of(archive, n_rows, n_columns)


def _read_mat(content: bytes, n_rows: int, n_columns: int) -> Any:
    """Return the only matrix of a file of MATLAB."""
    from scipy.io import loadmat  # lazy

    check_expansion(content)
    # All variables are read, which finds where the file is cut.
    variables = loadmat(io.BytesIO(content))
    return _matrix_of(variables, n_rows, n_columns)


def _read_psb(content: bytes, n_rows: int, n_columns: int) -> NDArray[np.float32]:
    """Return distances as the tools of the Princeton Shape Benchmark write them: 4-byte floats.

    Parameters
    ----------
    content
        The bytes, row by row; rows have the order of a ``.cla`` list.
    n_rows, n_columns
        Shape of the matrix; 0 columns for a square one.

    Raises
    ------
    ConfigurationError
        If its numbers are so small that the order of their bytes must be wrong.
    """
    shape = (n_rows, n_columns)
    if not n_columns:
        side = math.isqrt(len(content) // 4)
        shape = (side, side)
    matrix = np.frombuffer(content, dtype="<f4").reshape(shape)
    # Floats that were written with the highest byte first are read as tiny numbers.
    if ((matrix != 0) & (np.abs(matrix) < _SMALLEST)).any():
        raise ConfigurationError(
            f"it has numbers below {_SMALLEST}", "write it with the lowest byte first"
        )
    return matrix


def _matrix_of(variables: Mapping[str, Any], n_rows: int, n_columns: int) -> Any:
    """Return the only matrix of distances among the variables of a ``.mat`` or ``.npz`` file.

    Parameters
    ----------
    variables
        Arrays, and other values that are ignored, by name.
    n_rows, n_columns
        Expected shape; 0 columns for any square matrix.

    Returns
    -------
    numpy.ndarray or pandas.DataFrame
        A frame if another variable lists the names of its shapes, as texts or whole numbers.

    Raises
    ------
    ConfigurationError
        If several matrices fit, or none, or another variable numbers the rows out of order, or
        names may be those of rows or of columns.
    """
    from pandas import DataFrame

    arrays = {
        name: value
        for name, value in variables.items()
        if isinstance(value, np.ndarray) and value.size > 1
    }
    fitting = []
    for name, array in arrays.items():
        expected = (n_rows, n_columns) if n_columns else array.shape[:1] * 2  # (n, n)
        if array.dtype.kind in "iuf" and array.shape == expected:
            fitting.append(name)
    matrix = arrays.pop(_only(fitting))
    rows = columns = _names_of_axis(arrays, len(matrix))
    if n_columns:
        columns = _names_of_axis(arrays, n_columns)
        if rows and columns and n_rows == n_columns:
            problem = "it does not say whether its names are those of the rows or of the columns"
            raise ConfigurationError(problem, "name rows and columns in a .csv file")
    return DataFrame(matrix, rows, columns) if rows or columns else matrix


def _names_of_axis(arrays: Mapping[str, NDArray[Any]], size: int) -> list[str] | None:
    """Return the names of the rows, or of the columns, of a matrix; None if no array lists them.

    Parameters
    ----------
    arrays
        The other arrays of the file, by name.
    size
        Number of rows or columns.

    Raises
    ------
    ConfigurationError
        If an array numbers them out of order.
    """
    _check_row_numbers(arrays, size)
    different = [names for names in _lists_of_names(arrays, size) if len(set(names)) == size]
    return different[0] if different else None


def _check_row_numbers(arrays: Mapping[str, NDArray[Any]], n_rows: int) -> None:
    """Raise ``ConfigurationError`` if an array beside a matrix numbers its rows out of order."""
    for name, array in arrays.items():
        if array.dtype.kind not in "iu" or array.size != n_rows:
            continue
        numbers = [str(number) for number in array.ravel().tolist()]
        in_order = sorted(numbers, key=int)
        if are_row_numbers(in_order) and numbers != in_order:
            problem = f"'{name}' numbers the rows in another order than the labels may have"
            hint = f"put rows and columns into the order of the labels, and leave out '{name}'"
            raise ConfigurationError(problem, hint)


def _lists_of_names(arrays: Mapping[str, NDArray[Any]], n_rows: int) -> Iterator[list[str]]:
    """Yield the arrays that can name rows: those of texts, then those of whole numbers."""
    of_size = [array for array in arrays.values() if array.size == n_rows]
    texts = [array for array in of_size if array.dtype.kind in "SUO"]
    numbers = [array for array in of_size if array.dtype.kind in "iu"]
    for array in (*texts, *numbers):
        try:
            yield names_of(array.ravel())
        except ConfigurationError:  # they are something else
            continue


def _only(names: Sequence[str]) -> str:
    """Return the name of the only matrix of a file."""
    if len(names) == 1:
        return names[0]
    if "distances" in names:
        return "distances"
    every = ", ".join(sorted(names)) or "none"
    problem = f"it has {len(names)} full matrices of real numbers: {every}"
    raise ConfigurationError(problem, "name the right one 'distances'")
