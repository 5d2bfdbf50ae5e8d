"""How sure the figures of a table are: intervals of means over queries, and tests whether two rows differ.

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

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.api.contracts import Input
from benchmark.report.rounding import millionths
from retrieval.measures import PRINTED

if TYPE_CHECKING:
    from pandas import DataFrame

    from benchmark.report.content import Row

#: Records keep six decimals. Sums of whole numbers are the same in any order, so on every machine.
UNIT = 1e-6

#: Samples that are drawn, and the share of them that an interval holds.
DRAWS = 9999
LEVEL = 0.95

#: Ways to exchange the two methods that are tried, beside the one that was measured.
RESAMPLES = 9999

#: Probability below which two rows count as different.
ALPHA = 0.05

#: Rows of this family take no part in the contest: they show what the scorer makes of no canonical form at all.
CONTROL = "control"

#: Numbers that are drawn at a time.
_AT_A_TIME = 4_000_000


def queries_of(records: Sequence[Mapping[str, Any]]) -> DataFrame:
    """Collect the queries of some records: those of several galleries, the mean over several trainings on one.

    A query without a relevant shape counts in no mean and is left out.

    Parameters
    ----------
    records
        Records with scores, of one method under one input.

    Returns
    -------
    pandas.DataFrame
        By gallery and shape: ``label``, and the printed measures in units of 1e-6, whole numbers in double precision.
    """
    from pandas import DataFrame

    names = [*PRINTED]
    columns = [[value for record in records for value in record["per_query"][name]] for name in names]
    queries = DataFrame(np.array(columns, dtype=np.float64).T, columns=names)
    queries["gallery"] = [record["gallery"] for record in records for _ in record["shapes"]]
    queries["shape"] = [shape for record in records for shape in record["shapes"]]
    queries["label"] = [label for record in records for label in record["labels"]]
    queries = queries.dropna(subset=names).set_index(["gallery", "shape"])
    if not queries.index.is_unique:
        grouped = queries.groupby(level=[0, 1], sort=False)
        queries = grouped[names].mean().join(grouped[["label"]].last())
    queries[names] = np.rint(queries[names] / UNIT)
    return queries


def paired_gains(first: DataFrame, second: DataFrame) -> tuple[NDArray[np.float64], list[str]]:
    """Return how much better the second is for each query of both, a column for each measure, and the classes."""
    first = first.loc[first.index.isin(second.index)]
    gains = second.loc[first.index].drop(columns="label") - first.drop(columns="label")
    return gains.to_numpy(), first["label"].tolist()


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
    sums, sizes = _by_class(np.nan_to_num(values), labels), _by_class(~np.isnan(values), labels)
    with np.errstate(invalid="ignore"):  # a sample in which a column has no query
        means = np.hstack([(sums.T @ times.T) / (sizes.T @ times.T) for times in _times_drawn(len(sums))])
    ends = np.full((values.shape[1], 2), np.nan)
    counts = np.count_nonzero(~np.isnan(means), axis=1)
    for count in set(counts[counts > 0].tolist()):
        # Order statistics, not interpolated: with one draw less than a round number they are exact quantiles.
        first = max(round((1 - LEVEL) / 2 * (count + 1)) - 1, 0)
        places = [first, count - 1 - first]
        alike = counts == count
        ends[alike] = np.partition(means[alike], places, axis=1)[:, places] * UNIT  # what is not a number comes last
    return ends


def _by_class(values: ArrayLike, labels: Sequence[Hashable]) -> NDArray[np.float64]:
    """Sums over the queries of each class, in the order in which the classes appear."""
    classes = {label: number for number, label in enumerate(dict.fromkeys(labels))}
    columns = np.asarray(values)
    sums = np.zeros((len(classes), columns.shape[1]))
    np.add.at(sums, np.array([classes[label] for label in labels], dtype=np.intp), columns)
    return sums


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
    measured = np.abs(differences.sum(axis=0))
    as_large = np.zeros(differences.shape[1], dtype=np.int64)
    generator = np.random.default_rng(0)
    most = max(1, _AT_A_TIME // max(n_queries, 1))
    for start in range(0, RESAMPLES, most):
        signs = 2.0 * generator.integers(0, 2, (min(most, RESAMPLES - start), n_queries)) - 1.0
        # Whole numbers below 2^53: the products are exact, so equal sums are equal on every machine.
        as_large += np.count_nonzero(np.abs(signs @ differences) >= measured, axis=0)
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
    sums = _by_class(differences, labels)
    if 2 ** len(sums) > RESAMPLES + 1:
        return permutation_test(sums)
    signs = 1.0 - 2.0 * (np.arange(2 ** len(sums))[:, None] >> np.arange(len(sums)) & 1)
    return np.asarray((np.abs(signs @ sums) >= np.abs(sums.sum(axis=0))).mean(axis=0))


def least_class_probability(n_classes: int) -> float:
    """Least probability that :func:`class_permutation_test` can give."""
    return max(2.0 ** (1 - n_classes), 1 / (RESAMPLES + 1))


def holm(probabilities: ArrayLike) -> list[float]:
    """Probabilities adjusted for their number, in the order given; see Holm 1979."""
    given = np.asarray(probabilities, dtype=np.float64)
    order = np.argsort(given, kind="stable")
    adjusted = np.empty_like(given)
    adjusted[order] = np.minimum(np.maximum.accumulate(given[order] * np.arange(len(given), 0, -1)), 1)
    return [float(probability) for probability in adjusted]


@dataclass(frozen=True)
class FigureSignificance:
    """Interval and significance of one figure.

    Parameters
    ----------
    low, high
        Ends of its 95 % interval over classes.
    is_best
        Whether no other row of the column, controls aside, has a higher figure.
    probability
        Of so large a difference from the best row if there were none, adjusted for the number of rows; None for the
        best row itself and for controls.
    is_tied
        Whether first ranks of the row tie, see :attr:`benchmark.report.cell.Cell.n_tied`.
    """

    low: float
    high: float
    is_best: bool = False
    probability: float | None = None
    is_tied: bool = False

    @property
    def rounded_probability(self) -> float | None:
        """The probability with the four decimals that its resamples carry."""
        return None if self.probability is None else round(self.probability, 4)

    @property
    def is_inseparable(self) -> bool:
        """Return whether the row cannot be told from the best one, and ties are not the reason."""
        return self.probability is not None and millionths(self.probability) >= ALPHA and not self.is_tied


#: By method, input and measure; figures without scores have none.
TableSignificance = dict[tuple[str, Input, str], FigureSignificance]


def table_significance(rows: Sequence[Row], inputs: Sequence[Input]) -> TableSignificance:
    """Judge all our figures of a table."""
    judged: TableSignificance = {}
    for input_ in inputs:
        judged |= _of_input([row for row in rows if input_ in row.cells and row.cells[input_].records], input_)
    return judged


def _of_input(rows: Sequence[Row], input_: Input) -> TableSignificance:
    if not rows:
        return {}
    from pandas import MultiIndex

    cells = [row.cells[input_] for row in rows]
    of_rows = [cell.queries for cell in cells]
    labels = {name: label for queries in of_rows for name, label in queries["label"].items()}
    index = MultiIndex.from_tuples(labels) if labels else of_rows[0].index
    # Queries, measures, rows; a query without a result finds nothing.
    values = np.stack([queries[[*PRINTED]].reindex(index, fill_value=0.0) for queries in of_rows], axis=-1)
    ends = intervals(values.reshape(len(labels), -1), [*labels.values()]).reshape(*values.shape[1:], 2)
    contest = [k for k, row in enumerate(rows) if row.family != CONTROL and cells[k].is_complete]
    scores = [[millionths((cell.scores or {})[name]) for cell in cells] for name in PRINTED]
    best = [max(contest, key=lambda k: (of_rows[k], -k), default=None) for of_rows in scores]
    others = [[k for k in contest if k != first] for first in best]
    gains = [values[:, m, others[m]] - values[:, m, [first]] for m, first in enumerate(best) if first is not None]
    tested = permutation_test(np.hstack(gains)).reshape(len(PRINTED), -1) if gains else np.zeros((len(PRINTED), 0))
    probabilities = [dict(zip(others[m], holm(tested[m]), strict=True)) for m in range(len(PRINTED))]
    return {
        (row.method, input_, measure): FigureSignificance(
            float(ends[m, k, 0]), float(ends[m, k, 1]), k == best[m], probabilities[m].get(k), cells[k].n_tied > 0
        )
        for m, measure in enumerate(PRINTED)
        for k, row in enumerate(rows)
    }
