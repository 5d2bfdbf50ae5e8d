"""Size of an experiment that would tell two methods apart, by drawing anew from what there is.

Classes are drawn with all their queries, as intervals draw them, and two methods count as told apart where a test that
exchanges them class by class says so at 5 %. Runs and trainings with several seeds are drawn seed by seed, alike.
What there is stands for all that there could be: from few classes or seeds the answer is rough.

References
----------
Efron & Tibshirani, "An Introduction to the Bootstrap", 1993, ch. 25.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.report.statistics.significance import ALPHA

#: Share of the samples that are to tell the methods apart.
POWER = 0.8

#: Classes, or seeds, beyond which no more are tried.
MOST = 1000

#: Samples of each size, and exchanges of the two methods in the test of each beside what was found.
_SAMPLES, _EXCHANGES = 999, 1999

#: With fewer there are too few exchanges for any difference to be told at 5 %.
_FEWEST = 6


@dataclass(frozen=True)
class Power:
    """Power of a paired test between two methods.

    Parameters
    ----------
    now
        Share of samples as large as what there is that tell the two apart.
    needed
        Classes or seeds with which :data:`POWER` of the samples do; None if :data:`MOST` are too few.
    """

    now: float
    needed: int | None


def power_of(differences: NDArray[np.float64], units: Sequence[Hashable]) -> Power:
    """Return how surely two methods are told apart, and with how many units they would be.

    Parameters
    ----------
    differences
        Shape (N,): differences of the two, of queries or of means by seed, in whole numbers.
    units
        Class or seed of each: what is drawn as a whole.
    """
    numbers = {unit: number for number, unit in enumerate(dict.fromkeys(units))}
    sums = np.bincount([numbers[unit] for unit in units], differences, minlength=len(numbers))
    if not sums.any():
        return Power(0.0, None)
    most = max(MOST, len(sums))
    generator = np.random.default_rng(0)
    drawn = sums[generator.integers(0, len(sums), (_SAMPLES, most))]
    signs = 2.0 * generator.integers(0, 2, (_EXCHANGES, most)) - 1.0

    def share(size: int) -> float:
        """Share of the samples of a size that tell the two apart: larger ones begin with the same units."""
        sample = drawn[:, :size]
        # Whole numbers below 2^53: the products are exact, so equal sums are equal on every machine.
        as_large = np.count_nonzero(np.abs(signs[:, :size] @ sample.T) >= np.abs(sample.sum(axis=1)), axis=0)
        return float(np.mean((as_large + 1) / (_EXCHANGES + 1) < ALPHA))

    low, high = _FEWEST - 1, _FEWEST
    while share(high) < POWER:
        if high == most:
            return Power(share(len(sums)), None)
        low, high = high, min(2 * high, most)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if share(middle) >= POWER else (middle, high)
    return Power(share(len(sums)), high)
