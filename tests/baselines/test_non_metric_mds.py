import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import isotonic_regression as scipy_isotonic_regression
from sklearn.isotonic import IsotonicRegression
from sklearn.manifold import smacof as sklearn_smacof

from baselines._kernels.isotonic import isotonic_regression
from baselines.non_metric_mds import non_metric_scaling
from tests.baselines.embedding import spread

pytestmark = pytest.mark.kernels


def random_problem(seed: int, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    return spread(generator.standard_normal((n, 5))), generator.standard_normal((n, 3))


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.integers(1, 1000), st.sampled_from([0.0, 0.1, 1.0, 10.0]))
def test_isotonic_regression_agrees_with_scipy(seed, length, trend):
    values = np.random.default_rng(seed).standard_normal(length) + trend * np.linspace(0, 1, length)
    fitted = isotonic_regression(values, np.arange(1, length + 1))
    np.testing.assert_allclose(fitted, scipy_isotonic_regression(values).x, atol=1e-12)


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(2, 1000), st.integers(1, 200))
def test_ties_agree_with_scikit_learn(seed, length, levels):
    generator = np.random.default_rng(seed)
    ranks = np.sort(generator.integers(0, levels, length))
    values = generator.random(length) + 0.5 * ranks / levels
    ends = np.append(np.flatnonzero(np.diff(ranks)) + 1, length)
    fitted = isotonic_regression(values, ends)
    np.testing.assert_allclose(fitted, IsotonicRegression().fit_transform(ranks, values), atol=1e-12)


@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_the_stress_never_rises(seed):
    dissimilarities, start = random_problem(seed, 30)
    _, course = non_metric_scaling(dissimilarities, start, max_iterations=40, rtol=0)
    assert (np.diff(course) <= 1e-12).all()


def test_the_stress_is_as_low_as_that_of_scikit_learn():
    dissimilarities, start = random_problem(4)
    _, stress = sklearn_smacof(
        dissimilarities, metric=False, n_components=3, init=start, n_init=1, max_iter=300, eps=0, normalized_stress=True
    )
    _, course = non_metric_scaling(dissimilarities, start, max_iterations=300, rtol=0)
    assert course[-1] <= 1.001 * stress
