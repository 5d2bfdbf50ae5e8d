"""Confidence intervals of means over queries, and tests for differences between rows.

Queries of one class are dependent, so intervals resample whole classes and describe the variation over other subjects
or animals. Percentile intervals over few classes are rather too narrow: for five classes they are a lower bound of the
uncertainty. Tests exchange two rows query by query, for other poses of the same subjects, or class by class, for other
subjects, with Holm's correction for many rows.

References
----------
Efron & Tibshirani, "An Introduction to the Bootstrap", 1993, ch. 8 and 13.
Smucker, Allan, Carterette, "A comparison of statistical significance tests for information retrieval evaluation",
CIKM 2007 (Fisher's randomisation test on the difference of means).
Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6, 1979.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.api.contracts import Input
from benchmark.pipeline.storage.records import OTHER_SHAPES
from benchmark.report.escaping import millionths
from retrieval.measures import PRINTED

#: Records have six decimals. Sums of integers do not depend on their order, so they are equal on every machine.
UNIT = 1e-6

#: Number of bootstrap samples, and confidence level.
DRAWS = 9999
LEVEL = 0.95

#: Number of random exchanges, in addition to the observed assignment.
RESAMPLES = 9999

#: Significance level.
ALPHA = 0.05

#: Family of controls, which are excluded from comparisons: they show the scores without a canonical form.
CONTROL = "control"

#: Random numbers in one batch.
_AT_A_TIME = 4_000_000


@dataclass(frozen=True, eq=False)
class Queries:
    """Measures of the queries of several rows.

    Parameters
    ----------
    values
        Shape (N, M, R): N queries, M printed measures, R rows; integers in units of 1e-6, 0 without a result.
    has
        Shape (N, R): whether the row has the query.
    labels
        Class of each query.
    """

    values: NDArray[np.float64]
    has: NDArray[np.bool_]
    labels: list[str]

    def gains(self, first: int, second: int) -> tuple[NDArray[np.float64], list[str]]:
        """Return the gain of the second row for each common query, a column per measure, and the classes."""
        both = np.flatnonzero(self.has[:, first] & self.has[:, second])
        gains = self.values[both, :, second] - self.values[both, :, first]
        return gains, [self.labels[place] for place in both]


def queries_of(rows: Sequence[Sequence[Mapping[str, Any]]]) -> Queries:
    """Collect the queries of each row from its records with scores, averaged over several trainings on a gallery.

    Queries without a relevant shape, which count in no mean, are omitted.
    """
    labels: dict[tuple[str, str], str] = {}
    parts = []
    for row, records in enumerate(rows):
        for record in records:
            values = np.array([record["per_query"][name] for name in PRINTED], dtype=np.float64).T
            known = np.flatnonzero(~np.isnan(values).any(axis=1))
            names = [(record["gallery"], record["shapes"][place]) for place in known]
            labels |= zip(names, (record["labels"][place] for place in known), strict=True)
            parts.append((row, names, values[known]))
    place_of = {name: place for place, name in enumerate(labels)}
    sums, counts = np.zeros((len(labels), len(PRINTED), len(rows))), np.zeros((len(labels), len(rows)))
    for row, names, values in parts:
        places = [place_of[name] for name in names]
        sums[places, :, row] += values
        counts[places, row] += 1
    means = sums / np.maximum(counts, 1)[:, None]
    return Queries(np.rint(means / UNIT), counts > 0, [*labels.values()])


def intervals(values: NDArray[np.float64], labels: Sequence[Hashable]) -> NDArray[np.float64]:
    """Return 95 % bootstrap intervals of means over queries, with whole classes resampled.

    Parameters
    ----------
    values
        Shape (N, M): M columns of integers in units of 1e-6; NaN if a column lacks the query.
    labels
        Class of each query.

    Returns
    -------
    ndarray
        Shape (M, 2): lower and upper end in the unit of the measure; NaN for a column without queries.
    """
    sums, sizes = _by_class(np.nan_to_num(values), labels), _by_class(~np.isnan(values), labels)
    with np.errstate(invalid="ignore"):  # a sample without queries of a column
        means = np.hstack([(sums.T @ times.T) / (sizes.T @ times.T) for times in _times_drawn(len(sums))])
    ends = np.full((values.shape[1], 2), np.nan)
    counts = np.count_nonzero(~np.isnan(means), axis=1)
    for count in set(counts[counts > 0].tolist()):
        # Order statistics are exact quantiles, because the number of samples is one less than a round one.
        first = max(round((1 - LEVEL) / 2 * (count + 1)) - 1, 0)
        places = [first, count - 1 - first]
        alike = counts == count
        ends[alike] = np.partition(means[alike], places, axis=1)[:, places] * UNIT  # NaN comes last
    return ends


def _by_class(values: ArrayLike, labels: Sequence[Hashable]) -> NDArray[np.float64]:
    """Return sums over the queries of each class, in the order of their first query."""
    classes = {label: number for number, label in enumerate(dict.fromkeys(labels))}
    columns = np.asarray(values)
    sums = np.zeros((len(classes), columns.shape[1]))
    np.add.at(sums, np.array([classes[label] for label in labels], dtype=np.intp), columns)
    return sums


def _times_drawn(n_classes: int) -> Iterator[NDArray[np.float64]]:
    """Yield the counts of classes in bootstrap samples in batches, shape (samples, classes)."""
    generator = np.random.default_rng(0)
    most = max(1, _AT_A_TIME // max(n_classes, 1))
    for start in range(0, DRAWS, most):
        n = min(most, DRAWS - start)
        places = generator.integers(0, n_classes, (n, n_classes)) + n_classes * np.arange(n)[:, None]
        yield np.bincount(places.ravel(), minlength=n * n_classes).reshape(n, n_classes).astype(np.float64)


def permutation_test(differences: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two-sided p-values of mean differences, by random exchanges of the two methods for each query.

    The null hypothesis concerns other queries of the same classes, such as other poses of these subjects; for other
    classes see :func:`class_permutation_test`.

    Parameters
    ----------
    differences
        Shape (N, M): differences for N queries between M pairs of methods, as integers; 0 for queries that a pair
        lacks, which do not affect its p-value.

    Returns
    -------
    ndarray
        Shape (M,): p-values, at least 1 / 10 000.
    """
    n_queries = len(differences)
    measured = np.abs(differences.sum(axis=0))
    as_large = np.zeros(differences.shape[1], dtype=np.int64)
    generator = np.random.default_rng(0)
    most = max(1, _AT_A_TIME // max(n_queries, 1))
    for start in range(0, RESAMPLES, most):
        signs = 2.0 * generator.integers(0, 2, (min(most, RESAMPLES - start), n_queries)) - 1.0
        # Integers below 2^53: products are exact, so equal sums are equal on every machine.
        as_large += np.count_nonzero(np.abs(signs @ differences) >= measured, axis=0)
    return (as_large + 1) / (RESAMPLES + 1)


def class_permutation_test(differences: NDArray[np.float64], labels: Sequence[Hashable]) -> NDArray[np.float64]:
    """Return two-sided p-values of mean differences, by exchanges of the two methods for whole classes.

    If there are few classes, all exchanges are tried. The null hypothesis concerns other subjects. With C classes, no
    p-value is below 2 / 2^C.

    Parameters
    ----------
    differences
        As for :func:`permutation_test`.
    labels
        Class of each query.

    Returns
    -------
    ndarray
        Shape (M,): p-values.
    """
    sums = _by_class(differences, labels)
    if 2 ** len(sums) > RESAMPLES + 1:
        return permutation_test(sums)
    signs = 1.0 - 2.0 * (np.arange(2 ** len(sums))[:, None] >> np.arange(len(sums)) & 1)
    return np.asarray((np.abs(signs @ sums) >= np.abs(sums.sum(axis=0))).mean(axis=0))


def least_class_probability(n_classes: int) -> float:
    """Return the smallest p-value that :func:`class_permutation_test` can return."""
    return max(2.0 ** (1 - n_classes), 1 / (RESAMPLES + 1))


def holm(probabilities: ArrayLike) -> list[float]:
    """Return p-values adjusted for multiple tests, in the given order; see Holm 1979."""
    given = np.asarray(probabilities, dtype=np.float64)
    order = np.argsort(given, kind="stable")
    adjusted = np.empty_like(given)
    adjusted[order] = np.minimum(np.maximum.accumulate(given[order] * np.arange(len(given), 0, -1)), 1)
    return [float(probability) for probability in adjusted]


@dataclass(frozen=True)
class FigureSignificance:
    """Interval and significance of one score.

    Parameters
    ----------
    low, high
        Ends of its 95 % interval over classes.
    is_best
        Whether no other row of the column, except controls and incomplete rows, has a higher score.
    probability
        Adjusted p-value of the difference from the best row; None for the best row itself, controls and incomplete
        rows.
    is_tied
        Whether the row has ties for the first rank.
    """

    low: float
    high: float
    is_best: bool = False
    probability: float | None = None
    is_tied: bool = False

    @property
    def is_inseparable(self) -> bool:
        """Whether the row does not differ significantly from the best one, for other reasons than ties."""
        return self.probability is not None and millionths(self.probability) >= ALPHA and not self.is_tied


#: Significance by method and input, and by measure, for rows with scores.
TableSignificance = dict[tuple[str, Input], dict[str, FigureSignificance]]


def table_significance(lines: Iterable[Any]) -> TableSignificance:
    """Return the significance of our scores in a table; see :attr:`.TableContent.lines`.

    Rows in which a gallery or a training is missing, and count as 0, have none.
    """
    by_input: dict[Input, list[Any]] = {}
    for line in lines:
        if line.is_complete:
            by_input.setdefault(line.input, []).append(line)
    return {place: judged for of_input in by_input.values() for place, judged in _of_input(of_input).items()}


def _of_input(lines: Sequence[Any]) -> TableSignificance:
    queries = queries_of([line.records for line in lines])
    values = queries.values
    ends = intervals(values.reshape(len(values), -1), queries.labels).reshape(*values.shape[1:], 2)
    contest = [
        k
        for k, line in enumerate(lines)
        if line.family != CONTROL and line.coverage >= 1 and OTHER_SHAPES not in line.outdated
    ]
    scores = [[millionths(line.scores[name]) for line in lines] for name in PRINTED]
    best = [max(contest, key=lambda k: (of_lines[k], -k), default=None) for of_lines in scores]
    others = [[k for k in contest if k != first] for first in best]
    gains = [values[:, m, others[m]] - values[:, m, [first]] for m, first in enumerate(best) if first is not None]
    tested = permutation_test(np.hstack(gains)).reshape(len(PRINTED), -1) if gains else np.zeros((len(PRINTED), 0))
    probabilities = [dict(zip(others[m], holm(tested[m]), strict=True)) for m in range(len(PRINTED))]
    return {
        (line.method, line.input): {
            measure: FigureSignificance(low, high, k == best[m], probabilities[m].get(k), line.n_tied > 0)
            for m, (measure, (low, high)) in enumerate(zip(PRINTED, ends[:, k].tolist(), strict=True))
        }
        for k, line in enumerate(lines)
    }
