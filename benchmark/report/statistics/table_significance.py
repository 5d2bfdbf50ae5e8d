"""Contest of the rows of a table: how sure each figure is, which differ from the best, which lead at their cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Input
from benchmark.report.cell import Cell
from benchmark.report.statistics.queries import UNIT, Queries, queries_of
from benchmark.report.statistics.significance import ALPHA, holm, intervals, permutation_test, widened
from retrieval.nearest_measures import printed_of


class Row(Protocol):
    """Row of a table, as the tests need it."""

    @property
    def method(self) -> str:
        """Name of the row."""
        ...

    @property
    def family(self) -> str:
        """Kind of the row."""
        ...

    @property
    def cells(self) -> Mapping[Input, Cell]:
        """Our figures by input."""
        ...


#: Rows of this family take no part in the contest: they show what the scorer makes of no canonical form at all.
CONTROL = "control"


@dataclass(frozen=True)
class FigureSignificance:
    """Interval and significance of one figure.

    Parameters
    ----------
    low, high
        Ends of its 95 % interval over classes, and over preparations where there are several.
    is_best
        Whether no other row of the column, controls aside, has a higher figure.
    probability
        Of so large a difference from the best row if there were none, adjusted for the number of rows; None for the
        best row itself and for controls.
    """

    low: float
    high: float
    is_best: bool = False
    probability: float | None = None

    @property
    def rounded_probability(self) -> float | None:
        """The probability with the four decimals that its resamples carry."""
        return None if self.probability is None else round(self.probability, 4)

    @property
    def is_inseparable(self) -> bool:
        """Return whether the row cannot be told from the best one."""
        return self.probability is not None and self.probability >= ALPHA


#: SignificanceTable by method, input and measure; figures without scores have none.
SignificanceTable = Mapping[tuple[str, Input, str], FigureSignificance]


def table_significance(rows: Sequence[Row], inputs: Sequence[Input]) -> SignificanceTable:
    """Judge all our figures of a table."""
    found: dict[tuple[str, Input, str], FigureSignificance] = {}
    for input_ in inputs:
        found |= _of_input([row for row in rows if input_ in row.cells and row.cells[input_].records], input_)
    return found


def _of_input(rows: Sequence[Row], input_: Input) -> SignificanceTable:
    if not rows:
        return {}
    measures = printed_of(set.intersection(*({*(row.cells[input_].scores or ())} for row in rows)))
    queries = [queries_of(row.cells[input_].records, measures) for row in rows]
    names, labels = _union(queries)
    found: dict[tuple[str, Input, str], FigureSignificance] = {}
    for measure in measures:
        columns = _columns(queries, names, measure)
        ends = intervals(columns, labels)
        scores = [row.cells[input_].scores or {} for row in rows]
        noise = np.array([(row.cells[input_].preparation_sd or {}).get(measure, 0.0) for row in rows])
        contest = [k for k, row in enumerate(rows) if row.family != CONTROL and row.cells[input_].is_complete]
        best = max(contest, key=lambda k: (scores[k][measure], -k), default=None)
        probabilities = _against(columns, contest, best, noise)
        for k, row in enumerate(rows):
            low, high = widened(float(ends[k, 0]), float(ends[k, 1]), scores[k][measure], float(noise[k]))
            found[row.method, input_, measure] = FigureSignificance(low, high, k == best, probabilities.get(k))
    return found


def _against(
    columns: NDArray[np.float64], contest: Sequence[int], best: int | None, noise: NDArray[np.float64]
) -> dict[int, float]:
    """Adjusted probability of each other row of the contest against the best, over all queries and preparations."""
    others = [k for k in contest if k != best]
    if best is None or not others:
        return {}
    differences = columns[:, others] - columns[:, [best]]
    of_sums = np.hypot(noise[others], noise[best]) / UNIT * len(columns)
    return dict(
        zip(others, holm(permutation_test(differences, of_sums if of_sums.any() else None).tolist()), strict=True)
    )


def _union(queries: Sequence[Queries]) -> tuple[list[tuple[str, str]], tuple[str, ...]]:
    """Names and classes of all queries that some row has."""
    labels: dict[tuple[str, str], str] = {}
    for each in queries:
        labels |= zip(each.names, each.labels, strict=True)
    return list(labels), tuple(labels.values())


def _columns(queries: Sequence[Queries], names: Sequence[tuple[str, str]], measure: str) -> NDArray[np.float64]:
    """One column a row of the table; a query without a result finds nothing."""
    place = {name: k for k, name in enumerate(names)}
    columns = np.zeros((len(names), len(queries)))
    for column, each in enumerate(queries):
        columns[[place[name] for name in each.names], column] = each.values[measure]
    return columns


def pareto_front(points: Mapping[str, tuple[float, float]]) -> list[str]:
    """Names on the front of cost and score: none of the others is both cheaper and better.

    Parameters
    ----------
    points
        Cost, of which less is better, and score, of which more is better, by name.

    Returns
    -------
    list of str
        The cheapest first; of names that are equal in both, all.
    """
    front: list[str] = []
    for name, (cost, score) in sorted(points.items(), key=lambda item: (item[1][0], -item[1][1], item[0])):
        if not front or score > points[front[-1]][1] or (cost, score) == points[front[-1]]:
            front.append(name)
    return front
