"""Read distance matrices and labels of other programs; code in their files never runs."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.folder import folder_set, read_cla
from benchmark.errors import ConfigurationError, one_line

_HINT = "write the matrix as .npy, .npz, .txt, .csv or .mat (-v7)"

#: Largest size of a file in bytes.
_LARGEST = 2**31


@dataclass(frozen=True, eq=False)
class DistanceMatrix:
    """Distances between all pairs of shapes.

    Parameters
    ----------
    values
        Shape (N, N).
    names
        Names of rows and columns; empty if the file has none.
    """

    values: NDArray[np.float64]
    names: tuple[str, ...] = ()


def as_labels(labels: object) -> dict[str, str] | list[str]:
    """Return the class of each shape, by name if the shapes have names.

    Parameters
    ----------
    labels
        A mapping by name (or a pandas Series), a sequence, or the path of a ``.cla`` file, of text with lines ``label``
        or ``name label``, or of a folder of shapes.

    Raises
    ------
    ConfigurationError
        If there are no labels, or a name appears twice.
    DatasetError
        If the folder or the ``.cla`` file cannot be read.
    """
    if isinstance(labels, str | Path):
        return _read_labels(Path(labels))
    given: Any = labels
    if hasattr(given, "items"):
        return {str(name): str(label) for name, label in given.items()}
    return [str(label) for label in given]


def _read_labels(path: Path) -> dict[str, str] | list[str]:
    if path.is_dir():
        return {entry.identifier: entry.subject for entry in folder_set(path).shapes}
    if path.suffix.lower() == ".cla":
        return {str(number): label for number, label in sorted(read_cla(path).items())}
    rows = [re.split(r"[,\s]+", line.strip()) for line in _lines(path)]
    widths = {len(row) for row in rows}
    if widths == {1}:
        return [row[0] for row in rows]
    if widths != {2}:
        problem = f"{path} has lines of {' and '.join(map(str, sorted(widths)))} words" if rows else f"{path} is empty"
        raise ConfigurationError(problem, "write 'label' or 'name label' on each line")
    labels = dict(rows)
    if len(labels) < len(rows):
        raise ConfigurationError(f"{path} names a shape twice", "name each shape once")
    return labels


def as_distances(distances: object) -> DistanceMatrix:
    """Return distances from a path, an array, or a pandas frame whose index and columns name the shapes.

    Raises
    ------
    ConfigurationError
        If a file cannot be read, or they are not one N x N matrix of real numbers.
    """
    if isinstance(distances, str | Path):
        return _read_distances(Path(distances))
    if not hasattr(distances, "columns"):
        return DistanceMatrix(_square(np.asarray(distances), "the distances"))
    frame: Any = distances
    names = tuple(map(str, frame.index))
    if names != tuple(map(str, frame.columns)):
        frame = _reordered(frame, names)
    is_counted = frame.index.dtype.kind in "iu"
    return DistanceMatrix(_square(np.asarray(frame), "the distances"), () if is_counted else names)


def _read_distances(path: Path) -> DistanceMatrix:
    if not path.is_file():
        raise ConfigurationError(f"there is no file {path}", "name the file of the distances")
    if path.stat().st_size > _LARGEST:
        raise ConfigurationError(f"{path} has more than {_LARGEST // 2**30} GiB", "write it in single precision (.npy)")
    readers = {".npy": _read_npy, ".npz": _read_npz, ".mat": _read_mat}
    try:
        if path.suffix.lower() in readers:
            return DistanceMatrix(_square(readers[path.suffix.lower()](path), str(path)))
        return _read_text(path)
    except (ConfigurationError, MemoryError):
        raise
    except Exception as error:  # of any library, for a damaged file
        raise ConfigurationError(f"{path} cannot be read: {one_line(error)}", _HINT) from error


def _read_npy(path: Path) -> NDArray[Any]:
    loaded: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)  # reads no more than the file contains
    return loaded


def _read_npz(path: Path) -> NDArray[Any]:
    with np.load(path, allow_pickle=False) as archive:
        sizes = {part.filename.removesuffix(".npy"): part.file_size for part in archive.zip.infolist()}
        return np.asarray(archive[_only(sizes, path)])


def _read_mat(path: Path) -> NDArray[Any]:
    from scipy.io import loadmat, whosmat

    sizes = {name: 8 * int(np.prod(shape)) for name, shape, kind in whosmat(path) if kind in ("double", "single")}
    name = _only({name: size for name, size in sizes.items() if size > 8}, path)
    return np.asarray(loadmat(path, variable_names=[name])[name])


def _only(sizes: Mapping[str, int], path: Path) -> str:
    """Return the name of the only matrix among the variables of a file, given their sizes in bytes."""
    names = [name for name in sizes if len(sizes) == 1 or name == "distances"]
    if not names:
        listed = ", ".join(sorted(sizes)) or "none"
        raise ConfigurationError(f"{path} has several matrices, or none: {listed}", "name the right one 'distances'")
    if sizes[names[0]] > _LARGEST:
        raise ConfigurationError(f"{path} expands to more than {_LARGEST // 2**30} GiB", _HINT)
    return names[0]


def _read_text(path: Path) -> DistanceMatrix:
    """Read numbers separated by blanks, commas or semicolons, with names in the first row and column or without."""
    lines = _lines(path)
    if not lines:
        raise ConfigurationError(f"{path} is empty", _HINT)
    if _is_number(lines[-1].replace(",", " ").replace(";", " ").split()[0]):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            values = np.loadtxt([re.sub("[,;]", " ", line) for line in lines], ndmin=2)
        return DistanceMatrix(_square(values, str(path)))
    import pandas as pd

    return as_distances(pd.read_csv(path, sep="[,;\t]|\\s+", index_col=0, engine="python", dtype={0: str}))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _lines(path: Path) -> list[str]:
    if not path.is_file() or path.stat().st_size > _LARGEST:
        raise ConfigurationError(f"there is no readable file {path}", "name another one")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path} is not a text: {one_line(error)}", "name another file") from error
    return [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def _reordered(frame: Any, names: tuple[str, ...]) -> Any:
    frame = frame.set_axis([str(name) for name in frame.columns], axis=1)
    if sorted(names) != sorted(frame.columns):
        raise ConfigurationError("rows and columns of the distances have different names", "name both like the shapes")
    return frame[list(names)]


def _square(array: NDArray[Any], what: str) -> NDArray[np.float64]:
    if array.ndim != 2 or array.shape[0] != array.shape[1] or not array.size or array.dtype.kind not in "iufb":
        raise ConfigurationError(f"{what}: an array of shape {array.shape}, {array.dtype}, is no N x N matrix", _HINT)
    return np.asarray(array, dtype=np.float64)
