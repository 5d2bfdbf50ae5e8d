"""What Bent Ellipsoids promises."""

from __future__ import annotations

import numpy as np
from bent_ellipsoids import BENT_ELLIPSOIDS

from benchmark.check import failures


def test_it_keeps_the_contract() -> None:
    assert not failures(BENT_ELLIPSOIDS)


def test_bending_keeps_the_area_of_a_round_one() -> None:
    shapes = [entry for entry in BENT_ELLIPSOIDS.shapes if entry.subject == "round"]
    areas = [BENT_ELLIPSOIDS.load(entry).area for entry in shapes]
    np.testing.assert_allclose(areas, areas[0], rtol=0.02)
