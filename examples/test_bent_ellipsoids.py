"""What Bent Ellipsoids promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from bent_ellipsoids import BENDS, WIDTHS, bent_ellipsoid, write

from benchmark.datasets.checking import check_source


def test_it_can_be_ranked(tmp_path: Path) -> None:
    write(tmp_path)
    report = check_source(str(tmp_path), None)
    assert report.usable
    assert len(report.shapes) == len(WIDTHS) * len(BENDS)


def test_bending_keeps_the_area_of_a_round_one() -> None:
    areas = [bent_ellipsoid(WIDTHS["round"], bend).area for bend in BENDS]
    np.testing.assert_allclose(areas, areas[0], rtol=0.02)
