"""Surfaces of fifty thousand vertices: a finite form, or a refusal that says what to do."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmark.api.contracts import Shape, UnsupportedShape
from benchmark.registry import select_one
from tests.baselines.embedding import sphere

FEW_ROWS = ("fast-classical-scaling", "accelerated-mds")
ALL_PAIRS = (
    "classic-mds",
    "least-squares-mds",
    "non-metric-mds",
    "constrained-mds",
    "feature-preserved",
    "sd-gdm",
)


@cache
def large() -> Shape:
    ball = sphere(50_000)
    return Shape(identifier="large", mesh=ball.with_vertices(ball.vertices * [3.0, 2.0, 1.0]))


@pytest.mark.slow
@pytest.mark.parametrize("name", FEW_ROWS)
def test_methods_that_need_few_rows_have_a_form(name):
    form = select_one(name).create().canonicalise(large())
    extent = np.ptp(form.vertices, axis=0)
    assert np.isfinite(form.vertices).all()
    assert extent.min() > 0.1 * extent.max()


@pytest.mark.parametrize("name", ALL_PAIRS)
def test_methods_that_need_all_pairs_refuse(name):
    made = select_one(name).create()
    with pytest.raises(UnsupportedShape, match="50000 vertices, where the distances of all pairs"):
        made.describe(large()) if hasattr(made, "describe") else made.canonicalise(large())
