"""Differences of a row to others of its tables, query by query, with the test that marks the tables."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from pandas import DataFrame, concat

from benchmark.errors import ConfigurationError
from benchmark.reference.paper import MEASURES
from benchmark.report.formats import latex_row, latex_table, latex_title
from benchmark.report.statistics import ALPHA, FEWEST_CLASSES, bootstrap_intervals, tukey_test
from benchmark.report.tables import Scored, TableView

#: Differences below half a unit of the last decimal of records are none.
_SAME = 5e-7

TEST = "randomised Tukey test of all measures, over whole classes"
LEGEND = f"low, high: 95 % interval of the difference over resampled classes. p: {TEST}."


def compare(views: Sequence[TableView], first: str, second: str = "") -> DataFrame:
    """Return the differences of a row to another one, or to all rows of its tables in their order; a line a measure.

    Compared are the queries of classes on which neither row was trained. Rows of a block are tested at once.

    Parameters
    ----------
    views
        The tables.
    first, second
        Names of the rows; "" compares with all others.

    Returns
    -------
    pandas.DataFrame
        ``place`` (table and column), ``method``, ``other``, ``title`` of the other row, ``measure``, ``score``,
        ``other_score``, ``difference``, ``low`` and ``high`` (95 % interval), ``p``, ``verdict`` (``"certain"``, ``"not
        distinguishable (9 classes)"``, or why there is none), and numbers: ``queries``, those ``differing`` and those
        left out because they were ``seen`` in training, and ``classes``.

    Raises
    ------
    ConfigurationError
        If a row has no scores, or no table has scores of both.
    """
    known = {row.method for view in views for row in view.rows if row.scored}
    for name in filter(None, (first, second)):
        if name not in known:
            old = [text for view in views for text in view.left_out if text.startswith(f"{name} on ")]
            what = f"{old[0]} ranks another version of the data" if old else f"{name} has no scores"
            raise ConfigurationError(what, f"run it, or choose among {', '.join(sorted(known))}")
    found = [each for view in views for column in view.columns for each in _frames(view, column.title, first, second)]
    if not found:
        what = f"no table has scores of both {first} and {second or 'another method'}"
        raise ConfigurationError(what, "run both on one data set")
    return concat(found, ignore_index=True)


def _frames(view: TableView, column: str, first: str, second: str) -> Iterator[DataFrame]:
    """Yield the differences to each other row in a column of a table."""
    scored = {row.method: row.scored[column] for row in view.rows if column in row.scored}
    others = [row for row in view.rows if row.method in ({second} if second else scored.keys() - {first})]
    groups = defaultdict[Any, list[str]](list)
    for row in others:
        if {first, row.method} <= scored.keys():
            mine, other = scored[first], scored[row.method]
            is_incomplete = bool(mine.missing or other.missing)
            groups[row.kind, mine.seen_classes | other.seen_classes, is_incomplete].append(row.method)
    found: dict[str, dict[str, Any]] = {}
    for (_, seen, is_incomplete), names in groups.items():
        undecided = "incomplete" if is_incomplete else "not decided (quick run)" * view.quick
        rows = [scored[name] for name in (first, *names)]
        found |= zip(names, _differences(rows, seen, undecided), strict=True)
    identifier = view.table.identifier
    table = view.dataset if identifier == view.dataset else f"Table {identifier} on {view.dataset}"
    for row in others:
        if row.method in found:
            names_of = {"method": first, "other": row.method, "title": row.title}
            yield DataFrame({"place": f"{table}, {column}"} | names_of | found[row.method])


def _differences(rows: Sequence[Scored], seen: frozenset[str], undecided: str) -> Iterator[dict[str, Any]]:
    """Yield the differences of the first row to each other one, tested at once unless all are undecided."""
    judged = [place for place, label in enumerate(rows[0].labels) if label not in seen]
    labels = [rows[0].labels[place] for place in judged]
    n_classes = len(set(labels))
    if n_classes < FEWEST_CLASSES:
        undecided = undecided or f"not decidable ({n_classes} classes)"
    values = np.array([row.values[judged] for row in rows])
    means, p_values = values.sum(axis=1) / max(1, len(judged)), tukey_test(values, labels)[0]
    for other, mean, p in list(zip(values, means, p_values, strict=True))[1:]:
        gains, ends = values[0] - other, np.full((len(p), 2), np.nan)
        if n_classes >= FEWEST_CLASSES:
            ends = bootstrap_intervals(gains, labels, 0.95)
        decided = np.where(p < ALPHA, "certain", f"not distinguishable ({n_classes} classes)")
        yield {
            "measure": MEASURES, "score": means[0], "other_score": mean, "difference": means[0] - mean,
            "low": ends[:, 0], "high": ends[:, 1], "p": p, "verdict": undecided or decided, "queries": len(judged),
            "differing": np.count_nonzero(np.abs(gains).max(axis=1, initial=0) > _SAME),
            "seen": len(rows[0].labels) - len(judged), "classes": n_classes,
        }  # fmt: skip


def details(frame: DataFrame) -> Iterator[str]:
    """Yield the comparison of two rows as text: a heading for each column of a table, and a line for each measure."""
    yield f"{frame.method[0]} - {frame.other[0]}"
    for place, of_pair in frame.groupby("place", sort=False):
        first = of_pair.iloc[0]
        seen = f"; {first.seen} queries are of classes seen in training" * bool(first.seen)
        yield f"{place}: {first.differing} of {first.queries} queries differ{seen}"
        figures = of_pair[["measure", "score", "other_score", "difference", "low", "high", "p", "verdict"]]
        names = [first.method, first.other, "difference", "low", "high", "p", "verdict"]
        lines = figures.to_string(index=False, header=["", *names], float_format="{:.3f}".format, na_rep="")
        yield from lines.splitlines() if first.queries else ()
    if frame.p.notna().any():
        yield LEGEND


def summaries(frame: DataFrame) -> Iterator[tuple[str, list[list[str]]]]:
    """Yield the comparison with many rows: for each column of a table a heading, and a line for each row."""
    for place, of_column in frame.groupby("place", sort=False):
        rows = [
            [of_row.title.iloc[0], *map(_signed, of_row.difference), _verdict(of_row)]
            for _, of_row in of_column.groupby("other", sort=False)
        ]
        yield f"{place}: {frame.method[0]} - each row, {of_column.queries.max()} queries", [["", *MEASURES, ""], *rows]


def latex(frame: DataFrame) -> str:
    """Return the differences as LaTeX, a table for each column of a table."""
    columns = r">{\raggedright\hangindent1em}p{\dimexpr\linewidth-21em-17pt\relax}*{4}{w{c}{1.9em}}w{l}{13.4em}"
    tables = []
    for number, (heading, rows) in enumerate(summaries(frame)):
        body, notes = [latex_row(*rows[0]), r"\midrule"], f"Verdicts: {TEST}."
        for title, *differences, verdict in rows[1:]:
            body.append(latex_row(latex_title(title), *(f"${text}$" for text in differences), verdict))
        tables.append(latex_table(f"Differences in {heading}", f"compare-{number}", columns, body, notes))
    return "\n".join(tables)


def _verdict(of_row: DataFrame) -> str:
    """Return the verdict on a row: which measures differ with certainty, or why none does."""
    certain = list(of_row.measure[of_row.verdict == "certain"])
    which = f" ({', '.join(certain)})" if len(certain) < len(of_row) else ""
    return f"certain{which}" if certain else str(of_row.verdict.iloc[0])


def _signed(difference: float) -> str:
    return f"{round(difference, 2) + 0.0:+.2f}".replace("0.", ".", 1)
