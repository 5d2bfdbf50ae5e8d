"""What Distance Distribution promises."""

from __future__ import annotations

import numpy as np
from distance_distribution import DistanceDistribution

from benchmark.api import Mesh
from benchmark.check import failures


def test_it_keeps_the_contract() -> None:
    assert not failures(DistanceDistribution)


def test_all_distances_of_a_regular_triangle_are_one() -> None:
    signature = DistanceDistribution(bins=3).signature(Mesh(np.eye(3), np.array([[0, 1, 2]])))
    np.testing.assert_allclose(signature["shares"], [0, 1, 0], atol=1e-12)
