"""Measures by hand, beside scikit-learn, under ties and with missing shapes."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.metrics import average_precision_score, ndcg_score

from benchmark.errors import ConfigurationError
from retrieval.measures import MEASURES, Targets, chance_levels, evaluate


def one_query(relevance, keys=None):
    """A gallery in which query 0 sees this relevance in its ranking."""
    n = len(relevance) + 1
    distances = 100 + np.abs(np.subtract.outer(np.arange(n), np.arange(n))).astype(float)
    distances[0, 1:] = distances[1:, 0] = keys or np.arange(1, n)
    np.fill_diagonal(distances, 0)
    return distances, [1, *map(int, relevance)]


def gallery(seed, ties=False, size=12):
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 3, (size, 2)) if ties else rng.normal(size=(size, 2))
    labels = rng.integers(0, 3, size)
    labels[1] = labels[0]
    return np.linalg.norm(points[:, None] - points, axis=2), labels


def values(scores):
    return np.array([*scores.means.values()])


def test_a_row_by_hand():
    distances, labels = one_query("01101000")
    row = {name: found[0] for name, found in evaluate(distances, labels).per_query.items()}
    # (1 + 1/log2(3) + 1/log2(5)) / (1 + 1 + 1/log2(3)) and (log2(3)^-1 + log2(4)^-1 + log2(6)^-1) over its ideal.
    expected = {"NN": 0, "FT": 2 / 3, "ST": 1, "DCG": 0.7836, "E": 6 / 11, "nDCG": 0.7123}
    expected["mAP"] = (1 / 2 + 2 / 3 + 3 / 5) / 3
    assert row == pytest.approx(expected, abs=5e-5)


def test_the_ideal_matrix_scores_one_and_the_only_member_of_a_class_is_no_query():
    labels = np.repeat(np.arange(4), [1, 3, 5, 40])
    scores = evaluate((labels[:, None] != labels).astype(float), labels)
    assert {name: value for name, value in scores.means.items() if name != "E"} == pytest.approx(
        dict.fromkeys(["NN", "FT", "ST", "DCG", "nDCG", "mAP"], 1.0)
    )
    assert scores.per_query["E"][-1] == pytest.approx(64 / 71)  # its list has 32 places whatever the class
    assert (scores.tied_queries, scores.lone_queries) == (0, 1)
    assert np.isnan(scores.per_query["NN"][0])


def test_a_duplicate_at_distance_zero_is_a_result():
    # Shapes 0 and 1 coincide but belong to different classes: the wrong one must come first.
    distances = np.array([[0, 0, 1], [0, 0, 1], [1, 1, 0]], float)
    assert evaluate(distances, ["a", "b", "a"]).per_query["NN"][0] == 0


@pytest.mark.parametrize("keys", [[1, 1, 1, 1, 1], [1, 2, 2, 2, 3], [1, 1, 2, 2, 2], [3, 1, 3, 3, 1]])
def test_ties_are_the_mean_over_all_orders_and_counted_at_any_rank(keys):
    distances, labels = one_query("01101", keys)
    orders = []
    for order in permutations(range(5)):
        broken, _ = one_query("01101", [key + 1e-6 * order[k] for k, key in enumerate(keys)])
        orders.append(evaluate(broken, labels))
    scores = evaluate(distances, labels)
    for name in MEASURES:
        assert scores.per_query[name][0] == pytest.approx(np.mean([one.per_query[name][0] for one in orders])), name
    assert scores.tied_queries == orders[0].tied_queries + 1


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), ties=st.booleans())
def test_names_order_and_any_increasing_function_of_the_distances_change_nothing(seed, ties):
    distances, labels = gallery(seed, ties)
    scores = evaluate(distances, labels)
    order = np.random.default_rng(seed).permutation(len(labels))
    again = evaluate(distances[np.ix_(order, order)], np.array(["wolf", "cat", "dog"])[labels][order])
    np.testing.assert_allclose(values(again), values(scores), atol=1e-12)
    np.testing.assert_allclose(values(evaluate(distances**3, labels)), values(scores), atol=1e-12)
    assert (again.tied_queries, again.lone_queries) == (scores.tied_queries, scores.lone_queries)


def test_agrees_with_scikit_learn():
    distances, labels = gallery(3)
    scores = evaluate(distances, labels)
    for query in range(len(labels)):
        relevant, similarity = np.delete(labels == labels[query], query), -np.delete(distances[query], query)
        assert scores.per_query["mAP"][query] == pytest.approx(average_precision_score(relevant, similarity))
        assert scores.per_query["nDCG"][query] == pytest.approx(ndcg_score([relevant.astype(int)], [similarity]))


def test_chance_is_the_share_of_relevant_results_and_random_matrices_reach_it():
    labels = np.repeat([0, 1, 2, 3], [1, 3, 5, 8])
    levels, rng = chance_levels(labels), np.random.default_rng(0)
    assert levels["NN"] == pytest.approx((3 * 2 + 5 * 4 + 8 * 7) / 16 / 16)
    noise = rng.random((1000, 17, 17))
    simulated = np.mean([values(evaluate(one + one.T, labels)) for one in noise], axis=0)
    np.testing.assert_allclose(simulated, list(levels.values()), atol=0.01)


def test_missing_shapes_score_nothing_and_stand_behind_all_others():
    # a a a b b, of which the last a has no result: c = 2 for a, 1 for b.
    distances = np.array([[0, 1, 3, 4], [1, 0, 5, 6], [3, 5, 0, 2], [4, 6, 2, 0]], dtype=float)
    scores = evaluate(distances, ["a", "a", "a", "b", "b"], answered=[0, 1, 3, 4])
    np.testing.assert_allclose(scores.per_query["NN"], [1, 1, 0, 1, 1])
    np.testing.assert_allclose(scores.per_query["FT"], [0.5, 0.5, 0, 1, 1])
    np.testing.assert_allclose(scores.per_query["ST"], [1, 1, 0, 1, 1])  # behind all others is rank 4 of 4
    gain = (1 + 1 / np.log2(4)) / (1 + 1 / np.log2(2))  # hits at ranks 1 and 4
    np.testing.assert_allclose(scores.per_query["DCG"], [gain, gain, 0, 1, 1])
    # Of two shapes without a result one is relevant: half of it lies at each of the last two ranks.
    scores = evaluate(np.array([[0.0, 1.0], [1.0, 0.0]]), ["a", "b", "a", "b"], answered=[0, 1])
    assert scores.per_query["mAP"][0] == pytest.approx((1 / 2 + 1 / 3) / 2)


@settings(max_examples=100)
@given(seed=st.integers(0, 10_000), ties=st.booleans())
def test_refusing_never_beats_the_same_shapes_answered_and_far_away(seed, ties):
    distances, labels = gallery(seed, ties)
    answered = np.flatnonzero(np.random.default_rng(seed).random(len(labels)) < 0.7)
    absent = np.setdiff1d(np.arange(len(labels)), answered)
    far = distances.copy()
    far[absent] = far[:, absent] = 3.0 * distances.max()
    missing = evaluate(distances[np.ix_(answered, answered)], labels, answered=answered)
    assert (values(missing) <= values(evaluate(far, labels)) + 1e-12).all()


@pytest.mark.parametrize(
    ("distances", "labels", "message"),
    [
        (np.zeros((3, 2)), [0, 0, 0], "shape"),
        (np.zeros((3, 3)), [0, 0], "2 shapes"),
        (np.full((2, 2), np.nan), [0, 0], "NaN"),
        (np.array([[1e9, 1], [2, 0]]), [0, 0], "symmetric"),
        (np.zeros((2, 2)), [0, 1], "two members"),
        (np.zeros((0, 0)), [], "two members"),
    ],
)
def test_faults_are_named(distances, labels, message):
    with pytest.raises(ConfigurationError, match=message):
        evaluate(distances, labels)


def by_definition(distances, labels, targets, answered):
    """NN, FT, ST and DCG of each query, the mean over all orders of what ties; what has no result ties at the end."""
    found = []
    for query, label in enumerate(labels):
        row = np.full(len(targets.labels), np.inf)
        row[targets.answered] = distances[answered.index(query)] if query in answered else 0
        others = [place for place in range(len(row)) if place != targets.own[query]]
        c, orders = sum(targets.labels[place] == label for place in others) or np.nan, []
        for order in permutations(others):
            g = np.array([targets.labels[place] == label for place in sorted(order, key=lambda place: row[place])])
            w, first = 1 / np.log2(np.maximum(np.arange(1, len(g) + 1), 2)), np.arange(1, len(g) + 1) <= c
            orders.append([g[0], g[first].sum() / c, g[: int(np.nan_to_num(2 * c))].sum() / c, w @ g / w[first].sum()])
        found.append(np.mean(orders, axis=0) * (query in answered) + 0 * c)
    return np.array(found)


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.filterwarnings("ignore:invalid value")
def test_queries_of_another_gallery_are_scored_by_the_definition(seed):
    random, names = np.random.default_rng(seed), [*MEASURES][:4]
    labels, of_gallery = [*"aabz"], random.permutation([*"aabbc"]).tolist()
    answered = sorted(random.permutation(4)[: random.integers(2, 5)].tolist())
    known = sorted(random.permutation(5)[: random.integers(2, 6)].tolist())
    targets = Targets(of_gallery, random.integers(-1, 5, 4), known)
    distances = random.integers(0, 4, (len(answered), len(known))).astype(float)
    scores = evaluate(distances, labels, answered, targets)
    expected = by_definition(distances, labels, targets, answered)
    np.testing.assert_allclose(np.transpose([scores.per_query[name] for name in names]), expected, atol=1e-12)
    assert scores.lone_queries == np.isnan(expected[:, 0]).sum() >= 1
    tied = by_definition(np.zeros((4, 5)), labels, Targets(of_gallery, targets.own, range(5)), range(4))
    levels = chance_levels(labels, targets)
    np.testing.assert_allclose([levels[name] for name in names], np.nanmean(tied, axis=0))
