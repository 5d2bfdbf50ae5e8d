"""Intervals of means over queries by bootstrap over classes, and tests whether two rows differ.

Queries of one class stand or fall together, so that what an interval draws anew is the classes: it says what other
subjects, or other animals, would have brought. Percentiles over few classes are too narrow rather than too wide: those
of a gallery of five classes are a lower bound of what is unknown. Tests exchange the two rows query by query, which
speaks of other poses of the same subjects, or class by class, which speaks of other subjects; with Holm's correction
for many rows.

References
----------
Efron & Tibshirani, "An Introduction to the Bootstrap", 1993, ch. 8 and 13.
Smucker, Allan, Carterette, "A comparison of statistical significance tests for information retrieval evaluation",
CIKM 2007 (Fisher's randomisation test on the difference of means).
Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6, 1979.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmark.report.statistics.queries import UNIT

#: Samples that are drawn, and the share of them that an interval holds.
DRAWS = 9999
LEVEL = 0.95

#: Ways to exchange the two methods that are tried, beside the one that was found.
RESAMPLES = 9999

#: Probability below which two rows count as different.
ALPHA = 0.05

#: Numbers that are drawn at a time.
_AT_A_TIME = 4_000_000


def intervals(values: NDArray[np.float64], labels: Sequence[Hashable]) -> NDArray[np.float64]:
    """Intervals of means over queries that hold 95 % of the means when classes are drawn anew.

    Parameters
    ----------
    values
        Shape (N, M): M columns of whole numbers in units of 1e-6; NaN where a column lacks the query.
    labels
        Class of each query.

    Returns
    -------
    ndarray
        Shape (M, 2): lower and upper end, in the unit of the measure; NaN for a column without queries.
    """
    classes = {label: number for number, label in enumerate(dict.fromkeys(labels))}
    of_query = np.array([classes[label] for label in labels], dtype=np.intp)
    sums, sizes = np.zeros((2, len(classes), values.shape[1]))
    np.add.at(sums, of_query, np.nan_to_num(values))
    np.add.at(sizes, of_query, ~np.isnan(values))
    with np.errstate(invalid="ignore"):  # a sample in which a column has no query
        found = np.hstack([(sums.T @ times.T) / (sizes.T @ times.T) for times in _times_drawn(len(classes))])
    ends = np.full((values.shape[1], 2), np.nan)
    counts = np.count_nonzero(~np.isnan(found), axis=1)
    for count in set(counts[counts > 0].tolist()):
        # Order statistics, not interpolated: with one draw less than a round number they are exact quantiles.
        first = max(round((1 - LEVEL) / 2 * (count + 1)) - 1, 0)
        places = [first, count - 1 - first]
        alike = counts == count
        ends[alike] = np.partition(found[alike], places, axis=1)[:, places] * UNIT  # what is not a number comes last
    return ends


def _times_drawn(n_classes: int) -> Iterator[NDArray[np.float64]]:
    """Return how often each class is in each sample, shape (draws, classes), some draws at a time."""
    generator = np.random.default_rng(0)
    most = max(1, _AT_A_TIME // max(n_classes, 1))
    for start in range(0, DRAWS, most):
        n = min(most, DRAWS - start)
        places = generator.integers(0, n_classes, (n, n_classes)) + n_classes * np.arange(n)[:, None]
        yield np.bincount(places.ravel(), minlength=n * n_classes).reshape(n, n_classes).astype(np.float64)


def permutation_test(differences: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probabilities of so large a mean difference if both methods were as good for each query.

    For each query the two methods are exchanged at random. The question is whether other queries of the same classes,
    such as other poses of these subjects, could turn the sign; for other classes see :func:`class_permutation_test`.

    Parameters
    ----------
    differences
        Shape (N, M): M pairs of methods, the difference of each for each query in whole numbers; 0 where a pair has no
        such query, which leaves its probability as it is.

    Returns
    -------
    ndarray
        Shape (M,): two-sided probabilities, at least 1 / 10 000.
    """
    n_queries = len(differences)
    found = np.abs(differences.sum(axis=0))
    as_large = np.zeros(differences.shape[1], dtype=np.int64)
    generator = np.random.default_rng(0)
    most = max(1, _AT_A_TIME // max(n_queries, 1))
    for start in range(0, RESAMPLES, most):
        signs = 2.0 * generator.integers(0, 2, (min(most, RESAMPLES - start), n_queries)) - 1.0
        # Whole numbers below 2^53: the products are exact, so equal sums are equal on every machine.
        as_large += np.count_nonzero(np.abs(signs @ differences) >= found, axis=0)
    return (as_large + 1) / (RESAMPLES + 1)


def class_permutation_test(differences: NDArray[np.float64], labels: Sequence[Hashable]) -> NDArray[np.float64]:
    """Probabilities of so large a mean difference if both methods were as good for each class.

    The two methods are exchanged for all queries of a class at once, in every way where there are few. The question is
    whether other subjects could turn the sign. With C classes no probability is below 2 / 2^C.

    Parameters
    ----------
    differences
        As for :func:`permutation_test`.
    labels
        Class of each query.

    Returns
    -------
    ndarray
        Shape (M,): two-sided probabilities.
    """
    classes = {label: number for number, label in enumerate(dict.fromkeys(labels))}
    sums = np.zeros((len(classes), differences.shape[1]))
    np.add.at(sums, [classes[label] for label in labels], differences)
    if 2 ** len(classes) > RESAMPLES + 1:
        return permutation_test(sums)
    signs = 1.0 - 2.0 * (np.arange(2 ** len(classes))[:, None] >> np.arange(len(classes)) & 1)
    return np.asarray((np.abs(signs @ sums) >= np.abs(sums.sum(axis=0))).mean(axis=0))


def least_class_probability(n_classes: int) -> float:
    """Least probability that :func:`class_permutation_test` can give."""
    return max(2.0 ** (1 - n_classes), 1 / (RESAMPLES + 1))


def holm(probabilities: Sequence[float]) -> list[float]:
    """Probabilities adjusted for their number, in the order given; see Holm 1979."""
    adjusted = [0.0] * len(probabilities)
    largest = 0.0
    for rank, place in enumerate(sorted(range(len(probabilities)), key=lambda k: probabilities[k])):
        largest = max(largest, min(1.0, (len(probabilities) - rank) * probabilities[place]))
        adjusted[place] = largest
    return adjusted
