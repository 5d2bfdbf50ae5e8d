import numpy as np
import pytest

from baselines.fast_mds import FastMDS
from tests.baselines.embedding import PointShape, points_on_ellipsoid, spread


class RowsOnly(PointShape):
    def geodesics(self, solver: str = "default") -> np.ndarray:
        raise AssertionError("all pairs were asked for")


def test_points_in_space_are_recovered_from_few_rows():
    points = points_on_ellipsoid()
    shape = RowsOnly(points)
    form = FastMDS().canonicalise(shape)
    np.testing.assert_allclose(spread(form.vertices), spread(points), atol=1e-9)
    assert len(shape.asked) == len(set(shape.asked)) == form.notes["rows"] <= 18
    assert form.notes["stress_of_rows"] == pytest.approx(0, abs=1e-12)
