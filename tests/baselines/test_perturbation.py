"""No method may turn a rounding error into another form, on surfaces with and without symmetries."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmark.api.contracts import FloatArray, Mesh, Method
from benchmark.check.shapes import figure, view
from benchmark.registry import BUILT_IN, methods
from tests.baselines.deformable import moved_to, shape_of, sheet, tube
from tests.baselines.perturbation import moved, other_rounding

SHAPES = {
    "closed": figure,
    "open and bridged": lambda: view().mesh,
    "flat strip": sheet,
    "rolled strip": lambda: sheet(bend=2.0),
    "round tube": lambda: tube(0.0),
    "bent tube": lambda: tube(2.4),
}
METHODS = {name: methods()[name] for name, target in BUILT_IN.items() if target.startswith("baselines.")}

#: Largest move of a vertex after rigid alignment, relative to the size of the form. Distances are kept in single
#: precision, so that a move of 1e-13 may become one of 1e-7.
TOLERANCE = 1e-6
#: Non-metric scaling gives equal distances equal disparities. Which distances are equal in single precision is the one
#: decision that cannot be given a margin: distances lie as densely as their rounding errors, and a margin would make
#: one chain of all of them.
TOLERANCES = {"non-metric-mds": 2e-4}


@cache
def shape(name: str) -> Mesh:
    return SHAPES[name]()


def answer(name: str, mesh: Mesh) -> FloatArray:
    method = METHODS[name].create()
    prepared = shape_of(mesh)
    prepared.source_area = mesh.area
    return method.canonicalise(prepared).vertices if isinstance(method, Method) else method.describe(prepared)


def perturbed(name: str, mesh: Mesh, seed: int) -> FloatArray:
    with other_rounding(seed):
        return answer(name, moved(mesh, seed))


def check(name: str, mesh: Mesh, seed: int) -> None:
    expected, disturbed = answer(name, mesh), perturbed(name, mesh, seed)
    size = np.abs(expected).max()
    if expected.ndim == 2:
        disturbed, size = moved_to(disturbed, expected), np.ptp(expected, axis=0).max()
    np.testing.assert_allclose(disturbed, expected, rtol=0, atol=TOLERANCES.get(name, TOLERANCE) * size)


@pytest.mark.parametrize("surface", ["closed", "round tube"])
@pytest.mark.parametrize("name", METHODS)
def test_rounding_errors_do_not_change_the_answer(name, surface):
    check(name, shape(surface), 1)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", [2, 3, 4])
@pytest.mark.parametrize("surface", SHAPES)
@pytest.mark.parametrize("name", METHODS)
def test_more_rounding_errors_on_more_surfaces(name, surface, seed):
    check(name, shape(surface), seed)


@pytest.mark.parametrize("name", ["skeleton", "gps"])
def test_the_disturbance_is_real(name):
    """An answer that no rounding error reached would prove nothing."""
    assert not np.array_equal(perturbed(name, shape("closed"), 1), answer(name, shape("closed")))


def test_a_choice_by_the_last_bits_would_be_found(monkeypatch):
    monkeypatch.setattr("baselines._kernels.orientation.TIE", 0.0)
    monkeypatch.setattr("baselines._kernels.orientation.STEP", 1e-300)
    with pytest.raises(AssertionError, match="Not equal to tolerance"):
        for name, surface in (("fast-mds", "flat strip"), ("fast-mds", "round tube"), ("classic-mds", "round tube")):
            check(name, shape(surface), 1)
