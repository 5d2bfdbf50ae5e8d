"""Intervals and tests, beside counting by hand and scipy."""

from itertools import combinations, product
from pathlib import Path

import numpy as np
import pytest
from scipy import special, stats

from benchmark.pipeline.record_files import read_records
from benchmark.report.statistics import (
    ALPHA,
    class_intervals,
    class_sums,
    permutation_test,
    sign_flip_test,
)
from benchmark.report.tables import table_views

ROOT = Path(__file__).parents[2]


def test_intervals_are_those_of_a_t_test_of_class_means_or_logits():
    values = np.random.default_rng(1).random((12, 1)).round(6)
    low, high = stats.ttest_1samp(values[:, 0], 0).confidence_interval(0.95)
    assert class_intervals(values, range(12), are_gains=True)[0] == pytest.approx([low, high])
    mean, half = values.mean(), (high - low) / 2
    ends = special.logit(mean) + np.array([-1, 1]) * half / (mean * (1 - mean))
    assert class_intervals(values, range(12))[0] == pytest.approx(special.expit(ends))
    assert class_intervals(np.ones((9, 1)), "aabcdefgh").tolist() == [[1, 1]]
    assert np.isnan(class_intervals([[0.5], [0.7]], "aa", fewest=1)).all()


def test_below_eight_classes_there_is_no_interval():
    values = np.random.default_rng(1).random((24, 2))
    for are_gains in (False, True):
        seven = class_intervals(values, [k % 7 for k in range(24)], are_gains=are_gains)
        eight = class_intervals(values, [k % 8 for k in range(24)], are_gains=are_gains)
        assert seven.shape == (2, 2)
        assert np.isnan(seven).all()
        assert np.isfinite(eight).all()


@pytest.mark.parametrize("n_classes", [9, 10, 15, 40])
def test_intervals_cover_what_the_legend_says(n_classes):
    """Unequal classes, with means that are symmetric, skewed high and skewed low."""
    for least, a, b in ((0.93, 4, 2), (0.91, 5, 0.7), (0.91, 0.5, 4)):
        generator, covered = np.random.default_rng(7), 0
        sizes, means = generator.choice([3, 6, 9, 20], 200_000), generator.beta(a, b, 200_000)
        true = sizes @ means / sizes.sum()
        for of in generator.integers(len(sizes), size=(1000, n_classes)):
            labels = np.repeat(np.arange(n_classes), sizes[of]).tolist()
            low, high = class_intervals(means[of][labels, None], labels)[0]
            covered += low <= true <= high
        assert least * 1000 - 10 <= covered <= 970, (a, b)


def test_queries_of_one_class_count_as_one():
    few = np.repeat(np.random.default_rng(2).random((8, 1)), 50, axis=0)
    labels = np.repeat(np.arange(8), 50).tolist()
    wide, narrow = (np.ptp(class_intervals(few, names)) for names in (labels, range(400)))
    assert wide > 4 * narrow


def test_all_exchanges_of_two_rows_are_counted_as_by_hand():
    gains = np.random.default_rng(3).integers(-3, 9, 8)
    totals = np.abs(np.array(list(product((1, -1), repeat=8))) @ gains)
    values = np.array([gains, np.zeros(8)])[..., None]
    expected = (totals >= abs(gains.sum())).mean()
    assert permutation_test(values, range(8))[0, 1, 0] == pytest.approx(expected, abs=0.01)
    assert permutation_test(
        np.array([np.ones(8), np.zeros(8)])[..., None], range(8)
    ).min() == pytest.approx(2 / 2**8, abs=0.003)


def test_each_p_value_is_the_one_of_scipy_for_the_largest_statistic():
    generator = np.random.default_rng(4)
    values = generator.random((4, 8, 2)).round(3)
    pairs = [*combinations(range(4), 2)]
    differences = np.array([values[a] - values[b] for a, b in pairs])  # (pairs, classes, measures)
    p_values = permutation_test(values, range(8))

    def studentised(rows):
        return np.abs(rows.sum(axis=1)) / np.sqrt((rows**2).sum(axis=1))

    def largest(signs, axis):
        rows = np.moveaxis(signs, axis, -1)
        flat = rows.reshape(-1, 8)
        maxima = [studentised(differences * of[None, :, None]).max() for of in flat]
        return np.reshape(maxima, rows.shape[:-1])

    found = stats.permutation_test(
        (np.ones(8),), largest, permutation_type="samples", n_resamples=np.inf, vectorized=True
    )
    assert len(found.null_distribution) == 2**8
    for number, (a, b) in enumerate(pairs):
        observed = studentised(differences)[number]
        expected = (found.null_distribution[:, None] >= observed - 1e-9).mean(axis=0)
        assert p_values[a, b] == pytest.approx(expected)
        assert p_values[b, a] == pytest.approx(expected)


def test_a_pair_alone_has_the_p_value_of_scipy():
    gains = np.random.default_rng(8).normal(0.3, 1, 10).round(6)

    def statistic(d, axis):
        return np.abs(d.sum(axis=axis)) / np.sqrt((d**2).sum(axis=axis))

    found = stats.permutation_test(
        (gains,), statistic, permutation_type="samples", n_resamples=np.inf, alternative="greater"
    )
    assert sign_flip_test(gains[:, None], range(10))[0] == pytest.approx(found.pvalue)


