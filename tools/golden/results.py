"""Compute, compare and write golden files; the digest of the content of a file is the version of its component."""

from __future__ import annotations

import hashlib
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import ShapeError
from benchmark.source_code import digest_of_bytes
from tools.golden.components import components
from tools.golden.inputs import GOLDEN

Arrays = dict[str, NDArray[Any]]

#: Number of rows above which only every tenth row of floats is stored, and size above which integers are stored as
#: their digest.
MOST_ROWS, MOST_INTEGERS = 800, 3000

#: Smallest unit of a difference. Shapes have unit area: smaller values, such as the stress of a perfect form, have no
#: scale of their own.
SMALLEST = 1e-3

#: Note of a form with the number of iterations, and the stress below which it depends on rounding errors.
ITERATIONS = "note:iterations"
PERFECT = 1e-12

#: Increased by hand if something changes that no small input shows.
REVISION = "revision"


class Difference(NamedTuple):
    """Change of an array, relative to its largest value; infinite if it is not comparable."""

    array: str
    difference: float
    tolerance: float


def golden_path(name: str) -> Path:
    """Return the file of the golden results of a component."""
    return GOLDEN / f"{name}.npz"


def read_golden(name: str) -> Arrays:
    """Return the golden results of a component; empty if there are none."""
    if not golden_path(name).exists():
        return {}
    with np.load(golden_path(name), allow_pickle=False) as archive:
        return dict(archive)


def write_golden(name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write golden results, and keep the revision."""
    revision = read_golden(name).get(REVISION, np.array(0))
    golden_path(name).parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(golden_path(name), allow_pickle=False, **{**arrays, REVISION: revision})


def version_of(arrays: Mapping[str, NDArray[Any]]) -> str:
    """Return the digest of named arrays, independent of their order and compression."""
    parts = [
        f"{name} {array.dtype.str} {array.shape} ".encode() + array.tobytes() for name, array in sorted(arrays.items())
    ]
    return digest_of_bytes(b"".join(parts))


def run_component(name: str) -> Arrays:
    """Compute the results of a component, as stored."""
    arrays: Arrays = {}
    for part in components()[name].parts():
        try:
            values = part.make(*part.arguments)
        except ShapeError as error:
            values = {"refused": type(error).__name__}
        for key, value in values.items():
            array = _kept(np.asarray(value))
            if array is not None:
                arrays[f"{part.name}/{key}"] = array
    return arrays


def results_of(name: str) -> tuple[str, Arrays, str]:
    """Return the name of a component, its results, and the error if there was one."""
    try:
        return name, run_component(name), ""
    except Exception:
        return name, {}, f"{name} failed:\n{traceback.format_exc()}"


def _kept(array: NDArray[Any]) -> NDArray[Any]:
    if array.dtype.kind == "f" and array.ndim and len(array) > MOST_ROWS:
        return array[::10]
    if array.dtype.kind in "iu" and array.size > MOST_INTEGERS:
        return np.array(f"{array.dtype.str} {array.shape} {hashlib.sha256(array.tobytes()).hexdigest()[:16]}")
    return array


def compare(name: str, arrays: Mapping[str, NDArray[Any]]) -> list[Difference]:
    """Return the arrays that differ from the golden ones by more than the tolerance, largest difference first."""
    golden, tolerance = read_golden(name), components()[name].tolerance
    moved = []
    for key in sorted((golden.keys() | arrays.keys()) - {REVISION}):
        if key.endswith(ITERATIONS) and golden.get(f"{key.removesuffix(ITERATIONS)}note:stress", 1) < PERFECT:
            continue  # rounding errors, which depend on the processor, decide when a perfect fit ends
        allowed = tolerance if key in arrays and arrays[key].dtype.kind == "f" else 0.0
        if (difference := _difference(golden.get(key), arrays.get(key))) > allowed:
            moved.append(Difference(key, difference, allowed))
    return sorted(moved, key=lambda moved_array: -moved_array.difference)


def _difference(golden: NDArray[Any] | None, array: NDArray[Any] | None) -> float:
    """Return the largest difference relative to the largest golden value; 0 or infinite unless both are floats."""
    if golden is None or array is None or (golden.dtype.kind, golden.shape) != (array.dtype.kind, array.shape):
        return np.inf
    if golden.dtype.kind != "f":
        return 0.0 if np.array_equal(golden, array) else np.inf
    finite = np.isfinite(golden)
    if not np.array_equal(finite, np.isfinite(array)):
        return np.inf
    unit = max(np.abs(golden[finite]).max(initial=0.0), SMALLEST)
    return float(np.abs(array[finite] - golden[finite]).max(initial=0.0) / unit)
