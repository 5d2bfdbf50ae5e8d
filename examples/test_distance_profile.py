"""What Distance Profile promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmark.api import Shape
from benchmark.plugins.conformance import check_target, figure
from benchmark.plugins.registry import plugin_methods

PLUGIN = Path(__file__).with_name("distance_profile.py")


def test_it_keeps_the_contract() -> None:
    report = check_target(str(PLUGIN))
    assert report, f"\n{report}"


def test_a_quantile_of_one_half_is_the_mean_of_a_vertex_in_the_middle() -> None:
    (spec,) = plugin_methods(PLUGIN)
    shape = Shape(identifier="figure", mesh=figure())
    area = shape.laplacian().mass
    means = shape.geodesics() @ area / area.sum()
    (half,) = spec.load()(count=1).describe(shape)
    assert means.min() < half < means.max()
    assert abs(area[means < half].sum() / area.sum() - 0.5) < 0.01
    distances = spec.create().distances([np.zeros(50), np.ones(50)])
    np.testing.assert_allclose(distances, [[0, 50], [50, 0]])
