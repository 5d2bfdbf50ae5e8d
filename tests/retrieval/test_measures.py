"""Measures by hand and by their definition, under ties and with missing shapes."""

from itertools import permutations

import numpy as np
import pytest

from benchmark.errors import ConfigurationError
from retrieval.measures import MEASURES, Targets, chance_levels, evaluate, score_draws


def test_the_ideal_matrix_scores_one_and_the_only_member_of_a_class_is_no_query():
    labels = np.repeat(np.arange(4), [1, 3, 5, 40])
    scores = evaluate((labels[:, None] != labels).astype(float), labels)
    at_best = {name: 1.0 for name, measure in MEASURES.items() if measure.depth < 5}
    assert {name: scores.means[name] for name in at_best} == pytest.approx(at_best)
    assert scores.per_query["E"][-1] == pytest.approx(
        64 / 71
    )  # its list has 32 places whatever the class
    assert (scores.tied_queries, scores.lone_queries) == (0, 1)
    assert np.isnan(scores.per_query["NN"][0])


@pytest.mark.parametrize("name", MEASURES)
@pytest.mark.parametrize("n_results", [1, 2, 3, 32, 33])
def test_a_measure_says_something_where_two_rankings_differ_in_it(name, n_results):
    labels, gallery = ["a", "b"], ["a"] + ["b"] * (n_results - 1)
    ranks = np.arange(n_results)
    first, last = (
        evaluate([order, ranks], labels, targets=Targets(gallery)).per_query[name][0]
        for order in (ranks, ranks[::-1])
    )
    assert (first != last) == MEASURES[name].says_something(n_results)


@pytest.mark.parametrize(
    ("distances", "labels", "message"),
    [
        (np.zeros((3, 2)), [0, 0, 0], "shape"),
        (np.array([[2, 3, 0], [3, 9, 0], [0, 0, 1]]), [0, 0, 0], "at a distance of 9 from itself"),
        (np.zeros((0, 0)), [], "two members"),
    ],
)
def test_faults_are_named(distances, labels, message):
    with pytest.raises(ConfigurationError, match=message):
        evaluate(distances, labels)


def test_the_error_of_a_mean_over_draws_is_their_standard_error():
    right, half, wrong = (
        np.abs(np.subtract.outer(of, of)) for of in ([0, 1, 5, 6], [0, 1, 5, 2.9], [0, 5, 0.4, 5.5])
    )
    scored = score_draws([right, half, wrong], ["a", "a", "b", "b"])
    nn = [evaluate(matrix, ["a", "a", "b", "b"]).means["NN"] for matrix in (right, half, wrong)]
    assert nn == [1, 0.75, 0]
    assert scored["draw_errors"]["NN"] == pytest.approx(np.std(nn, ddof=1) / np.sqrt(3))
    assert score_draws([right], ["a", "a", "b", "b"])["draw_errors"] == {}


def by_definition(distances, labels, targets, answered):
    """All measures of each query, means over all orders of what ties, and whether it ties; what has
    no result does.
    """
    found = []
    for query, label in enumerate(labels):
        row = np.full(len(targets.labels), np.inf)
        row[targets.answered] = distances[answered.index(query)] if query in answered else 0
        others = [place for place in range(len(row)) if place != targets.own[query]]
        c, hits, orders = (
            sum(targets.labels[place] == label for place in others) or np.nan,
            set(),
            [],
        )
        for order in permutations(others):
            g = np.array(
                [
                    targets.labels[place] == label
                    for place in sorted(order, key=lambda place: row[place])
                ]
            )
            ranks = np.arange(1, len(g) + 1)
            w, v, first = 1 / np.log2(np.maximum(ranks, 2)), 1 / np.log2(ranks + 1), ranks <= c
            tiers = g[0], g[first].sum() / c, g[: int(np.nan_to_num(2 * c))].sum() / c
            precisions = (
                2 * g.sum() / (len(g) + c),
                v @ g / v[first].sum(),
                g @ (g.cumsum() / ranks) / c,
            )
            orders.append([*tiers, w @ g / w[first].sum(), *precisions])
            hits.add(tuple(g))
        found.append(
            [
                *np.mean(orders, axis=0) * (query in answered) + 0 * c,
                query in answered and len(hits) > 1,
            ]
        )
    return np.array(found)


@pytest.mark.parametrize("seed", range(15))
@pytest.mark.filterwarnings("ignore:invalid value")
def test_queries_of_any_gallery_are_scored_by_the_definition(seed):
    random = np.random.default_rng(seed)
    labels, of_gallery = [*"aabz"], random.permutation([*"aabbc"]).tolist()
    answered = sorted(random.permutation(4)[: random.integers(2, 5)].tolist())
    known = sorted(random.permutation(5)[: random.integers(3, 6)].tolist())
    places, own = random.integers(0, 4, len(known)), np.arange(5)
    targets = Targets(of_gallery, random.integers(-1, 5, 4), known)
    for queries, of, matrix, rows in (
        (
            labels,
            targets,
            random.integers(0, 4, (len(answered), len(known))).astype(float),
            answered,
        ),
        (
            of_gallery,
            Targets(of_gallery, own, known),
            np.abs(places[:, None] - places).astype(float),
            known,
        ),
    ):
        scores = evaluate(matrix, queries, rows, None if queries is of_gallery else of)
        expected = by_definition(matrix, queries, of, rows)
        np.testing.assert_allclose(
            np.transpose([*scores.per_query.values()]), expected[:, :-1], atol=1e-12
        )
        np.testing.assert_allclose([*scores.means.values()], np.nanmean(expected[:, :-1], axis=0))
        assert scores.lone_queries == np.isnan(expected[:, 0]).sum() >= 1
        assert scores.tied_queries == expected[:, -1].sum()
    tied = by_definition(
        np.zeros((4, 5)), labels, Targets(of_gallery, targets.own, range(5)), range(4)
    )
    np.testing.assert_allclose(
        [*chance_levels(labels, targets).values()], np.nanmean(tied[:, :-1], axis=0)
    )


@pytest.mark.parametrize("with_gallery", [False, True])
def test_chance_is_that_of_a_matrix_of_ties_to_the_last_bit(with_gallery):
    random = np.random.default_rng(0)
    for _ in range(20):
        queries, gallery = random.integers(0, 5, 12), random.integers(0, 5, 9)
        targets = Targets(gallery, random.integers(-1, 9, 12)) if with_gallery else None
        ties = np.zeros((12, 9 if with_gallery else 12))
        assert chance_levels(queries, targets) == evaluate(ties, queries, targets=targets).means


def test_chance_of_the_largest_gallery_needs_no_matrix():
    chance = chance_levels(np.arange(50_000) % 100)
    assert chance["NN"] == pytest.approx(499 / 49_999)
