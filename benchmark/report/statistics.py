"""Intervals of means over queries, and tests of differences between two rows.

Queries of one class are dependent. Intervals therefore resample whole classes, and the test over classes exchanges two
rows for whole classes: both speak of other subjects. With few classes, intervals are rather too narrow, and no p-value
is below 2 / 2^classes. The test over queries speaks only of other poses of the same subjects.

References
----------
Efron & Tibshirani, "An Introduction to the Bootstrap", 1993, ch. 8 and 13.
Smucker, Allan, Carterette, "A comparison of statistical significance tests for information retrieval evaluation",
CIKM 2007 (Fisher's randomisation test on the difference of means).
Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6, 1979.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Number of bootstrap samples, and of random exchanges.
DRAWS = 9999

#: Significance level of the tests.
ALPHA = 0.05

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


def exchange_test(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two-sided p-values of sums of differences, by exchanges of the two rows for each unit.

    All exchanges are tried if there are few units, otherwise :data:`DRAWS` random ones in addition to the observed one.

    Parameters
    ----------
    sums
        Differences of the units (queries or classes) in whole millionths, shape (units, M).
    """
    measured = np.abs(sums.sum(axis=0))
    if 2 ** len(sums) <= DRAWS + 1:
        signs = 1.0 - 2.0 * (np.arange(2 ** len(sums))[:, None] >> np.arange(len(sums)) & 1)
        return np.asarray((np.abs(signs @ sums) >= measured).mean(axis=0))
    signs = 2.0 * np.random.default_rng(0).integers(0, 2, (DRAWS, len(sums))) - 1.0
    return np.asarray((np.count_nonzero(np.abs(signs @ sums) >= measured, axis=0) + 1) / (DRAWS + 1))


def class_test(differences: ArrayLike, labels: Sequence[Hashable]) -> NDArray[np.float64]:
    """Return p-values of mean differences for other subjects: two rows are exchanged for whole classes."""
    return exchange_test(class_sums(differences, labels)[0])


def query_test(differences: ArrayLike) -> NDArray[np.float64]:
    """Return p-values of mean differences for other poses of the same subjects: rows are exchanged query by query."""
    return exchange_test(np.rint(np.asarray(differences, dtype=np.float64) * _MILLION))


def holm(probabilities: ArrayLike) -> NDArray[np.float64]:
    """Return p-values adjusted for multiple tests, in the given order; see Holm 1979."""
    given = np.asarray(probabilities, dtype=np.float64)
    order = np.argsort(given, kind="stable")
    adjusted = np.empty_like(given)
    adjusted[order] = np.minimum(np.maximum.accumulate(given[order] * np.arange(len(given), 0, -1)), 1)
    return adjusted
