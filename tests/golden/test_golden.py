"""What each component makes of small committed inputs is what it made before; ``make golden`` runs
all of them.

After a change that is meant, ``make golden ARGS="--force-regen -k NAME"`` writes the files again:
say in the commit by how much each array moved, and why."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmark.errors import ShapeError
from tests.golden.components import components
from tests.golden.inputs import GOLDEN

Arrays = dict[str, NDArray[Any]]

#: Number of rows above which only every tenth row of floats is stored, and size above which
#: integers are stored as their digest.
MOST_ROWS, MOST_INTEGERS = 800, 3000

#: Smallest unit of a difference. Shapes have unit area: smaller values, such as the stress of a
#: perfect form, have no scale of their own.
SMALLEST = 1e-3


def compute(name: str) -> Arrays:
    """Compute the results of a component, as stored."""
    arrays: Arrays = {"revision": np.array(0)}
    for part in components()[name].parts():
        try:
            values = part.make(*part.arguments)
        except ShapeError as error:
            values = {"refused": type(error).__name__}
        for key, value in values.items():
            arrays[f"{part.name}/{key}"] = reduced(np.asarray(value))
    return arrays


def reduced(array: NDArray[Any]) -> NDArray[Any]:
    if array.dtype.kind == "f" and array.ndim and len(array) > MOST_ROWS:
        return array[::10]
    if array.dtype.kind in "iu" and array.size > MOST_INTEGERS:
        return np.array(
            f"{array.dtype.str} {array.shape} {hashlib.sha256(array.tobytes()).hexdigest()[:16]}"
        )
    return array


def tolerance(name: str, arrays: Arrays, share: float) -> dict[str, float]:
    """Return the tolerance of an array: a share of its largest value."""
    array = arrays[name]
    if array.dtype.kind != "f":
        return {}
    unit = np.abs(array[np.isfinite(array)]).max(initial=0.0)
    return {"atol": share * max(float(unit), SMALLEST), "rtol": 0.0}


@pytest.mark.golden
@pytest.mark.parametrize("name", list(components()))
def test_golden(name, ndarrays_regression):
    arrays = compute(name)
    share = components()[name].tolerance
    tolerances = {key: tolerance(key, arrays, share) for key in arrays}
    ndarrays_regression.check(arrays, fullpath=GOLDEN / f"{name}.npz", tolerances=tolerances)


def test_each_golden_file_belongs_to_a_component():
    files = {str(path.relative_to(GOLDEN).with_suffix("")) for path in GOLDEN.rglob("*.npz")}
    assert {name for name in files if not name.startswith("inputs/")} == set(components())
