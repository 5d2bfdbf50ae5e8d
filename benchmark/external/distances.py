"""Distances and ranked lists in the files of other programs; nothing that such a file could run is read."""

from __future__ import annotations

import math
import re
import warnings
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.arrays import LARGEST, read_array
from benchmark.errors import ConfigurationError, one_line
from benchmark.external.labels import Labels

_HINT = "write the matrix as text, CSV, .npy, .npz, .mat (-v7) or as PSB's .matrix"


@dataclass(frozen=True, eq=False)
class DistanceMatrix:
    """Distances of queries, the rows, from the shapes of a gallery, the columns.

    Parameters
    ----------
    values
        Shape (queries, gallery).
    queries, gallery
        Names of rows and columns; empty where the file names none.
    """

    values: NDArray[Any]
    queries: tuple[str, ...] = ()
    gallery: tuple[str, ...] = ()


def as_distances(distances: object) -> DistanceMatrix:
    """Distances from a path, a pandas frame whose index and columns name shapes, or an array.

    Raises
    ------
    ConfigurationError
        If a file cannot be read, or does not hold one matrix of real numbers.
    """
    if isinstance(distances, DistanceMatrix):
        return distances
    if isinstance(distances, str | Path):
        return read_distances(Path(distances))
    axes = (distances.index, distances.columns) if hasattr(distances, "columns") else ()  # type: ignore[attr-defined]
    names = [tuple(map(str, axis)) if axis.dtype.kind not in "iu" else () for axis in axes]
    return DistanceMatrix(_matrix(np.asarray(distances), "the distances"), *names)


def read_distances(path: Path) -> DistanceMatrix:
    """Read a matrix: see :func:`as_distances`. What has no known extension is text."""
    _require_size(path)
    readers = {".npy": _read_npy, ".npz": _read_npz, ".mat": _read_mat, ".matrix": _read_psb}
    try:
        if path.suffix.lower() in readers:
            return DistanceMatrix(_matrix(readers[path.suffix.lower()](path), str(path)))
        return _read_text(path)
    except ConfigurationError:
        raise
    except MemoryError as error:
        raise ConfigurationError(f"{path} announces more than memory holds", "use a larger machine") from error
    except Exception as error:  # of a damaged file, in whatever library
        raise ConfigurationError(f"{path} cannot be read: {one_line(error)}", _HINT) from error


def read_ranked(path: Path, labels: Labels) -> DistanceMatrix:
    """Read ranked lists: a query and its results on each line, the nearest first.

    What is not listed ties behind all others.

    Raises
    ------
    ConfigurationError
        If a name has no label, or stands twice in a list.
    """
    _require_size(path)
    if not labels.names:
        raise ConfigurationError("ranked lists need labels with names", "write 'name label' on each line of the labels")
    rows = [re.split(r"[,\s]+", line.strip()) for line in _lines(path)]
    places = {name: place for place, name in enumerate(labels.names)}
    queries = tuple(query for query, *_ in rows)
    ranks = np.full((len(rows), len(places)), float(len(places) + 1))
    for number, (query, *results) in enumerate(rows):
        labels.of([query, *results], f"{path}, list {number + 1}")
        if len(set(results)) != len(results) or queries.index(query) != number:
            raise ConfigurationError(f"{path}: the list of '{query}' names a shape twice", "list each shape once")
        ranks[number, [places[name] for name in results]] = np.arange(1, len(results) + 1)
        ranks[number, places[query]] = 0.0
    return DistanceMatrix(ranks, queries, labels.names)


def _require_size(path: Path) -> None:
    if not path.is_file():
        raise ConfigurationError(f"there is no file {path}", "name the file of the distances")
    if path.stat().st_size > LARGEST:
        raise ConfigurationError(f"{path} has more than {LARGEST // 2**30} GiB", "write it in single precision (.npy)")


def _matrix(array: NDArray[Any], what: str) -> NDArray[Any]:
    if array.ndim != 2 or not array.size or array.dtype.kind not in "iufb":
        raise ConfigurationError(f"{what}: an array of shape {array.shape}, {array.dtype}, is no matrix", _HINT)
    return array


def _only(found: Mapping[str, Any], path: Path) -> str:
    """Name of the matrix among the variables of a file."""
    names = [name for name in found if len(found) == 1 or name == "distances"]
    if not names:
        listed = ", ".join(sorted(found)) or "none"
        raise ConfigurationError(f"{path} holds several matrices, or none: {listed}", "name the right one 'distances'")
    return names[0]


def _read_npy(path: Path) -> NDArray[Any]:
    loaded: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)  # a header announces no more than there is
    return loaded


def _read_npz(path: Path) -> NDArray[Any]:
    with zipfile.ZipFile(path) as archive:
        parts = {part.filename.removesuffix(".npy"): part for part in archive.infolist()}
        part = parts[_only(parts, path)]
        if part.file_size > LARGEST:
            raise ConfigurationError(f"{path} expands to more than {LARGEST // 2**30} GiB", _HINT)
        return read_array(archive, part)


def _read_mat(path: Path) -> NDArray[Any]:
    from scipy.io import loadmat, whosmat

    sizes = {name: math.prod(shape) for name, shape, kind in whosmat(path) if kind in ("double", "single")}
    name = _only({name: size for name, size in sizes.items() if size > 1}, path)
    if 8 * sizes[name] > LARGEST:
        raise ConfigurationError(f"{path} expands to more than {LARGEST // 2**30} GiB", _HINT)
    return np.asarray(loadmat(path, variable_names=[name])[name])


def _read_psb(path: Path) -> NDArray[Any]:
    """Single precision, little-endian, row by row, without a header."""
    numbers = np.fromfile(path, "<f4")
    count = math.isqrt(len(numbers))
    if path.stat().st_size != 4 * count * count:
        raise ConfigurationError(f"{path} has {path.stat().st_size} bytes, not 4 N x N", _HINT)
    return numbers.reshape(count, count)


def _lines(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8-sig")
    return [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _read_text(path: Path) -> DistanceMatrix:
    """Numbers between blanks, commas or semicolons; a head of names, or of the size, and a column of names may be."""
    lines = _lines(path)
    delimiter = next((mark for mark in ",;\t" if any(mark in line for line in lines[:2])), None)
    split = [line.split(delimiter) for line in islice(lines, 2)]
    words = [[word.strip().strip('"') for word in line] for line in split]
    gallery: tuple[str, ...] = ()
    if len(words) == 2 and not all(_is_number(word) for word in words[0] if word):
        gallery, lines = tuple(words[0]), lines[1:]
    elif len(words) == 2 and len(words[0]) <= 2 < len(words[1]) and words[0][0] == str(len(lines) - 1):
        lines = lines[1:]  # the number of shapes, as some programs write it first
    is_named = not _is_number(words[-1][0])
    columns = range(int(is_named), len(words[-1])) if words[-1][-1] else range(int(is_named), len(words[-1]) - 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        values = np.loadtxt(lines, delimiter=delimiter, usecols=columns, ndmin=2)
    if any(len(line.split(delimiter)) != len(words[-1]) for line in lines):
        raise ConfigurationError(f"{path}: its lines have different numbers of columns", _HINT)
    queries = tuple(line.split(delimiter, 1)[0].strip().strip('"') for line in lines) if is_named else ()
    if gallery and len(gallery) == values.shape[1] + 1:
        gallery = gallery[1:]  # the corner
    return DistanceMatrix(_matrix(values, str(path)), queries, gallery)
