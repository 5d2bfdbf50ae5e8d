"""What Bent Ellipsoids promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmark.datasets.own import data_sets_of, open_own
from benchmark.plugins.conformance import check_target

PLUGIN = Path(__file__).with_name("bent_ellipsoids.py")


def test_it_keeps_the_contract() -> None:
    report = check_target(str(PLUGIN))
    assert report, f"\n{report}"


def test_bending_keeps_the_area_of_a_round_one() -> None:
    dataset = open_own(data_sets_of([PLUGIN])["bent-ellipsoids"])
    areas = [dataset.load(entry).area for entry in dataset.entries if entry.subject == "round"]
    np.testing.assert_allclose(areas, areas[0], rtol=0.02)
