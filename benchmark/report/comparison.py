"""Differences of a row to others of its tables, query by query, with the test that marks the tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from pandas import DataFrame, Series, concat

from benchmark.errors import ConfigurationError
from benchmark.reference.paper import MEASURES
from benchmark.report.statistics import (
    ALPHA,
    FEWEST_CLASSES,
    class_intervals,
    permutation_test,
    sign_flip_test,
)
from benchmark.report.tables import SAME, Row, TableView, least_difference

#: Verdict on a difference with p < .05 that is larger than codebooks and trainings scatter.
ABOVE = "significant, above the scatter"

ALONE, AMONG = "planned alone", "among the {} rows of the table"
_TEST = "studentised permutation test over whole classes, of all measures"
LEGEND = (
    "low, high: nominal 95 % interval over classes, too narrow where few classes differ. "
    f"{ALONE.capitalize()}: if only these two rows were ever meant to be compared; the signs of whole classes are "
    f"flipped. {AMONG.format('n').capitalize()}: {_TEST} and pairs of rows of their blocks, as in tables."
)


def compare(views: Sequence[TableView], first: str, second: str = "") -> DataFrame:
    """Return the differences of a row to another one, or to all rows of its tables in their order; a line a measure.

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
        ``place`` (table and column), ``method``, ``other``, ``title`` of the other row,
        ``measure``, ``score``, ``other_score``, ``difference``, ``low`` and ``high`` (its
        interval), ``p``, ``verdict`` (``"significant, above the scatter"``, ``"significant, within
        the scatter of codebooks"``, ``"not significant (9 classes)"``, or why there is none) among
        the ``rows`` tested at once, ``p_alone`` and ``verdict_alone`` of the two planned alone, and
        numbers: ``queries``, those ``differing`` and those left out because they were ``seen`` in
        training, and ``classes``.

    Raises
    ------
    ConfigurationError
        If a row has no scores, or no table has scores of both.
    """
    known = {row.method for view in views for row in view.rows if row.scored}
    for name in filter(None, (first, second)):
        if name not in known:
            old = [
                text for view in views for text in view.left_out if text.startswith(f"{name} on ")
            ]
            what = f"{old[0]} ranks another version of the data" if old else f"{name} has no scores"
            raise ConfigurationError(what, f"run it, or choose among {', '.join(sorted(known))}")
    found = [
        each
        for view in views
        for column in view.columns
        for each in _frames(view, column.title, first, second)
    ]
    if not found:
        what = f"no table has scores of both {first} and {second or 'another method'}"
        raise ConfigurationError(what, "run both on one data set")
    return concat(found, ignore_index=True)


def _frames(view: TableView, column: str, first: str, second: str) -> Iterator[DataFrame]:
    """Yield the differences to each other row in a column of a table."""
    rows = {row.method: row for row in view.rows if column in row.scored}
    identifier, tested = view.table.identifier, dict[Any, Any]()
    table = view.dataset if identifier == view.dataset else f"Table {identifier} on {view.dataset}"
    place = f"{table}, {column}{view.by.caption}"
    for name in rows if first in rows else ():
        if name in ({second} if second else rows.keys() - {first}):
            names = {"place": place, "method": first, "other": name, "title": rows[name].title}
            yield DataFrame(
                names | _differences(rows, column, first, name, tested, quick=view.quick)
            )


def _differences(
    rows: Mapping[str, Row],
    column: str,
    first: str,
    second: str,
    tested: dict[Any, Any],
    *,
    quick: bool,
) -> dict[str, Any]:
    """Return the differences of two rows, tested among all rows of their blocks that have a result for each shape."""
    pair = mine, other = [rows[name].scored[column] for name in (first, second)]
    seen, kinds = mine.seen_classes | other.seen_classes, {rows[first].kind, rows[second].kind}
    shared = min(
        mine.labels, other.labels, key=len
    )  # of several galleries, networks rank the first
    judged = [place for place, label in enumerate(shared) if label not in seen]
    labels = [shared[place] for place in judged]
    names = [
        name
        for name, row in rows.items()
        if name in (first, second) or (row.kind in kinds and row.scored[column].is_rival(seen))
    ]
    a, b = names.index(first), names.index(second)
    if (family := (seen, *names)) not in tested:
        tested[family] = permutation_test(
            [rows[name].scored[column].values[judged] for name in names], labels
        )
    scores = [one.values[judged].sum(axis=0) / max(1, len(judged)) for one in pair]
    gains = mine.values[judged] - other.values[judged]
    p_values = {"": tested[family][a, b], "_alone": sign_flip_test(gains, labels)}
    n_classes, (least, why) = (
        len(set(labels)),
        least_difference([rows[name].scored[column] for name in names]),
    )
    undecided = "incomplete" if mine.missing or other.missing else "not decided (quick run)" * quick
    undecided = undecided or f"not decidable ({n_classes} classes)" * (n_classes < FEWEST_CLASSES)
    ends = class_intervals(gains, labels, are_gains=True)
    small = np.abs(scores[0] - scores[1]) <= least + SAME
    verdicts = {
        f"verdict{test}": undecided
        or np.where(
            p >= ALPHA,
            f"not significant ({n_classes} classes)",
            np.where(small, f"significant, {why}", ABOVE),
        )
        for test, p in p_values.items()
    }
    return {
        "measure": MEASURES,
        "score": scores[0],
        "other_score": scores[1],
        "difference": scores[0] - scores[1],
        "low": ends[:, 0],
        "high": ends[:, 1],
        **{f"p{test}": p for test, p in p_values.items()},
        **verdicts,
        "rows": len(names),
        "queries": len(judged),
        "differing": np.count_nonzero(np.abs(gains).max(axis=1, initial=0) > SAME),
        "seen": len(shared) - len(judged),
        "classes": n_classes,
    }


def details(frame: DataFrame) -> Iterator[str]:
    """Yield the comparison of two rows as text: a heading for each column of a table, and a line for each measure."""
    yield f"{frame.method[0]} - {frame.other[0]}"
    for place, of_pair in frame.groupby("place", sort=False):
        first = of_pair.iloc[0]
        seen = f"; {first.seen} queries are of classes seen in training" * bool(first.seen)
        yield f"{place}: {first.differing} of {first.queries} queries differ{seen}"
        figures = of_pair[["measure", "score", "other_score", "difference", "low", "high"]].assign(
            alone=_with_p(of_pair.verdict_alone, of_pair.p_alone),
            among=_with_p(of_pair.verdict, of_pair.p),
        )
        names = [
            first.method,
            first.other,
            "difference",
            "low",
            "high",
            ALONE,
            AMONG.format(first["rows"]),
        ]
        lines = figures.to_string(
            index=False, header=["", *names], float_format="{:.3f}".format, na_rep=""
        )
        yield from lines.splitlines() if first.queries else ()
    if frame.p.notna().any():
        yield LEGEND


def _with_p(verdicts: Series, p_values: Series) -> list[str]:
    texts = [f" (p {p:.3f})" if p >= 0 else "" for p in p_values]  # NaN is not
    return [verdict + text for verdict, text in zip(verdicts, texts, strict=True)]


def summaries(frame: DataFrame) -> Iterator[tuple[str, list[list[str]]]]:
    """Yield the comparison with many rows: for each column of a table a heading, and a line for each row."""
    for place, of_column in frame.groupby("place", sort=False):
        rows = [
            [of_row.title.iloc[0], *map(_signed, of_row.difference), _verdict(of_row)]
            for _, of_row in of_column.groupby("other", sort=False)
        ]
        least, most = of_column["rows"].min(), of_column["rows"].max()
        among = AMONG.format(most if least == most else f"{least} to {most}")
        heading = (
            f"{place}: {frame.method[0]} - each row, {of_column.queries.max()} queries, {among}"
        )
        yield heading, [["", *of_column.measure.unique(), ""], *rows]


def _verdict(of_row: DataFrame) -> str:
    """Return the verdict on a row: which measures differ significantly and above the scatter, or why none does."""
    above = list(of_row.measure[of_row.verdict == ABOVE])
    if not above:
        return str(of_row.verdict.iloc[0])
    which = f" ({', '.join(above)})" if len(above) < len(of_row) else ""
    return f"{ABOVE}{which}"


def _signed(difference: float) -> str:
    return f"{round(difference, 2) + 0.0:+.2f}".replace("0.", ".", 1)
