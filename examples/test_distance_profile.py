"""What Distance Profile promises."""

from __future__ import annotations

import numpy as np
from distance_profile import DistanceProfile

from benchmark.api import Shape
from benchmark.check import failures
from benchmark.check.shapes import figure


def test_it_keeps_the_contract() -> None:
    assert not failures(DistanceProfile)


def test_a_quantile_of_one_half_is_the_mean_of_a_vertex_in_the_middle() -> None:
    shape = Shape(identifier="figure", mesh=figure())
    area = shape.laplacian().mass
    means = shape.geodesics() @ area / area.sum()
    (half,) = DistanceProfile(count=1).describe(shape)
    assert means.min() < half < means.max()
    assert abs(area[means < half].sum() / area.sum() - 0.5) < 0.01
    distances = DistanceProfile().distances([np.zeros(50), np.ones(50)])
    np.testing.assert_allclose(distances, [[0, 50], [50, 0]])
