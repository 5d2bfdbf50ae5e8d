"""Read distances, ranked lists and labels of other programs; code in their files never runs."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.arrays import LARGEST
from benchmark.datasets.base import printable
from benchmark.datasets.folder import folder_set, read_cla
from benchmark.datasets.settings import text_of
from benchmark.errors import ConfigurationError, one_line

_HINT = "write the matrix as text, CSV, .npy, .npz, .mat (-v7) or as PSB's .matrix"

#: Largest size of a label file in bytes.
_LARGEST_LABELS = 2**26

#: Separates several labels of one shape.
SEVERAL = ";"


@dataclass(frozen=True)
class Labels:
    """Labels of shapes in the order of a matrix.

    Parameters
    ----------
    classes
        Labels of each shape, one or several.
    names
        Names of the shapes; empty if they have none.
    """

    classes: tuple[tuple[str, ...], ...]
    names: tuple[str, ...] = ()

    def of(self, names: Sequence[str], what: str) -> Labels:
        """Return the labels of some shapes; raise ``ConfigurationError`` for a shape without a label."""
        if not self.names and len(names) == len(self.classes):
            return Labels(self.classes, tuple(names))
        by_name = dict(zip(self.names, self.classes, strict=False))
        if unknown := [name for name in names if name not in by_name]:
            known = ", ".join(self.names[:3])
            raise ConfigurationError(
                f"{what}: {len(unknown)} shapes have no label, the first is '{unknown[0]}'",
                f"use the names of the labels: {known} ..." if known else "name the labels",
            )
        return Labels(tuple(by_name[name] for name in names), tuple(names))


@dataclass(frozen=True, eq=False)
class DistanceMatrix:
    """Distances between queries (rows) and the shapes of a gallery (columns).

    Parameters
    ----------
    values
        Shape (queries, gallery).
    queries, gallery
        Names of rows and columns; empty if the file has none.
    """

    values: NDArray[Any]
    queries: tuple[str, ...] = ()
    gallery: tuple[str, ...] = ()


# Labels --------------------------------------------------------------------------------------------------------------


def as_labels(labels: object) -> Labels:
    """Return labels from a path, a mapping by name (including a pandas Series), or a sequence.

    Raises
    ------
    ConfigurationError
        If there are no labels, or a name appears twice.
    DatasetError
        If the file or the folder cannot be read.
    """
    if isinstance(labels, Labels):
        return labels
    if isinstance(labels, str | Path):
        return read_labels(Path(labels))
    given: Any = labels
    pairs = dict(given.items()) if hasattr(given, "items") else None
    values = given if pairs is None else pairs.values()
    classes = tuple(tuple(map(str, v)) if isinstance(v, list | tuple | set) else (str(v),) for v in values)
    return _checked(Labels(classes, tuple(map(str, pairs or ()))), "the labels")


def read_labels(path: Path) -> Labels:
    """Read labels from a ``.cla`` file, a folder of shapes, or text lines ``label`` or ``name label``."""
    if path.is_dir():
        entries = folder_set(path).shapes
        return Labels(tuple((entry.subject,) for entry in entries), tuple(entry.identifier for entry in entries))
    if path.suffix.lower() == ".cla":
        numbers = sorted(read_cla(path).items())
        return Labels(tuple((name,) for _, name in numbers), tuple(str(number) for number, _ in numbers))
    if path.is_file() and path.stat().st_size > _LARGEST_LABELS:
        raise ConfigurationError(f"{path} is too large for a list of labels", "name another file")
    rows = [re.split(r"[,\s]+", line.strip()) for line in _content(text_of(path))]
    widths = {len(row) for row in rows}
    if widths not in ({1}, {2}):
        problem = f"{path} has lines of {' and '.join(map(str, sorted(widths)))} words" if rows else f"{path} is empty"
        raise ConfigurationError(
            problem, f"write 'label' or 'name label' on each line; '{SEVERAL}' separates several labels of a shape"
        )
    classes = tuple(tuple(filter(None, printable(row[-1]).split(SEVERAL))) for row in rows)
    return _checked(Labels(classes, tuple(printable(row[0]) for row in rows) if widths == {2} else ()), str(path))


def _checked(labels: Labels, what: str) -> Labels:
    if not labels.classes or not all(labels.classes):
        raise ConfigurationError(f"{what}: a shape has no label", "give each shape at least one label")
    if len(set(labels.names)) != len(labels.names):
        twice = next(name for name in labels.names if labels.names.count(name) > 1)
        raise ConfigurationError(f"{what}: '{twice}' appears twice", "name each shape once")
    return labels


def _content(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


# Distances -----------------------------------------------------------------------------------------------------------


def as_distances(distances: object) -> DistanceMatrix:
    """Return distances from a path, a pandas frame whose index and columns name shapes, or an array.

    Raises
    ------
    ConfigurationError
        If a file cannot be read, or does not hold exactly one matrix of real numbers.
    """
    if isinstance(distances, DistanceMatrix):
        return distances
    if isinstance(distances, str | Path):
        return read_distances(Path(distances))
    axes = (distances.index, distances.columns) if hasattr(distances, "columns") else ()  # type: ignore[attr-defined]
    names = [tuple(map(str, axis)) if axis.dtype.kind not in "iu" else () for axis in axes]
    return DistanceMatrix(_matrix(np.asarray(distances), "the distances"), *names)


def read_distances(path: Path) -> DistanceMatrix:
    """Read a matrix; see :func:`as_distances`. Files with unknown extensions are read as text."""
    _require_size(path)
    readers = {".npy": _read_npy, ".npz": _read_npz, ".mat": _read_mat, ".matrix": _read_psb}
    try:
        if path.suffix.lower() in readers:
            return DistanceMatrix(_matrix(readers[path.suffix.lower()](path), str(path)))
        return _read_text(path)
    except ConfigurationError:
        raise
    except MemoryError as error:
        raise ConfigurationError(f"{path} needs more memory than available", "use a larger machine") from error
    except Exception as error:  # of any library, for a damaged file
        raise ConfigurationError(f"{path} cannot be read: {one_line(error)}", _HINT) from error


def read_ranked(path: Path, labels: Labels) -> DistanceMatrix:
    """Read ranked lists: on each line a query and its results, nearest first.

    Shapes that are not listed tie behind all others.

    Raises
    ------
    ConfigurationError
        If a name has no label, or appears twice in a list.
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
        raise ConfigurationError(f"{what}: an array of shape {array.shape}, {array.dtype}, is not a matrix", _HINT)
    return array


