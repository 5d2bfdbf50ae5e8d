import numpy as np
import pytest

from baselines._kernels.sampling import farthest_from_centre, farthest_points
from baselines.fast_mds import FastMDS
from tests.baselines.embedding import (
    PointShape,
    limbed,
    points_on_ellipsoid,
    relabelled,
    spread,
)


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


def test_samples_cover_the_surface_and_follow_the_numbering():
    shape = limbed()
    samples = farthest_points(shape, 12)
    assert len(set(samples)) == 12
    assert samples[0] == farthest_from_centre(shape)
    distances = shape.geodesics("dijkstra")
    for count in range(1, 12):
        nearest = distances[samples[:count]].min(axis=0)
        assert nearest[samples[count]] == pytest.approx(nearest.max(), rel=1e-5)
    other, order = relabelled(shape)
    assert [int(order[sample]) for sample in farthest_points(other, 12)] == samples
