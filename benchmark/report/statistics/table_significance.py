"""Contest of the rows of a table: how sure each figure is, which differ from the best, which lead at their cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Input
from benchmark.report.cell import Cell
from benchmark.report.rounding import millionths
from benchmark.report.statistics.queries import Queries, queries_of
from benchmark.report.statistics.significance import ALPHA, holm, intervals, permutation_test
from retrieval.measures import PRINTED


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
    cells = [row.cells[input_] for row in rows]
    columns, labels = _columns([queries_of(cell.records, PRINTED) for cell in cells])
    scores = [[millionths((cell.scores or {})[measure]) for cell in cells] for measure in PRINTED]
    contest = [k for k, row in enumerate(rows) if row.family != CONTROL and cells[k].is_complete]
    best = [max(contest, key=lambda k: (of_rows[k], -k)) for of_rows in scores] if contest else []
    low, high, found = _judged(columns, labels, contest, best)
    probabilities = {(m, k): value for m, k, value in found}
    return {
        (row.method, input_, measure): FigureSignificance(
            low[m][k],
            high[m][k],
            is_best=[k] == best[m : m + 1],
            probability=probabilities.get((m, k)),
            is_tied=cells[k].n_tied > 0,
        )
        for m, measure in enumerate(PRINTED)
        for k, row in enumerate(rows)
    }


def _judged(
    columns: NDArray[np.float64],
    labels: Sequence[str],
    contest: Sequence[int],
    best: Sequence[int],
) -> tuple[Any, Any, list[tuple[int, int, float]]]:
    """Return lower and upper ends by measure and row, and the probability of each pair of a measure and a row."""
    shape = len(PRINTED), len(columns[0]) // len(PRINTED)
    low, high = intervals(columns, labels).T.reshape(2, *shape).tolist()
    return low, high, _against(columns.reshape(len(labels), *shape), contest, best)


def _against(columns: NDArray[np.float64], contest: Sequence[int], best: Sequence[int]) -> list[tuple[int, int, float]]:
    """Measure, row, and the adjusted probability of that row against the best one, for all other rows of the contest.

    Parameters
    ----------
    columns
        Shape (queries, measures, rows).
    contest
        The rows.
    best
        The best of them, by measure.
    """
    pairs = [(m, k) for m, first in enumerate(best) for k in contest if k != first]
    if not pairs:
        return []
    measure, other = np.array(pairs).T
    first = np.array(best)[measure]
    differences = columns[:, measure, other] - columns[:, measure, first]
    found = permutation_test(differences).reshape(len(best), -1)
    adjusted = chain.from_iterable(holm(of_rows) for of_rows in found.tolist())
    return [(m, k, value) for (m, k), value in zip(pairs, adjusted, strict=True)]


def _columns(queries: Sequence[Queries]) -> tuple[NDArray[np.float64], list[str]]:
    """A column for each measure and each row of the table within it, and the classes of all queries that some row has.

    A query without a result finds nothing.
    """
    labels: dict[tuple[str, str], str] = {}
    for each in queries:
        labels |= zip(each.names, each.labels, strict=True)
    place = {name: k for k, name in enumerate(labels)}
    columns = np.zeros((len(labels), len(queries[0].values), len(queries)))
    for row, each in enumerate(queries):
        columns[[place[name] for name in each.names], :, row] = np.stack([*each.values.values()], axis=1)
    return columns.reshape(len(labels), -1), list(labels.values())


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
