"""Intervals and tests, beside counting by hand and scipy."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from benchmark.report.statistics import bootstrap_intervals, class_test, exchange_test, holm, query_test

LABELS = ["a"] * 3 + ["b"] * 2 + ["c"] * 4


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


@given(st.lists(st.integers(-3, 3), min_size=2, max_size=9))
def test_exchanges_are_counted_exactly_for_few_units(differences):
    total = abs(sum(differences))
    signs = list(product((1, -1), repeat=len(differences)))
    as_large = sum(abs(sum(s * d for s, d in zip(of, differences, strict=True))) >= total for of in signs)
    assert exchange_test(np.array(differences, dtype=float)[:, None])[0] == pytest.approx(as_large / len(signs))


def test_the_test_over_classes_knows_only_their_sums():
    gains = np.array([0.3, -0.1, 0.1, 0.2, 0.2, 0.0, 0.0, 0.1, 0.3])[:, None]
    assert class_test(gains, LABELS)[0] == pytest.approx(2 / 8)  # all three classes gain: 2 of 8 exchanges are as large
    assert query_test(gains)[0] < class_test(gains, LABELS)[0]


def test_random_exchanges_agree_with_scipy():
    gains = np.random.default_rng(3).normal(0.2, 1, (60, 1)).round(6)
    other = stats.permutation_test((gains[:, 0],), np.mean, permutation_type="samples", random_state=0)
    assert query_test(gains)[0] == pytest.approx(other.pvalue, abs=0.02)


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
