"""Confidence intervals of means over queries, by bootstrap over classes.

Queries of one class stand or fall together, so that what is drawn anew is the classes: the interval says what other
subjects, or other animals, would have brought. Percentiles over few classes are too narrow rather than too wide: those
of a gallery of five classes are a lower bound of what is unknown.

References
----------
Efron & Tibshirani, "An Introduction to the Bootstrap", 1993, ch. 8 and 13.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Sequence
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from benchmark.report.statistics.queries import UNIT

#: Samples that are drawn, and the share of them that an interval holds.
DRAWS = 9999
LEVEL = 0.95

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
        means = [(times @ sums) / (times @ sizes) for times in _times_drawn(len(classes))]
    found = np.sort(np.concatenate(means), axis=0)  # what is not a number comes last
    counts = np.count_nonzero(~np.isnan(found), axis=0)
    ends = np.full((values.shape[1], 2), np.nan)
    for column, count in enumerate(counts):
        if count:
            # Order statistics, not interpolated: with one draw less than a round number they are exact quantiles.
            first = max(round((1 - LEVEL) / 2 * (count + 1)) - 1, 0)
            ends[column] = found[first, column] * UNIT, found[count - 1 - first, column] * UNIT
    return ends


def widened(low: float, high: float, mean: float, deviation: float, least: float = 0.0) -> tuple[float, float]:
    """Return an interval with the noise of preparation added to that of classes, as independent ones are.

    Parameters
    ----------
    low, high
        Ends of the interval of a mean over queries.
    mean
        The mean.
    deviation
        Standard deviation of the mean from one preparation to the next; 0 leaves the ends as they are.
    least
        Smallest value that the mean can have; the largest is 1.
    """
    if not deviation:
        return low, high
    reach = NormalDist().inv_cdf((1 + LEVEL) / 2) * deviation
    return max(least, mean - math.hypot(mean - low, reach)), min(1.0, mean + math.hypot(high - mean, reach))


def _times_drawn(n_classes: int) -> Iterator[NDArray[np.float64]]:
    """Return how often each class is in each sample, shape (draws, classes), some draws at a time."""
    generator = np.random.default_rng(0)
    most = max(1, _AT_A_TIME // max(n_classes, 1))
    for start in range(0, DRAWS, most):
        n = min(most, DRAWS - start)
        places = generator.integers(0, n_classes, (n, n_classes)) + n_classes * np.arange(n)[:, None]
        yield np.bincount(places.ravel(), minlength=n * n_classes).reshape(n, n_classes).astype(np.float64)
