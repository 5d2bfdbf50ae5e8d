"""What Distance Distribution promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmark.api import Mesh
from benchmark.plugins.conformance import check_target
from benchmark.plugins.scorers import plugin_scorers

PLUGIN = Path(__file__).with_name("distance_distribution.py")


def test_it_keeps_the_contract() -> None:
    report = check_target(str(PLUGIN))
    assert report, f"\n{report}"


def test_all_distances_of_a_regular_triangle_are_one() -> None:
    (spec,) = plugin_scorers(PLUGIN)
    signature = spec.load()(bins=3).signature(Mesh(np.eye(3), np.array([[0, 1, 2]])))
    np.testing.assert_allclose(signature["shares"], [0, 1, 0], atol=1e-12)
