"""Scaling from coarse to fine, and the quasi-Newton steps of both: lower than plain majorisation, and as steady."""

import numpy as np
import pytest

from baselines._kernels import coarse_start as coarse
from baselines._kernels.smacof import smacof
from baselines.least_squares_mds import LeastSquaresMDS
from baselines.non_metric_mds import NonMetricMDS, non_metric_scaling
from tests.baselines.embedding import PointShape, limbed, points_on_ellipsoid, spread

pytestmark = pytest.mark.kernels


@pytest.fixture
def few_samples(monkeypatch):
    """As many samples as suit the small shapes of these tests."""
    monkeypatch.setattr(coarse, "SAMPLES", 64)


@pytest.mark.parametrize("start", ["mesh", "classic"])
def test_least_squares_comes_to_rest_no_higher_than_majorisation(few_samples, start):
    shape = limbed()
    form = LeastSquaresMDS(start=start).canonicalise(shape)
    plain = smacof(shape.geodesics(), shape.mesh.vertices)
    assert form.notes["stress"] <= plain.stress[-1]
    assert form.notes["iterations"] < plain.iterations / 2


def test_non_metric_scaling_comes_to_rest_no_higher_than_without_samples(few_samples):
    shape = limbed()
    start = LeastSquaresMDS(start="classic", max_iterations=1).canonicalise(shape).vertices
    _, course = non_metric_scaling(shape.geodesics(), start)
    assert NonMetricMDS().canonicalise(shape).notes["stress_1"] <= 1.01 * course[-1]


@pytest.mark.parametrize("method", [LeastSquaresMDS(), NonMetricMDS()])
@pytest.mark.parametrize("count", [200, 300])
def test_points_in_space_stay_where_they_are(few_samples, method, count):
    points = points_on_ellipsoid(count)
    np.testing.assert_allclose(spread(method.canonicalise(PointShape(points)).vertices), spread(points), atol=1e-6)
