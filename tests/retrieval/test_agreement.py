"""Kendall's tau between the orders of two scorers."""

import math

import numpy as np
import pytest
from scipy.stats import kendalltau

from benchmark.errors import ConfigurationError
from retrieval.agreement import agreement


def test_tau_by_hand_with_ties_and_p_values_over_all_orders():
    same = agreement([1, 2, 3, 4], [10, 20, 30, 40])
    assert (same.tau, same.n) == (1, 4)
    assert same.p_value == pytest.approx(2 / 24)  # of all 24 orders, the same one and the reverse
    assert agreement([1, 2, 3], [3, 2, 1]).tau == -1
    # Pairs: 4 concordant, 1 discordant, one tied in the second: tau-b = (4 - 1) / sqrt(6 * 5).
    assert agreement([1, 2, 3, 4], [1, 3, 2, 3]).tau == pytest.approx(3 / math.sqrt(30))


def test_scores_that_differ_by_rounding_alone_tie():
    assert agreement([1, 2, 3], [0.5, 0.5 + 1e-12, 0.6]).tau == pytest.approx(2 / math.sqrt(6))


def test_many_methods_are_compared_with_drawn_orders_the_same_ones_each_time():
    first, second = list(range(12)), [3, 1, 0, 2, 5, 4, 7, 6, 9, 8, 11, 10]
    result = agreement(first, second)
    assert result == agreement(first, second)
    assert result.p_value < 0.01 < agreement(first, [5, 9, 0, 11, 3, 7, 2, 8, 10, 1, 6, 4]).p_value


@pytest.mark.parametrize("n", [3, 8, 28])
def test_tau_is_that_of_scipy(n):
    random = np.random.default_rng(n)
    first = random.permutation(n) // 2
    second = first + random.integers(0, 4, n)
    assert agreement(first, second).tau == pytest.approx(kendalltau(first, second).statistic)


def test_where_nothing_is_ranked_there_is_no_tau():
    assert math.isnan(agreement([1, 1, 1], [1, 2, 3]).tau)
    with pytest.raises(ConfigurationError, match="at least 3 methods"):
        agreement([1, 2], [1, 2])
