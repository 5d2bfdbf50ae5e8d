"""Tests whether two rows differ: paired permutations over queries, and Holm's correction for many rows.

References
----------
Smucker, Allan, Carterette, "A comparison of statistical significance tests for information retrieval evaluation",
CIKM 2007 (Fisher's randomisation test on the difference of means).
Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6, 1979.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

#: Ways to exchange the two methods that are tried, beside the one that was found.
RESAMPLES = 9999

#: Probability below which two rows count as different.
ALPHA = 0.05

#: Numbers that are drawn at a time.
_AT_A_TIME = 4_000_000


def permutation_test(differences: NDArray[np.float64], noise: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Probabilities of so large a mean difference if both methods were as good for each query.

    For each query the two methods are exchanged at random. The question is whether other queries of the same classes
    could turn the sign; what other classes would do is told by the interval.

    Parameters
    ----------
    differences
        Shape (N, M): M pairs of methods, the difference of each for each query in whole numbers; 0 where a pair has no
        such query, which leaves its probability as it is.
    noise
        Shape (M,): standard deviations of the sums of the differences from one preparation of the shapes to the next,
        in the same unit, which is added to the noise of queries; None for none.

    Returns
    -------
    ndarray
        Shape (M,): two-sided probabilities, at least 1 / 10 000.
    """
    n_queries = len(differences)
    found = np.abs(differences.sum(axis=0))
    as_large = np.zeros(differences.shape[1], dtype=np.int64)
    generator, of_preparation = np.random.default_rng(0), np.random.default_rng(1)
    most = max(1, _AT_A_TIME // max(n_queries, 1))
    for start in range(0, RESAMPLES, most):
        signs = 2.0 * generator.integers(0, 2, (min(most, RESAMPLES - start), n_queries)) - 1.0
        # Whole numbers below 2^53: the products are exact, so equal sums are equal on every machine.
        sums = signs @ differences
        if noise is not None:
            sums += noise * of_preparation.standard_normal((len(signs), 1))
        as_large += np.count_nonzero(np.abs(sums) >= found, axis=0)
    return (as_large + 1) / (RESAMPLES + 1)


def holm(probabilities: Sequence[float]) -> list[float]:
    """Probabilities adjusted for their number, in the order given; see Holm 1979."""
    adjusted = [0.0] * len(probabilities)
    largest = 0.0
    for rank, place in enumerate(sorted(range(len(probabilities)), key=lambda k: probabilities[k])):
        largest = max(largest, min(1.0, (len(probabilities) - rank) * probabilities[place]))
        adjusted[place] = largest
    return adjusted
