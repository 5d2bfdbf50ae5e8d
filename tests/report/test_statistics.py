"""Intervals and tests, beside counting by hand and scipy."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from benchmark.pipeline.records import read_records
from benchmark.report.statistics import ALPHA, bootstrap_intervals, class_sums, tukey_test
from benchmark.report.tables import table_views

ROOT = Path(__file__).parents[2]


def test_intervals_are_those_of_scipy_for_classes_of_one_query():
    values = np.random.default_rng(1).random((40, 1))
    ours = bootstrap_intervals(values, range(40), 0.9)[0]
    other = stats.bootstrap((values[:, 0],), np.mean, confidence_level=0.9, method="percentile", random_state=0)
    assert ours == pytest.approx([other.confidence_interval.low, other.confidence_interval.high], abs=0.01)


def test_queries_of_one_class_count_as_one():
    few = np.repeat(np.random.default_rng(2).random((6, 1)), 50, axis=0)
    labels = np.repeat(np.arange(6), 50).tolist()
    wide, narrow = (np.ptp(bootstrap_intervals(few, names, 0.95)) for names in (labels, range(300)))
    assert wide > 4 * narrow


def test_all_exchanges_of_two_rows_are_counted_as_by_hand():
    gains = np.random.default_rng(3).integers(-3, 9, 8)
    totals = np.abs(np.array(list(product((1, -1), repeat=8))) @ gains)
    values = np.array([gains, np.zeros(8)])[..., None]
    expected = (totals >= abs(gains.sum())).mean()
    assert tukey_test(values, range(8))[0, 1, 0] == pytest.approx(expected, abs=0.01)
    assert tukey_test(np.array([np.ones(8), np.zeros(8)])[..., None], range(8)).min() == pytest.approx(
        2 / 2**8, abs=0.003
    )


def test_three_rows_and_two_measures_are_permuted_together():
    generator = np.random.default_rng(4)
    values = generator.random((3, 8, 2)).round(3)
    draws = np.array([[generator.permutation(3) for _ in range(8)] for _ in range(4000)])
    totals = np.array([[values[order[:, row], np.arange(8)].sum(axis=0) for row in range(3)] for order in draws])
    ranges = np.ptp(totals, axis=1)
    unit = ranges.mean(axis=0)
    largest = (ranges / unit).max(axis=1)
    ours = values.sum(axis=1)
    p_values = tukey_test(values, range(8))
    for a, b, measure in product(range(3), range(3), range(2)):
        reached = (largest >= abs(ours[a] - ours[b])[measure] / unit[measure] - 1e-9).mean()
        assert p_values[a, b, measure] == pytest.approx(reached, abs=0.03)


def test_a_measure_that_stands_there_twice_changes_nothing():
    values = np.random.default_rng(5).random((4, 10, 1)).round(3)
    twice = tukey_test(values.repeat(2, axis=2), range(10))
    assert twice == pytest.approx(tukey_test(values, range(10)).repeat(2, axis=2))


def test_no_p_value_is_below_what_the_permutations_can_show():
    values = np.array([np.ones((20, 1)), np.zeros((20, 1))])
    assert tukey_test(values, range(20))[0, 1, 0] == 1e-4


def test_equal_rows_and_few_classes_have_no_difference():
    assert np.all(tukey_test(np.ones((3, 16, 4)), [*range(8)] * 2) == 1)
    assert np.isnan(tukey_test(np.random.default_rng(0).random((2, 14, 4)), [*range(7)] * 2)).all()


def test_the_queries_of_a_class_count_as_one():
    gains = np.random.default_rng(5).normal(0.1, 1, 10).round(6)
    once = tukey_test(np.array([gains, 0 * gains])[..., None], range(10))
    often = tukey_test(np.array([gains, 0 * gains]).repeat(9, axis=1)[..., None], np.arange(10).repeat(9))
    assert often == pytest.approx(once)


@pytest.fixture(scope="module")
def published_sums():
    """Sums of the measures of each class, of all forms in the published table of 40 people."""
    (view,) = table_views(read_records(ROOT / "results", local=False), ["II-view"])
    forms = [one for row in view.rows if row.kind == "form" for one in row.scored.values()]
    return np.array([class_sums(one.values, one.labels)[0] for one in forms]) / 1e6


@pytest.mark.parametrize("n_classes", [2, 9, 15, 40])
def test_of_tables_with_equal_rows_few_show_a_difference(published_sums, n_classes, monkeypatch):
    monkeypatch.setattr("benchmark.report.statistics.DRAWS", 199)
    sums, generator, found = published_sums[:, :n_classes], np.random.default_rng(6), 0
    for _ in range(300):
        order = generator.random(sums.shape[:2]).argsort(axis=0)[..., None]
        found += bool(np.any(tukey_test(np.take_along_axis(sums, order, axis=0), range(n_classes)) < ALPHA))
    assert found <= 0.07 * 300
