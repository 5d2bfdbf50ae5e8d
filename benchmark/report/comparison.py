"""Differences of a row to others, query by query, with the test that marks the tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame, Series, concat

from benchmark.errors import ConfigurationError, short_reason
from benchmark.pipeline.records import Record
from benchmark.report.notation import signed_hundredths
from benchmark.report.rivals import SAME, scatter_of
from benchmark.report.rows import RowScores, TableRow
from benchmark.report.statistics import (
    ALPHA,
    FEWEST_CLASSES,
    class_intervals,
    permutation_test,
    sign_flip_test,
)
from benchmark.report.table_view import TableView
from benchmark.text import brief, counted

#: Verdict on a difference with p < .05 that is larger than codebooks and trainings scatter.
ABOVE = "significant, above the scatter"

#: Headings of the verdicts of both tests.
ALONE = "planned alone"
AMONG = "among the {} rows"

#: What the columns of a comparison of two rows mean, a sentence each.
LEGEND = (
    "95 % interval: nominal, over classes; too narrow where few classes differ.",
    "planned alone: if only these two rows were ever meant to be compared; the signs of whole "
    "classes are flipped.",
    "among the n rows: studentised permutation test over whole classes, of all measures and pairs "
    "of rows of their blocks, as in tables.",
)


def compare_rows(views: Sequence[TableView], first: str, second: str = "") -> DataFrame:
    """Return the differences of a row to another one, or to all rows of its tables in their order.

    Compared are the queries of classes on which neither row was trained. A verdict does not depend
    on which of the two is named first, or whether others are: it is that of all rows of their
    blocks.

    Parameters
    ----------
    views
        The tables.
    first, second
        Names of the rows; "" compares with all others.

    Returns
    -------
    pandas.DataFrame
        A line a measure: ``place`` (table and column), ``method``, ``other``, ``title`` of the
        other row, ``measure``, ``score``, ``other_score``, ``difference``, ``low`` and ``high``
        (its interval), ``p``, ``verdict`` (``"significant, above the scatter"``, ``"significant,
        within the scatter of codebooks"``, ``"not significant (9 classes)"``, or why there is none)
        among the ``rows`` tested at once, ``p_alone`` and ``verdict_alone`` of the two planned
        alone, and numbers: ``queries``, those ``differing`` and those left out because they were
        ``seen`` in training, ``classes``, and shapes that one of the two ``refused``, which count
        0.

    Raises
    ------
    ConfigurationError
        If a row has no scores or is compared with itself, or no table has scores of both.
    """
    if first == second:
        problem = f"{first} cannot be compared with itself"
        raise ConfigurationError(problem, "name another method, or none to compare with all")
    _check_have_scores(views, filter(None, (first, second)))
    frames: list[DataFrame] = []
    for view in views:
        for column in view.columns:
            frames += _frames(view, column.title, first, second)
    if not frames:
        problem = f"no table has scores of both {first} and {second or 'another method'}"
        raise ConfigurationError(problem, "run both on one data set")
    return concat(frames, ignore_index=True)


def _check_have_scores(views: Iterable[TableView], names: Iterable[str]) -> None:
    """Check that each compared method has scores in at least one table.

    Parameters
    ----------
    views
        The tables that are compared.
    names
        Names of methods.

    Raises
    ------
    ConfigurationError
        If a method has none, or only scores of another version of the data.
    """
    with_scores: set[str] = set()
    failures: dict[str, Record] = {}  # a job without scores by its method
    of_other_data: list[str] = []  # such as "gps on tosca, mesh"
    for view in views:
        of_other_data += view.left_out
        for row in view.rows:
            if row.scored:
                with_scores.add(row.method)
            for records in row.failed.values():
                failures[row.method] = records[0]
    for name in names:
        if name in with_scores:
            continue
        problem = f"{name} has no scores"
        if name in failures:
            failed = failures[name]
            problem = f"{problem} ({failed.status}: {brief(short_reason(failed.reason))})"
        other_data = [text for text in of_other_data if text.startswith(f"{name} on ")]
        if other_data:
            problem = f"{other_data[0]} ranks another version of the data"
        choices = f", or choose among {', '.join(sorted(with_scores))}" if with_scores else ""
        raise ConfigurationError(problem, f"run it{choices}")


def _frames(view: TableView, column: str, first: str, second: str) -> Iterator[DataFrame]:
    """Yield how a method differs from others in one column of a table, one frame per pair.

    Parameters
    ----------
    view
        The table.
    column
        Title of the column.
    first
        Name of the method. If it has no scores in the column, nothing is yielded.
    second
        Name of the only method to compare it with; "" for all.
    """
    rows = {row.method: row for row in view.rows if column in row.scored}
    if first not in rows:
        return
    others = [name for name in rows if name != first]
    if second:
        others = [name for name in rows if name == second]

    table = f"Table {view.table.identifier} on {view.dataset}"
    if view.is_of_own_data:
        table = view.table.identifier
    place = f"{table}, {column}{view.scored_by.caption}"
    tests = _Tests({name: row.scored[column] for name, row in rows.items()})
    for name in others:
        pair = _Pair(rows, column, first, name, tests, view.quick)
        facts = {"place": place, "method": first, "other": name, "title": rows[name].title}
        yield DataFrame(facts | pair.differences())


@dataclass
class _Tests:
    """Tests of the rows of a column; several pairs share one.

    Parameters
    ----------
    scores
        Scores of the rows by method.
    """

    scores: Mapping[str, RowScores]
    _p_values: dict[Any, NDArray[np.float64]] = field(default_factory=dict)

    def p_values(
        self, names: Sequence[str], seen: frozenset[str], queries: Sequence[int], labels: list[str]
    ) -> NDArray[np.float64]:
        """Return the p-values of all differences between some rows, shape (rows, rows, measures).

        Parameters
        ----------
        names
            The rows.
        seen
            Classes that are left out.
        queries, labels
            Numbers of the queries of all others, and their classes.
        """
        family = (seen, *names)
        if family not in self._p_values:
            values = [self.scores[name].values[queries] for name in names]
            self._p_values[family] = permutation_test(values, labels)
        return self._p_values[family]


@dataclass(frozen=True)
class _Pair:
    """Two rows in a column, compared among all rows of their blocks that lack no shape.

    Parameters
    ----------
    rows
        The rows with scores in the column, by method.
    column
        Title of the column.
    first, second
        Methods of the two.
    tests
        Tests of the rows.
    quick
        Whether they are of quick runs, which decide nothing.
    """

    rows: Mapping[str, TableRow]
    column: str
    first: str
    second: str
    tests: _Tests
    quick: bool

    @property
    def mine(self) -> RowScores:
        """Scores of the first row."""
        return self.rows[self.first].scored[self.column]

    @property
    def other(self) -> RowScores:
        """Scores of the second row."""
        return self.rows[self.second].scored[self.column]

    @cached_property
    def seen(self) -> frozenset[str]:
        """Classes on which one of them was trained."""
        return self.mine.seen_classes | self.other.seen_classes

    @cached_property
    def shared(self) -> Sequence[str]:
        """Classes of the queries of both; of several galleries, networks rank the first."""
        return min(self.mine.labels, self.other.labels, key=len)

    @cached_property
    def queries(self) -> list[int]:
        """Numbers of the queries that are compared."""
        return [number for number, label in enumerate(self.shared) if label not in self.seen]

    @cached_property
    def labels(self) -> list[str]:
        """Their classes."""
        return [self.shared[number] for number in self.queries]

    @cached_property
    def family(self) -> list[str]:
        """Methods of the rows that are tested at once."""
        blocks = {self.rows[self.first].kind, self.rows[self.second].kind}
        names = []
        for name, row in self.rows.items():
            is_rival = row.kind in blocks and row.scored[self.column].is_rival(self.seen)
            if name in (self.first, self.second) or is_rival:
                names.append(name)
        return names

    def differences(self) -> dict[str, Any]:
        """Return how the two methods differ on the queries that neither was trained on.

        Returns
        -------
        dict
            Columns of a frame with one line per measure: both scores, their difference with the
            ends of its interval (``low``, ``high``), p-values and verdicts; and numbers of rows,
            queries and classes, which are the same in all lines. ``p`` is from a test of all
            methods of the table at once, ``p_alone`` from a test of these two.
        """
        # Scores of the two methods for each query, shape (queries, measures).
        mine = self.mine.values[self.queries]
        other = self.other.values[self.queries]
        gains = mine - other
        n_queries = len(self.queries)
        score = mine.sum(axis=0) / max(1, n_queries)
        other_score = other.sum(axis=0) / max(1, n_queries)

        # P-values of all pairs of methods, of which one is this pair.
        p_values = self.tests.p_values(self.family, self.seen, self.queries, self.labels)
        p = p_values[self.family.index(self.first), self.family.index(self.second)]
        p_alone = sign_flip_test(gains, self.labels)
        ends = class_intervals(gains, self.labels, are_gains=True)
        return {
            "measure": self.mine.measures,
            "score": score,
            "other_score": other_score,
            "difference": score - other_score,
            "low": ends[:, 0],
            "high": ends[:, 1],
            "p": p,
            "p_alone": p_alone,
            "verdict": self._verdicts(p, score - other_score),
            "verdict_alone": self._verdicts(p_alone, score - other_score),
            "rows": len(self.family),
            "queries": n_queries,
            "differing": np.count_nonzero(np.abs(gains).max(axis=1, initial=0) > SAME),
            "seen": len(self.shared) - n_queries,
            "classes": len(set(self.labels)),
            "refused": self._count_refused_by_one(),
        }

    def _count_refused_by_one(self) -> int:
        """Return how many shapes have a result by one of the two alone, in galleries of both."""
        shared = self.mine.records.keys() & self.other.records.keys()
        return len(self.mine.refused_in(shared) ^ self.other.refused_in(shared))

    def _verdicts(
        self, p_values: NDArray[np.float64], differences: NDArray[np.float64]
    ) -> str | NDArray[np.str_]:
        """Return in words what a test says of the differences.

        Parameters
        ----------
        p_values, differences
            P-value, and difference of the mean scores, of each measure.

        Returns
        -------
        str or numpy.ndarray
            One text per measure: not significant, significant but within the scatter of repeated
            codebooks or trainings, or above it. If nothing can be decided, a single text says why.
        """
        n_classes = len(set(self.labels))
        if self.mine.missing or self.other.missing:
            return "incomplete"
        if self.quick:
            return "not decided (quick run)"
        if n_classes < FEWEST_CLASSES:
            return f"not decidable ({n_classes} classes)"
        scatter = scatter_of([self.rows[name].scored[self.column] for name in self.family])
        is_small = np.abs(differences) <= scatter.largest + SAME
        significant = np.where(is_small, f"significant, {scatter.where}", ABOVE)
        return np.where(p_values >= ALPHA, f"not significant ({n_classes} classes)", significant)


# As text
# ------------------------------------------------------------------------------------------------


def details(frame: DataFrame) -> Iterator[tuple[str, list[list[list[str]]]]]:
    """Yield the comparison of two rows: for each column a heading, the scores and the verdicts.

    Scores and verdicts are two tables with a line a measure, because one would be too wide for a
    terminal.
    """
    for place, of_pair in frame.groupby("place", sort=False):
        first = of_pair.iloc[0]
        seen = f"; {first.seen} queries are of classes seen in training" if first.seen else ""
        refused = f"; {_refusals(first.refused)}" if first.refused else ""
        heading = f"{place}: {first.differing} of {first.queries} queries differ{seen}{refused}"
        tables = [_scores_of_measures(of_pair), _verdicts_of_measures(of_pair)]
        yield heading, tables if first.queries else []


def _scores_of_measures(of_pair: DataFrame) -> list[list[str]]:
    """Return the scores of two rows and their difference with its interval, a line a measure."""
    lines = [["", "A", "B", "A - B", "95 % interval"]]
    for row in of_pair.itertuples():
        interval = ""
        if not np.isnan(row.low):
            interval = f"{_thousandths(row.low)} to {_thousandths(row.high)}"
        scores = [f"{score:.3f}" for score in (row.score, row.other_score)]
        lines.append([row.measure, *scores, _thousandths(row.difference), interval])
    return lines


def _verdicts_of_measures(of_pair: DataFrame) -> list[list[str]]:
    """Return the p-values and verdicts on the differences by both tests, a line a measure."""
    among = AMONG.format(of_pair.iloc[0]["rows"])
    lines = [["", "p", ALONE, "p", among]]
    for row in of_pair.itertuples():
        alone = [_p_value(row.p_alone), row.verdict_alone]
        lines.append([row.measure, *alone, _p_value(row.p), row.verdict])
    return lines


def _thousandths(difference: float) -> str:
    """Return a difference of scores with its sign and three decimals."""
    rounded = round(difference, 3) + 0.0  # no "-0.000"
    return f"{rounded:+.3f}"


def _p_value(p: float) -> str:
    """Return a p-value as text; "" where there is none.

    One below the level of significance is not rounded up to it.
    """
    if np.isnan(p):
        return ""
    rounded = f"{p:.3f}"
    return f"<{ALPHA:.3f}" if p < ALPHA <= float(rounded) else rounded


def summaries(frame: DataFrame) -> Iterator[tuple[str, list[list[str]]]]:
    """Yield the comparison with many rows: for each column a heading, and a line for each row."""
    for place, of_column in frame.groupby("place", sort=False):
        lines = [["", *of_column.measure.unique(), ""]]
        for _, of_row in of_column.groupby("other", sort=False):
            differences = map(signed_hundredths, of_row.difference)
            verdict = _verdict(of_row)
            n_refused = of_row["refused"].iloc[0]
            if n_refused:
                verdict = f"{verdict}; {_refusals(n_refused)}"
            lines.append([of_row.title.iloc[0], *differences, verdict])
        numbers = _range(of_column.queries)
        among = AMONG.format(_range(of_column["rows"]))
        yield f"{place}: {frame.method[0]} - each row, {numbers} queries, {among}", lines


def _refusals(number: int) -> str:
    """Say how many shapes have no result by one of two rows."""
    return f"{counted(number, 'shape')} without a result by one of the two count 0"


def _range(numbers: Series) -> str:
    """Return the least and the greatest of some numbers as text; one number if they are equal."""
    least = numbers.min()
    most = numbers.max()
    if least == most:
        return str(most)
    return f"{least} to {most}"


def _verdict(of_row: DataFrame) -> str:
    """Return the strongest verdict on a row, and in which measures it holds unless in all."""
    verdicts: list[str] = list(of_row.verdict)
    significant = [verdict for verdict in verdicts if verdict.startswith("significant")]
    from_strongest = [ABOVE, *significant, verdicts[0]]
    strongest = next(verdict for verdict in from_strongest if verdict in verdicts)
    measures = list(of_row.measure[of_row.verdict == strongest])
    if len(measures) == len(of_row):
        return strongest
    return f"{strongest} ({', '.join(measures)})"
