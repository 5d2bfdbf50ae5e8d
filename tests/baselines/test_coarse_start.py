"""Scaling from coarse to fine, and the quasi-Newton steps of both: lower than plain majorisation, and as steady."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baselines._kernels import coarse_start as coarse
from baselines._kernels.quasi_newton import minimise
from baselines._kernels.smacof import StressProblem, attractions, smacof
from baselines.least_squares_mds import LeastSquaresMDS, least_squares_scaling
from baselines.non_metric_mds import NonMetricMDS, non_metric_scaling
from tests.baselines.embedding import PointShape, limbed, points_on_ellipsoid, spread

pytestmark = pytest.mark.kernels


@pytest.fixture
def few_samples(monkeypatch):
    """As many samples as suit the small shapes of these tests."""
    monkeypatch.setattr(coarse, "SAMPLES", 64)


def evaluation(distances):
    problem = StressProblem(distances, None)

    def evaluate(points):
        sums = attractions(points, distances)
        return problem.stress(points, sums), problem.solve(sums)

    return evaluate


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.integers(1, 40))
def test_quasi_newton_steps_never_raise_the_stress(seed, iterations):
    generator = np.random.default_rng(seed)
    distances, start = spread(generator.standard_normal((30, 5))) ** 0.8, generator.standard_normal((3, 30))
    points, course = minimise(evaluation(distances), start, max_iterations=iterations, rtol=0)
    assert (np.diff(course) <= 0).all()
    assert len(course) <= iterations + 1
    assert evaluation(distances)(points)[0] == course[-1]


def test_a_grain_ends_rounding_errors():
    generator = np.random.default_rng(0)
    distances, start = spread(generator.standard_normal((60, 5))), generator.standard_normal((3, 60))
    other = start + 1e-15 * generator.uniform(-1, 1, start.shape)
    moves = []
    for grain in (None, 2.0**-26):
        one, two = (
            minimise(evaluation(distances), each, max_iterations=150, rtol=0, grain=grain)[0] for each in (start, other)
        )
        moves.append(np.abs(one - two).max())
    assert moves[1] == 0 < moves[0]


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


def test_samples_come_near_to_the_scaling_of_all(few_samples):
    shape = limbed()
    distances, vertices = shape.geodesics(), shape.mesh.vertices

    def scale(distances, start, grain):
        return least_squares_scaling(distances, start, start, rtol=1e-4).points, lambda found: found

    start = coarse.coarse_start(distances, vertices, vertices, scale)
    problem = evaluation(distances)
    lowest = problem(np.ascontiguousarray(least_squares_scaling(distances, vertices, vertices).points.T))[0]
    assert problem(start.T.copy())[0] < 1.2 * lowest < 0.5 * problem(vertices.T.copy())[0]


@pytest.mark.parametrize("method", [LeastSquaresMDS(), NonMetricMDS()])
def test_points_in_space_stay_where_they_are(few_samples, method):
    points = points_on_ellipsoid(300)
    np.testing.assert_allclose(spread(method.canonicalise(PointShape(points)).vertices), spread(points), atol=1e-6)
