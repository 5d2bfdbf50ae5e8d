"""Rank agreement of two scorers: Kendall's tau-b, which allows for ties, and its chance level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import permutation_test

from benchmark.errors import ConfigurationError

#: Orders that are tried where there are too many to try all; more than 7 methods have more than these.
N_PERMUTATIONS = 9999

#: Scores that differ by less than this are one score: what a table prints has two decimals, records have all of them.
SAME = 1e-9

FEWEST = 3


@dataclass(frozen=True)
class Agreement:
    """Agreement of two rankings.

    Parameters
    ----------
    tau
        Kendall's tau-b in [-1, 1]; NaN where all scores of one side are equal.
    p_value
        Share of the orders of the second side in which tau is at least as far from 0; NaN with tau.
    n
        Methods that both sides rank.
    """

    tau: float
    p_value: float
    n: int


def agreement(first: Sequence[float], second: Sequence[float]) -> Agreement:
    """Compare the orders in which two lists of scores put the same methods.

    Parameters
    ----------
    first, second
        Scores of the same methods, in the same order.

    Raises
    ------
    ConfigurationError
        If there are fewer than three methods, or the lists differ in length.

    References
    ----------
    Kendall, "The treatment of ties in ranking problems", Biometrika 33, 1945.
    """
    if len(first) != len(second) or len(first) < FEWEST:
        raise ConfigurationError(
            f"{len(first)} and {len(second)} scores cannot be ranked against each other",
            f"score at least {FEWEST} methods with both",
        )
    x, y = (np.round(np.asarray(scores, dtype=np.float64) / SAME) for scores in (first, second))
    if (x == x[0]).all() or (y == y[0]).all():
        return Agreement(float("nan"), float("nan"), len(x))

    before, after = np.triu_indices(len(x), 1)
    signs = np.sign(x[before] - x[after])
    # Of all orders of the second side the same pairs are equal, so the root that allows for ties is one for all.
    untied = np.sqrt(np.count_nonzero(signs) * np.count_nonzero(y[before] != y[after]))

    def tau(of_second: np.ndarray, axis: int = -1) -> np.ndarray:
        values = np.moveaxis(of_second, axis, -1)
        return np.asarray(np.sign(values[..., before] - values[..., after]) @ signs / untied)

    tested = permutation_test(
        (y,),
        tau,
        permutation_type="pairings",
        vectorized=True,
        n_resamples=N_PERMUTATIONS,
        alternative="two-sided",
        rng=np.random.default_rng(0),
    )
    return Agreement(float(tau(y)), float(tested.pvalue), len(x))
