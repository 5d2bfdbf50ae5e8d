import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.manifold import smacof as sklearn_smacof

from baselines._kernels.smacof import smacof
from tests.baselines.embedding import spread

pytestmark = pytest.mark.kernels


def random_problem(seed: int, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    distances = spread(generator.standard_normal((n, 5))) ** 0.8
    return distances, generator.standard_normal((n, 3))


def test_positions_agree_with_scikit_learn_step_by_step(seed=0):
    distances, start = random_problem(seed)
    start -= start.mean(axis=0)
    for iterations in (1, 25):
        expected, raw, _ = sklearn_smacof(
            distances, n_components=3, init=start, n_init=1, max_iter=iterations, eps=0, return_n_iter=True
        )
        scaling = smacof(distances, start, max_iterations=iterations, rtol=0)
        np.testing.assert_allclose(scaling.points, expected, atol=1e-10)
        assert scaling.stress[-1] == pytest.approx(raw / (distances**2).sum() * 2, rel=1e-9)


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.booleans())
def test_the_stress_never_rises_with_or_without_weights(seed, weighted):
    distances, start = random_problem(seed, 30)
    weights = np.random.default_rng(seed).random((30, 30)) ** 3
    course = smacof(
        distances, start, weights=weights + weights.T if weighted else None, max_iterations=30, rtol=0
    ).stress
    assert (np.diff(course) <= 1e-12).all()
    assert course[-1] < course[0]
