"""Rank agreement of two scorers: Kendall's tau-b, which allows for ties, and its chance level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import permutation_test

from benchmark.errors import ConfigurationError

#: Number of random orders if there are too many to try all, which is the case for more than 7 methods.
N_PERMUTATIONS = 9999

#: Scores that differ by less than this are equal: tables print two decimals, records hold all of them.
SAME = 1e-9

FEWEST = 3


@dataclass(frozen=True)
class Agreement:
    """Agreement of two rankings.

    Parameters
    ----------
    tau
        Kendall's tau-b in [-1, 1]; NaN if all scores of one side are equal.
    p_value
        Share of the orders of the second side with tau at least as far from 0; NaN if tau is NaN.
    n
        Number of methods that both sides rank.
    """

    tau: float
    p_value: float
    n: int


def agreement(first: Sequence[float], second: Sequence[float]) -> Agreement:
    """Compare the rankings of the same methods by two lists of scores.

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
    # All orders of the second side have the same number of ties, hence the same normalisation for ties.
    untied = np.sqrt(np.count_nonzero(signs) * np.count_nonzero(y[before] != y[after]))
    tau = np.sign(y[before] - y[after]) @ signs / untied

    def distance(of_second: np.ndarray, axis: int = -1) -> np.ndarray:
        values = np.moveaxis(of_second, axis, -1)
        return np.asarray(np.abs(np.sign(values[..., before] - values[..., after]) @ signs))

    tested = permutation_test(
        (y,),
        distance,
        permutation_type="pairings",
        vectorized=True,
        n_resamples=N_PERMUTATIONS,
        alternative="greater",
        rng=np.random.default_rng(0),
    )
    return Agreement(float(tau), float(tested.pvalue), len(x))
