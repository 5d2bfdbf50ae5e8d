from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from benchmark.errors import ConfigurationError
from retrieval.measures import MEASURES
from retrieval.metrics import Scores, evaluate

NAMES = tuple(measure.name for measure in MEASURES)


def values(scores: Scores) -> NDArray[Any]:
    return np.array([scores.means[name] for name in NAMES])


def one_query(relevance: str, keys: list[float] | None = None) -> tuple[NDArray[Any], NDArray[Any]]:
    """A gallery in which query 0 sees this relevance in its ranking."""
    keys = keys or [float(rank + 1) for rank in range(len(relevance))]
    n = len(relevance) + 1
    distances = 100 + np.abs(np.subtract.outer(np.arange(n), np.arange(n))).astype(float)
    distances[0, 1:] = distances[1:, 0] = keys
    np.fill_diagonal(distances, 0)
    return distances, np.array([1, *map(int, relevance)])


def gallery(seed: int, ties: bool) -> tuple[NDArray[Any], NDArray[Any]]:
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 3, (12, 2)) if ties else rng.normal(size=(12, 2))
    return np.linalg.norm(points[:, None] - points[None], axis=2), rng.integers(0, 3, 12)


def test_golden_row() -> None:
    distances, labels = one_query("01101000")
    row = evaluate(distances, labels).per_query
    assert row["NN"][0] == 0
    assert row["FT"][0] == pytest.approx(2 / 3)
    assert row["ST"][0] == 1
    assert row["E"][0] == pytest.approx(6 / 11)
    # (1 + 1/log2(3) + 1/log2(5)) / (1 + 1 + 1/log2(3)) and (log2(3)^-1 + log2(4)^-1 + log2(6)^-1) over its ideal.
    assert row["DCG"][0] == pytest.approx(0.7836, abs=5e-5)
    assert row["nDCG"][0] == pytest.approx(0.7123, abs=5e-5)
    assert row["mAP"][0] == pytest.approx((1 / 2 + 2 / 3 + 3 / 5) / 3)


def test_ideal_matrix_scores_one() -> None:
    labels = np.repeat(np.arange(4), [2, 3, 5, 40])
    scores = evaluate((labels[:, None] != labels).astype(float), labels)
    ideal = [1, 1, 1, 1, scores.means["E"], 1, 1]
    np.testing.assert_allclose(values(scores), ideal)
    # The E-measure cannot reach 1: its list has 32 places whatever the class.
    assert scores.per_query["E"][0] == pytest.approx(2 / 33)
    assert scores.per_query["E"][-1] == pytest.approx(64 / 71)
    assert scores.tied_queries == 0


def test_a_duplicate_at_distance_zero_is_a_result() -> None:
    # Shapes 0 and 1 coincide but belong to different classes: the wrong one must come first for both.
    distances = np.array([[0, 0, 1], [0, 0, 1], [1, 1, 0]], float)
    scores = evaluate(distances, ["a", "b", "a"])
    assert scores.per_query["NN"][0] == 0
    assert scores.lone_queries == 1
    assert np.isnan(scores.per_query["NN"][1])


def test_index_rule_puts_the_lower_index_first() -> None:
    distances = np.ones((5, 5)) - np.eye(5)
    by_index = evaluate(distances, [0, 0, 1, 1, 1], ties="index").per_query
    np.testing.assert_array_equal(by_index["NN"], [1, 1, 0, 0, 0])
    np.testing.assert_allclose(by_index["FT"], [1, 1, 0, 0, 0])
    np.testing.assert_allclose(by_index["mAP"], [1, 1, (1 / 3 + 2 / 4) / 2, (1 / 3 + 2 / 4) / 2, (1 / 3 + 2 / 4) / 2])


@pytest.mark.parametrize("keys", [[1, 1, 1, 1, 1], [1, 2, 2, 2, 3], [1, 1, 2, 2, 2], [3, 1, 3, 3, 1]])
def test_expected_ties_are_the_mean_over_all_orders(keys: list[float]) -> None:
    relevance = "01101"
    distances, labels = one_query(relevance, keys)
    expected = evaluate(distances, labels).per_query
    orders = []
    for order in permutations(range(5)):
        broken, _ = one_query(relevance, [key + 1e-6 * order[k] for k, key in enumerate(keys)])
        orders.append(evaluate(broken, labels).per_query)
    for name in NAMES:
        mean = np.mean([row[name][0] for row in orders])
        assert expected[name][0] == pytest.approx(mean), name


def test_queries_whose_ties_matter_are_counted() -> None:
    distances, labels = one_query("01101", [1, 1, 2, 3, 3])
    assert evaluate(distances, labels).tied_queries == 1 + sum(
        evaluate(distances, labels, ties="index").per_query["mAP"][1:]
        != evaluate(distances, labels).per_query["mAP"][1:]
    )
    distances, labels = one_query("0110", [1, 2, 2, 3])
    assert (
        evaluate(distances, labels).per_query["mAP"][0] == evaluate(distances, labels, ties="index").per_query["mAP"][0]
    )


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), ties=st.booleans())
def test_names_order_and_any_increasing_function_of_the_distances_change_nothing(seed: int, ties: bool) -> None:
    distances, labels = gallery(seed, ties)
    scores = evaluate(distances, labels)
    order = np.random.default_rng(seed).permutation(len(labels))
    again = evaluate(distances[np.ix_(order, order)], np.array(["wolf", "cat", "dog"])[labels][order])
    np.testing.assert_allclose(values(again), values(scores), atol=1e-12)
    np.testing.assert_allclose(values(evaluate(distances**3, labels)), values(scores), atol=1e-12)
    assert again.tied_queries == scores.tied_queries
    assert again.lone_queries == scores.lone_queries


def test_agrees_with_scikit_learn() -> None:
    from sklearn.metrics import average_precision_score, ndcg_score

    distances, labels = gallery(3, ties=False)
    scores = evaluate(distances, labels)
    for query in range(len(labels)):
        others = np.delete(np.arange(len(labels)), query)
        relevant = labels[others] == labels[query]
        similarity = -distances[query, others]
        assert scores.per_query["mAP"][query] == pytest.approx(average_precision_score(relevant, similarity))
        assert scores.per_query["nDCG"][query] == pytest.approx(ndcg_score([relevant.astype(int)], [similarity]))


@pytest.mark.parametrize(
    ("distances", "labels", "message"),
    [
        (np.zeros((3, 2)), [0, 0, 0], "shape"),
        (np.zeros((3, 3)), [0, 0], "labels"),
        (np.full((2, 2), np.nan), [0, 0], "NaN"),
        (np.array([[0, 1], [2, 0]]), [0, 0], "symmetric"),
        (np.array([[1e9, 1], [2, 0]]), [0, 0], "symmetric"),
        (np.zeros((2, 2)), [0, 1], "two members"),
        (np.zeros((0, 0)), [], "two members"),
    ],
)
def test_faults_are_named(distances: ArrayLike, labels: ArrayLike, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        evaluate(distances, labels)
