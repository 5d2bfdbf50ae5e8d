"""Intervals of means over queries, and a test of all differences between rows.

Queries of one class are dependent. Intervals therefore resample whole classes, and the test permutes rows within whole
classes: both speak of other subjects. With few classes, intervals are rather too narrow, and nothing is tested.

References
----------
Efron & Tibshirani, "An Introduction to the Bootstrap", 1993, ch. 8 and 13.
Carterette, "Multiple testing in statistical analysis of systems-based information retrieval experiments", ACM
Transactions on Information Systems 30, 2012.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Number of bootstrap samples, and of permutations.
DRAWS = 9999

#: Significance level of the test.
ALPHA = 0.05

#: Fewest classes from which a difference is tested.
FEWEST_CLASSES = 8

#: Values have six decimals. Sums of whole millionths do not depend on their order.
_MILLION = 1e6


def class_sums(values: ArrayLike, labels: Sequence[Hashable]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the sums over the queries of each class, in millionths, and the sizes of the classes.

    Parameters
    ----------
    values
        Measures of the queries, shape (N, ...).
    labels
        Class of each query.
    """
    places = {label: place for place, label in enumerate(dict.fromkeys(labels))}
    of_query = np.array([places[label] for label in labels], dtype=np.intp)
    millionths = np.rint(np.asarray(values, dtype=np.float64) * _MILLION)
    sums = np.zeros((len(places), *millionths.shape[1:]))
    np.add.at(sums, of_query, millionths)
    return sums, np.bincount(of_query, minlength=len(places)).astype(np.float64)


def bootstrap_intervals(values: ArrayLike, labels: Sequence[Hashable], level: float) -> NDArray[np.float64]:
    """Return percentile intervals of means over queries, with whole classes resampled.

    Parameters
    ----------
    values
        Shape (N, M): M columns.
    labels
        Class of each query.
    level
        Confidence level.

    Returns
    -------
    numpy.ndarray
        Shape (M, 2): lower and upper ends.
    """
    sums, sizes = class_sums(values, labels)
    times = _times_drawn(len(sizes))
    means = (times @ sums) / (times @ sizes)[:, None] / _MILLION
    # Order statistics are exact quantiles, because the number of samples is one less than a round one.
    first = round((1 - level) / 2 * (DRAWS + 1)) - 1
    return np.sort(means, axis=0)[[first, DRAWS - 1 - first]].T


@lru_cache(maxsize=8)
def _times_drawn(n_classes: int) -> NDArray[np.float64]:
    """Return how often each class is in each bootstrap sample, shape (samples, classes)."""
    equal = np.full(n_classes, 1 / n_classes)
    return np.random.default_rng(0).multinomial(n_classes, equal, DRAWS).astype(np.float64)


def tukey_test(values: ArrayLike, labels: Sequence[Hashable]) -> NDArray[np.float64]:
    """Return p-values of the differences between all rows: the randomisedTukey test over whole classes.

    In each of :data:`DRAWS` permutations, the rows are permuted within every class, in the same way for all measures.
    The largest difference between two totals, in units of its mean over the permutations and largest over the measures,
    is what a difference must reach. If all rows are equal, the probability that any p is below 0.05 is at most 0.05.

    Parameters
    ----------
    values
        Measures of the queries of each row, shape (rows, N, M).
    labels
        Class of each query.

    Returns
    -------
    numpy.ndarray
        Shape (rows, rows, M); NaN if there are fewer than :data:`FEWEST_CLASSES` classes.
    """
    sums = class_sums(np.moveaxis(np.asarray(values, dtype=np.float64), 1, 0), labels)[0]
    if len(sums) < FEWEST_CLASSES:
        return np.full((sums.shape[1], *sums.shape[1:]), np.nan)
    generator = np.random.default_rng(0)
    permuted = np.zeros((DRAWS, *sums.shape[1:]))
    for of_class in sums:
        permuted += of_class[generator.random((DRAWS, len(of_class))).argsort(axis=1)]
    ranges, totals = np.ptp(permuted, axis=1), sums.sum(axis=0)
    unit = np.maximum(ranges.mean(axis=0), np.finfo(np.float64).tiny)  # all rows may be equal in a measure
    largest = np.sort((ranges / unit).max(axis=1))
    differences = np.abs(totals[:, None] - totals) / unit
    return np.asarray((DRAWS - np.searchsorted(largest, differences) + 1) / (DRAWS + 1))
