"""Shapes without a result: queries that find nothing, and targets behind all others."""

import numpy as np
import pytest

from retrieval.measures import MEASURES
from retrieval.metrics import evaluate


def gallery(seed, most=14):
    """Distances, with ties now and then, classes, and the shapes that have a result."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(4, most))
    labels = rng.integers(0, max(2, size // 3), size)
    labels[1] = labels[0]
    noise = rng.integers(1, 6, (size, size)) if seed % 3 == 0 else rng.random((size, size))
    answered = np.flatnonzero(rng.random(size) < rng.uniform(0.2, 1.0))
    return noise + noise.T, labels, answered if len(answered) else np.array([0])


def values(scores):
    return np.array([scores.means[measure.name] for measure in MEASURES])


def whole(seed):
    """Measures with shapes missing, and with them answered, at one distance from all others, farther than any pair."""
    distances, labels, answered = gallery(seed)
    missing = evaluate(distances[np.ix_(answered, answered)], labels, answered=answered)
    absent = np.setdiff1d(np.arange(len(labels)), answered)
    far = distances.astype(float)
    far[absent] = far[:, absent] = 3.0 * distances.max()
    far[np.ix_(absent, absent)] += distances[np.ix_(absent, absent)]
    return missing, evaluate(far, labels)


@pytest.mark.parametrize("seeds", [range(300), pytest.param(range(300, 10_300), marks=pytest.mark.exhaustive)])
def test_refusing_never_beats_the_same_shapes_answered_and_far_away(seeds):
    for seed in seeds:
        missing, far = whole(seed)
        assert (values(missing) <= values(far) + 1e-12).all(), seed


def test_golden_gallery():
    # a a a b b, of which the last a has no result: c = 2 for a, 1 for b.
    distances = np.array([[0, 1, 3, 4], [1, 0, 5, 6], [3, 5, 0, 2], [4, 6, 2, 0]], dtype=float)
    scores = evaluate(distances, ["a", "a", "a", "b", "b"], answered=[0, 1, 3, 4])
    np.testing.assert_allclose(scores.per_query["NN"], [1, 1, 0, 1, 1])
    np.testing.assert_allclose(scores.per_query["FT"], [0.5, 0.5, 0, 1, 1])
    np.testing.assert_allclose(scores.per_query["ST"], [1, 1, 0, 1, 1])  # behind all others is rank 4 of 4
    assert scores.means["NN"] == pytest.approx(0.8)
    gain = (1 + 1 / np.log2(4)) / (1 + 1 / np.log2(2))  # hits at ranks 1 and 4
    np.testing.assert_allclose(scores.per_query["DCG"], [gain, gain, 0, 1, 1])


def test_several_missing_targets_share_the_last_ranks():
    # Of the two shapes without a result one is relevant: half of it lies at each of the last two ranks.
    scores = evaluate(np.array([[0.0, 1.0], [1.0, 0.0]]), ["a", "b", "a", "b"], answered=[0, 1])
    assert scores.per_query["FT"][0] == 0
    assert scores.per_query["ST"][0] == pytest.approx(0.5)
    assert scores.per_query["mAP"][0] == pytest.approx((1 / 2 + 1 / 3) / 2)


def test_all_answered_is_no_difference():
    distances, labels, _ = gallery(7)
    every = np.arange(len(labels))
    np.testing.assert_array_equal(
        values(evaluate(distances, labels, answered=every)), values(evaluate(distances, labels))
    )
