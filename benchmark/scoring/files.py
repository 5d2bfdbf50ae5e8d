"""Read distance matrices and labels of other programs; code in their files never runs."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.folder import folder_set, read_cla
from benchmark.errors import ConfigurationError, one_line

_HINT = "write the matrix as .npy, .npz, .txt, .csv or .mat (-v7)"

#: Largest size of a file in bytes.
_LARGEST = 2**31


def as_labels(labels: Any) -> dict[str, str] | list[str]:
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
    if hasattr(labels, "items"):
        return {str(name): str(label) for name, label in labels.items()}
    return [str(label) for label in labels]


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
        problem = f"{path} has lines of {' and '.join(map(str, sorted(widths)))} words"
        raise ConfigurationError(problem, "write 'label' or 'name label' on each line")
    labels = dict(rows)
    if len(labels) < len(rows):
        raise ConfigurationError(f"{path} names a shape twice", "name each shape once")
    return labels


def as_distances(distances: object) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Return a matrix of distances and the names of its rows, () if they have none.

    Parameters
    ----------
    distances
        A path, an array, or a pandas frame whose index and columns name the shapes.

    Raises
    ------
    ConfigurationError
        If a file cannot be read, or they are not one N x N matrix of real numbers.
    """
    content: Any = _read(Path(distances)) if isinstance(distances, str | Path) else distances
    what, names = str(distances) if isinstance(distances, str | Path) else "the distances", ()
    if hasattr(content, "columns") and content.index.dtype.kind not in "iu":
        content = content.rename(str, axis="index").rename(str, axis="columns")
        names = tuple(content.index)
        if sorted(names) != sorted(content.columns):
            hint = "name both like the shapes"
            raise ConfigurationError("rows and columns of the distances have different names", hint)
        content = content[list(names)]
    matrix = np.asarray(content)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not matrix.size or matrix.dtype.kind not in "iufb":
        raise ConfigurationError(f"{what}: an array of shape {matrix.shape}, {matrix.dtype}, is no N x N matrix", _HINT)
    return np.asarray(matrix, dtype=np.float64), names


def _read(path: Path) -> Any:
    if not path.is_file():
        raise ConfigurationError(f"there is no file {path}", "name the file of the distances")
    if path.stat().st_size > _LARGEST:
        raise ConfigurationError(f"{path} has more than {_LARGEST // 2**30} GiB", "write it in single precision (.npy)")
    suffix = path.suffix.lower()
    try:
        if suffix == ".npy":
            return np.load(path, mmap_mode="r", allow_pickle=False)  # reads no more than the file contains
        if suffix == ".npz":
            with np.load(path, allow_pickle=False) as archive:
                sizes = {part.filename.removesuffix(".npy"): part.file_size for part in archive.zip.infolist()}
                return archive[_only(sizes, path)]
        if suffix == ".mat":
            from scipy.io import loadmat, whosmat

            kinds = ("double", "single")
            sizes = {name: 8 * int(np.prod(n)) for name, n, kind in whosmat(path) if kind in kinds and np.prod(n) > 1}
            return loadmat(path, variable_names=[name := _only(sizes, path)])[name]
        return _read_text(path)
    except (ConfigurationError, MemoryError):
        raise
    except Exception as error:  # of any library, for a damaged file
        raise ConfigurationError(f"{path} cannot be read: {one_line(error)}", _HINT) from error


def _only(sizes: Mapping[str, int], path: Path) -> str:
    """Return the name of the only matrix among the variables of a file, given their sizes in bytes."""
    names = [name for name in sizes if len(sizes) == 1 or name == "distances"]
    if not names:
        listed = ", ".join(sorted(sizes)) or "none"
        raise ConfigurationError(f"{path} has several matrices, or none: {listed}", "name the right one 'distances'")
    if sizes[names[0]] > _LARGEST:
        raise ConfigurationError(f"{path} expands to more than {_LARGEST // 2**30} GiB", _HINT)
    return names[0]


def _read_text(path: Path) -> Any:
    """Read numbers separated by blanks, commas or semicolons, with names in the first row and column or without."""
    lines = _lines(path)
    try:
        float(re.split(r"[,;\s]+", lines[-1].strip())[0])
    except ValueError:
        from pandas import read_csv

        text = io.StringIO("\n".join(lines))
        return read_csv(text, sep="[,;\t]|\\s+", index_col=0, engine="python", dtype={0: str})
    return np.loadtxt([re.sub("[,;]", " ", line) for line in lines], ndmin=2)


def _lines(path: Path) -> list[str]:
    """Return the lines of a text with content, without comments."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path} cannot be read: {one_line(error)}", "name a text file") from error
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise ConfigurationError(f"{path} is empty", "name another file")
    return lines
