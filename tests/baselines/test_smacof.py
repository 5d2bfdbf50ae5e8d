"""Majorisation beside scikit-learn and scipy, over the same distances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import isotonic_regression as scipy_isotonic_regression
from sklearn.manifold import smacof

from baselines.smacof import (
    LeastSquaresMDS,
    NonMetricMDS,
    guttman_transform,
    isotonic_regression,
    majorise,
    non_metric_transform,
    pair_transform,
)
from tests.baselines.embedding import PointShape, brute_force_stress, limbed, points_on_ellipsoid, spread

pytestmark = pytest.mark.kernels


def random_problem(seed: int, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    start = generator.standard_normal((n, 3))
    return spread(generator.standard_normal((n, 5))) ** 0.8, start - start.mean(axis=0)


def test_positions_agree_with_scikit_learn_step_by_step():
    distances, start = random_problem(0)
    for steps in (1, 25):
        expected, raw = smacof(distances, n_components=3, init=start, n_init=1, max_iter=steps, eps=0)
        points, course = majorise(lambda x: guttman_transform(x, distances), start, max_iterations=steps, rtol=0)
        np.testing.assert_allclose(points, expected, atol=1e-10)
        assert course[-1] == pytest.approx(raw, rel=1e-9)
        assert len(course) == steps + 1


def test_the_form_stops_by_the_released_rule_and_notes_its_stress():
    shape = limbed(300)
    form = LeastSquaresMDS().canonicalise(shape)
    assert form.notes["stress"] == pytest.approx(brute_force_stress(form.vertices, shape.geodesics()), rel=1e-5)
    steps = form.notes["iterations"]
    before, after = (
        LeastSquaresMDS(max_iterations=steps - more, rtol=0).canonicalise(shape).notes["stress"] for more in (1, 0)
    )
    assert before - after <= 1e-3 * before
    earlier = LeastSquaresMDS(max_iterations=steps - 2, rtol=0).canonicalise(shape).notes["stress"]
    assert earlier - before > 1e-3 * earlier
    classic = LeastSquaresMDS(start="classic").canonicalise(shape)
    assert classic.notes["stress"] == pytest.approx(form.notes["stress"], rel=0.1)
    assert np.abs(spread(classic.vertices) - spread(form.vertices)).max() > 1e-3


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.integers(1, 1000), st.sampled_from([0.0, 0.1, 1.0, 10.0]))
def test_isotonic_regression_agrees_with_scipy(seed, length, trend):
    values = np.random.default_rng(seed).standard_normal(length).round(1) + trend * np.linspace(0, 1, length)
    np.testing.assert_allclose(isotonic_regression(values), scipy_isotonic_regression(values).x, atol=1e-12)


@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_neither_stress_ever_rises(seed):
    distances, start = random_problem(seed, 30)
    transforms = (lambda x: guttman_transform(x, distances), non_metric_transform(distances)[0])
    for transform in transforms:
        _, course = majorise(transform, start, max_iterations=40, rtol=0)
        assert (np.diff(course) <= 1e-9 * course[0]).all()
        assert course[-1] < course[0]


def test_a_transform_over_pairs_is_that_over_the_matrix():
    distances, start = random_problem(3)
    first, second = (ends.astype(np.int32) for ends in np.triu_indices(len(start), 1))
    pairs = pair_transform(start, first, second, spread(start)[first, second], distances[first, second] / 2, 2.0)
    moved, stress = guttman_transform(start, distances)
    np.testing.assert_allclose(pairs[0], moved, atol=1e-12)
    assert pairs[1] == pytest.approx(stress)


def test_the_non_metric_stress_is_as_low_as_that_of_scikit_learn():
    distances, start = random_problem(4)
    options = {"n_components": 3, "n_init": 1, "max_iter": 300, "eps": 0, "normalized_stress": True}
    _, stress = smacof(distances, metric=False, init=start, **options)
    transform, norm = non_metric_transform(distances)
    _, course = majorise(transform, start, max_iterations=300, rtol=0)
    assert course[-1] ** 0.5 / norm <= 1.001 * stress


@pytest.mark.parametrize("method", [LeastSquaresMDS(), NonMetricMDS()])
def test_points_in_space_stay_where_they_are(method):
    points = points_on_ellipsoid(200)
    np.testing.assert_allclose(spread(method.canonicalise(PointShape(points)).vertices), spread(points), atol=1e-6)