@pytest.mark.parametrize("n_classes", [9, 20])
def test_the_order_of_rows_moves_no_p_value_and_another_row_lowers_none(n_classes):
    generator = np.random.default_rng(9)
    values = generator.random((7, 2 * n_classes, 4)).round(6)
    values[0] += 0.3
    labels = [*range(n_classes)] * 2
    p_values = permutation_test(values, labels)
    for _ in range(5):
        order = generator.permutation(7)
        assert (permutation_test(values[order], labels) == p_values[np.ix_(order, order)]).all()
        fewer = np.sort(order[:4])
        of_fewer = permutation_test(values[fewer], labels)
        assert (of_fewer <= p_values[np.ix_(fewer, fewer)]).all()
    alone = sign_flip_test(values[0] - values[1], labels)
    assert (permutation_test(values[:2], labels)[0, 1] == alone).all()
    assert (alone <= p_values[0, 1]).all()
    twice = permutation_test(np.concatenate([values, values[:1]]), labels)
    assert (twice[:7, :7] == p_values).all()  # a copy of a row has no statistics of its own


def test_a_measure_that_stands_there_twice_changes_nothing():
    values = np.random.default_rng(5).random((4, 10, 1)).round(3)
    twice = permutation_test(values.repeat(2, axis=2), range(10))
    assert twice == pytest.approx(permutation_test(values, range(10)).repeat(2, axis=2))


def test_no_p_value_is_below_what_the_permutations_can_show():
    values = np.array([np.ones((20, 1)), np.zeros((20, 1))])
    assert permutation_test(values, range(20))[0, 1, 0] == 1e-4


def test_equal_rows_and_few_classes_have_no_difference():
    assert np.all(permutation_test(np.ones((3, 16, 4)), [*range(8)] * 2) == 1)
    assert np.isnan(
        permutation_test(np.random.default_rng(0).random((2, 14, 4)), [*range(7)] * 2)
    ).all()


def test_the_queries_of_a_class_count_as_one():
    gains = np.random.default_rng(5).normal(0.1, 1, 10).round(6)
    once = permutation_test(np.array([gains, 0 * gains])[..., None], range(10))
    often = permutation_test(
        np.array([gains, 0 * gains]).repeat(9, axis=1)[..., None], np.arange(10).repeat(9)
    )
    assert often == pytest.approx(once)


@pytest.fixture(scope="module")
def published_sums():
    """Sums over the queries of each class of all forms, shape (classes, rows, measures), in
    published tables.
    """
    found = {}
    for view in table_views(read_records(ROOT / "results", local=False), ["I", "II", "III"]):
        title = "5 subjects" if "5 subjects" in view.groups else view.columns[0].title
        forms = [
            row.scored[title] for row in view.rows if row.kind == "form" and title in row.scored
        ]
        sums, sizes = zip(*(class_sums(one.values, one.labels) for one in forms), strict=True)
        found[view.table.identifier], found[f"{view.table.identifier} sizes"] = (
            np.stack(sums, axis=1) / 1e6,
            sizes[0],
        )
    return found


def rejects(sums, pairs=...):
    """Whether any difference of these pairs is certain."""
    return bool(np.any(permutation_test(np.moveaxis(sums, 1, 0), range(len(sums)))[pairs] < ALPHA))


@pytest.mark.parametrize(
    ("table", "n_classes"), [("II-view", 9), ("II-view", 15), ("II-view", 40), ("II", 40)]
)
def test_of_tables_with_equal_rows_few_show_a_difference(
    published_sums, table, n_classes, monkeypatch
):
    monkeypatch.setattr("benchmark.report.statistics.DRAWS", 599)  # all for 9 classes
    sums, generator, found = published_sums[table][:n_classes], np.random.default_rng(6), 0
    for _ in range(400):
        order = generator.random(sums.shape[:2]).argsort(axis=1)[..., None]
        found += rejects(np.take_along_axis(sums, order, axis=1))
    assert 0.01 * 400 <= found <= 0.07 * 400


@pytest.mark.slow
@pytest.mark.parametrize(
    ("table", "n_classes"), [("I", 15), ("II", 9), ("II", 15), ("II", 40), ("III-view", 9)]
)
def test_an_equal_pair_among_rows_as_published_is_seldom_certain(
    published_sums, table, n_classes, monkeypatch
):
    """The worst pair: the rank of pairs is found in few draws."""
    monkeypatch.setattr("benchmark.report.statistics.DRAWS", 599)  # all for 9 classes
    sums, generator = published_sums[table][:n_classes], np.random.default_rng(6)

    def level(pair, n_draws):
        found = 0
        for _ in range(n_draws):
            equal, flipped = sums.copy(), generator.random(n_classes) < 0.5
            equal[np.ix_(flipped, pair)] = sums[np.ix_(flipped, pair[::-1])]
            found += rejects(equal, pair)
        return found / n_draws

    pairs = sorted(combinations(range(sums.shape[1]), 2), key=lambda pair: level(pair, 20))
    assert max(level(pair, 400) for pair in pairs[-3:]) <= 0.07


@pytest.mark.slow
def test_nine_classes_find_a_difference_of_two_tenths_in_a_quarter_of_cases(published_sums):
    generator, found = np.random.default_rng(6), []
    for _ in range(400):
        pair = generator.permutation(published_sums["III"].shape[1])[:2]
        sums, flipped = published_sums["III"].copy(), generator.random(9) < 0.5
        sums[np.ix_(flipped, pair)] = published_sums["III"][np.ix_(flipped, pair[::-1])]
        sums[:, pair[0]] += 0.2 * published_sums["III sizes"][:, None]
        found.append(permutation_test(np.moveaxis(sums, 1, 0), range(9))[tuple(pair)] < ALPHA)
    assert np.mean(found) == pytest.approx(1 / 4, abs=0.04)
    assert np.mean(found, axis=0)[0] == pytest.approx(1 / 10, abs=0.04)