def _only(sizes: Mapping[str, int], path: Path) -> str:
    """Return the name of the only matrix among the variables of a file, given their sizes in bytes."""
    names = [name for name in sizes if len(sizes) == 1 or name == "distances"]
    if not names:
        listed = ", ".join(sorted(sizes)) or "none"
        raise ConfigurationError(f"{path} has several matrices, or none: {listed}", "name the right one 'distances'")
    if sizes[names[0]] > LARGEST:
        raise ConfigurationError(f"{path} expands to more than {LARGEST // 2**30} GiB", _HINT)
    return names[0]


def _read_npy(path: Path) -> NDArray[Any]:
    loaded: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)  # reads no more than the file contains
    return loaded


def _read_npz(path: Path) -> NDArray[Any]:
    with np.load(path, allow_pickle=False) as archive:
        sizes = {part.filename.removesuffix(".npy"): part.file_size for part in archive.zip.infolist()}
        return np.asarray(archive[_only(sizes, path)])


def _read_mat(path: Path) -> NDArray[Any]:
    from scipy.io import loadmat, whosmat

    sizes = {name: 8 * math.prod(shape) for name, shape, kind in whosmat(path) if kind in ("double", "single")}
    name = _only({name: size for name, size in sizes.items() if size > 8}, path)
    return np.asarray(loadmat(path, variable_names=[name])[name])


def _read_psb(path: Path) -> NDArray[Any]:
    """Read single-precision, little-endian numbers, row by row, without a header."""
    numbers = np.fromfile(path, "<f4")
    count = math.isqrt(len(numbers))
    if path.stat().st_size != 4 * count * count:
        raise ConfigurationError(f"{path} has {path.stat().st_size} bytes, not 4 N x N", _HINT)
    return numbers.reshape(count, count)


def _lines(path: Path) -> list[str]:
    return _content(path.read_text(encoding="utf-8-sig"))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _read_text(path: Path) -> DistanceMatrix:
    """Read numbers separated by blanks, commas or semicolons, with an optional header and column of names."""
    lines = _lines(path)
    delimiter = next((mark for mark in ",;\t" if any(mark in line for line in lines[:2])), None)
    first, *others = [[word.strip().strip('"') for word in line.split(delimiter)] for line in lines[:2]]
    last = others[0] if others else first
    gallery: tuple[str, ...] = ()
    if others and not all(_is_number(word) for word in first if word):
        gallery, lines = tuple(first), lines[1:]
    elif others and len(first) <= 2 < len(last) and first[0] == str(len(lines) - 1):
        lines = lines[1:]  # some programs write the number of shapes first
    is_named = not _is_number(last[0])
    columns = range(int(is_named), len(last) - (not last[-1]))  # a line may end with a delimiter
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        values = np.loadtxt(lines, delimiter=delimiter, usecols=columns, ndmin=2)
    if any(len(line.split(delimiter)) != len(last) for line in lines):
        raise ConfigurationError(f"{path}: its lines have different numbers of columns", _HINT)
    queries = tuple(line.split(delimiter, 1)[0].strip().strip('"') for line in lines) if is_named else ()
    if gallery and not gallery[-1]:
        gallery = gallery[:-1]  # a line may end with a delimiter
    if len(gallery) == values.shape[1] + 1:
        gallery = gallery[1:]  # the cell above the names
    return DistanceMatrix(_matrix(values, str(path)), queries, gallery)
