"""Columns of tables: what each is called, and the value and the text of a row in it.

Markdown, LaTeX, CSV, JSON, HTML and data frames iterate over these; none has headings, counts or
cells of its own. A quantity that is measured on each job is a line of :data:`MEASURED`.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from benchmark.pipeline.records import Record
from benchmark.reference.paper import MEASURES as PRINTED_MEASURES
from benchmark.reference.paper import PRINTED
from benchmark.report.frames import (
    BLANK,
    fold_of,
    hundredths,
    kind_of,
    row_of,
    seconds_of,
    tables_of,
)
from benchmark.report.tables import SECOND, Row, TableView, ranked_classes
from retrieval.measures import MEASURES

if TYPE_CHECKING:
    from pandas import DataFrame

Item = TypeVar("Item")


@dataclass(frozen=True)
class Column(Generic[Item]):
    """A column of a table.

    Parameters
    ----------
    key
        Its name in CSV, JSON and data frames.
    value
        Returns the value of a row, such as a record; None if it has none.
    title
        Its heading in tables for print; "" for a column that these leave out.
    unit
        What its values are, in words.
    text
        Returns a value as it is printed.
    """

    key: str
    value: Callable[[Item], Any]
    title: str = ""
    unit: str = ""
    text: Callable[[Any], str] = str

    def cell(self, item: Item) -> str:
        """Return the text of a row; two hyphens where it has no value."""
        value = self.value(item)
        return BLANK if value is None else self.text(value)


@dataclass(frozen=True)
class Group:
    """Columns of scores below one heading: those of the paper, or those of a gallery."""

    title: str
    columns: tuple[Column[Row], ...]


@dataclass(frozen=True)
class Place:
    """A row of a table in one of its groups."""

    view: TableView
    row: Row
    group: str

    @property
    def records(self) -> list[Record]:
        """Records with scores."""
        return self.row.scored[self.group].all_records if self.group in self.row.scored else []

    @property
    def status(self) -> str:
        """Whether it has scores; why not, otherwise."""
        if self.records:
            return "ok"
        return self.row.failed[self.group][0].status if self.group in self.row.failed else "missing"

    @property
    def galleries(self) -> list[list[str]]:
        """Classes of the queries of each gallery of the group."""
        return [ranked_classes(sample) for sample in self.view.samples.get(self.group, ())]


def duration(seconds: float) -> str:
    """Return seconds in two digits."""
    if seconds < 1:
        return hundredths(seconds)
    return f"{seconds:.1f}" if seconds < 10 else f"{seconds:.0f}"


def cells(columns: Iterable[Column[Item]], item: Item) -> list[str]:
    """Return the texts of a row."""
    return [column.cell(item) for column in columns]


def values(columns: Iterable[Column[Item]], item: Item) -> dict[str, Any]:
    """Return the values of a row by key."""
    return {column.key: column.value(item) for column in columns}


def frame(columns: Iterable[Column[Item]], items: Iterable[Item]) -> DataFrame:
    """Return rows as a data frame; a value that a row lacks is NaN."""
    from pandas import DataFrame

    every = [*items]
    return DataFrame({column.key: [column.value(item) for item in every] for column in columns})


# What is measured on each job
# ------------------------------------------------------------------------------------------------

#: Quantities of a job, None where they were not measured: in a table for print if they have a
#: title, in JSON and in the data frame of jobs.
MEASURED: tuple[Column[Record], ...] = (
    Column(
        "seconds", partial(seconds_of, of_wall=True), unit="median wall-clock seconds per shape"
    ),
    Column(
        "processor_seconds",
        seconds_of,
        title="s",
        unit="median processor seconds per shape for form and geodesics",
        text=duration,
    ),
)


def median(column: Column[Record]) -> Column[Row]:
    """Return a column of records as one of rows: the median over the jobs of a row."""

    def value(row: Row) -> float | None:
        every = [column.value(record) for record in row.records]
        measured = [each for each in every if each is not None]
        return round(statistics.median(measured), 4) if measured else None

    return Column(column.key, value, column.title, column.unit, column.text)


#: The same of the rows of a table.
MEASURED_OF_ROW = tuple(map(median, MEASURED))

#: Those that stand in tables for print.
PRINTED_OF_ROW = tuple(column for column in MEASURED_OF_ROW if column.title)


# Scores
# ------------------------------------------------------------------------------------------------


def score_groups(view: TableView) -> list[Group]:
    """Return the columns of the scores of a table: the paper's, ours, and ranks by a second scorer."""
    return [
        Group(title, tuple(_score_in(view, title, name) for name in PRINTED_MEASURES))
        for title in view.groups
    ]


def _score_in(view: TableView, group: str, measure: str) -> Column[Row]:
    def value(row: Row) -> float | None:
        return view.scores(row, group).get(measure)

    text = str if group == SECOND else hundredths
    return Column(measure, value, measure, MEASURES[measure].definition, text)


def _score_of(measure: str) -> Column[Record]:
    def value(record: Record) -> float | None:
        return record.scores.get(measure)

    return Column(measure, value, measure, MEASURES[measure].definition, hundredths)


#: Scores of a record in all measures, and in those of the tables.
SCORES = tuple(map(_score_of, MEASURES))
PRINTED_SCORES = tuple(map(_score_of, PRINTED_MEASURES))


# Data frames, CSV and JSON
# ------------------------------------------------------------------------------------------------

#: Columns of the data frame of jobs.
JOBS: tuple[Column[Record], ...] = (
    Column("dataset", lambda record: record.data.name),
    Column("fold", fold_of),
    Column("quick", lambda record: record.data.quick),
    Column("kind", kind_of),
    Column("input", lambda record: record.input),
    Column("method", lambda record: record.method),
    Column("title", lambda record: record.title),
    Column("scorer", lambda record: record.scorer),
    Column("seed", lambda record: record.seed),
    Column("status", lambda record: record.status),
    Column("published", lambda record: record.published),
    Column("commit", lambda record: record.commit),
    Column("finished", lambda record: record.finished),
    Column("coverage", lambda record: record.coverage),
    Column("reason", lambda record: record.reason or record.refusals),
    *SCORES,
    Column("n_shapes", lambda record: len(record.shapes)),
    Column("n_classes", lambda record: len(set(record.labels))),
    *MEASURED,
    Column("machine", lambda record: "; ".join(record.machines) or "unknown"),
)


def _rounded(measure: str) -> Column[Place]:
    def value(place: Place) -> float | None:
        score = place.view.scores(place.row, place.group).get(measure)
        return None if score is None else round(score, 6)

    return Column(measure, value)


def _of_row(column: Column[Row]) -> Column[Place]:
    return Column(column.key, lambda place: column.value(place.row))


#: Keys of ``tables --format json``, on which other programs rely.
OBJECTS: tuple[Column[Place], ...] = (
    Column("table", lambda place: place.view.table.identifier),
    Column("dataset", lambda place: place.view.dataset),
    Column("stand_in", lambda place: "stand-in" in place.view.title),
    Column("column", lambda place: place.group),
    Column("scorer", lambda place: place.records[0].scorer if place.records else ""),
    Column("seed", lambda place: place.records[0].seed if place.records else None),
    Column("input", lambda place: place.records[0].input if place.records else ""),
    Column("method", lambda place: place.row.method),
    Column("title", lambda place: place.row.title),
    *map(_rounded, PRINTED_MEASURES),
    Column("paper", lambda place: place.view.paper.get(place.row.method)),
    Column("chance", lambda place: place.view.chance.get(place.group)),
    Column("status", lambda place: place.status),
    Column("n_shapes", lambda place: sum(map(len, place.galleries))),
    Column("n_classes", lambda place: sum(len(set(classes)) for classes in place.galleries)),
    Column(
        "coverage", lambda place: min((record.coverage for record in place.records), default=None)
    ),
    *map(_of_row, MEASURED_OF_ROW),
)


class Score(NamedTuple):
    """A line of ``scores.csv``, and of the data frame of scores."""

    table: str
    dataset: str
    method: str
    input: str
    scorer: str
    seed: int | str
    fold: str
    measure: str
    value: float


def scores_frame(records: Iterable[Record]) -> DataFrame:
    """Return all scores of all tables, one value a line, beside those that the paper prints.

    Returns
    -------
    pandas.DataFrame
        ``table``, ``dataset``, ``method``, ``input`` (``"mesh"``, ``"view"``, or ``"paper"`` for
        what it prints), ``scorer`` ("" for descriptors, and for the paper), ``seed``, ``fold``
        (part of the data set; "" for the whole one), ``measure``, ``value``: the mean over queries,
        and over seeds of a training.
    """
    from pandas import DataFrame

    found: list[Score] = []
    with_paper = set()
    for record in records:
        dataset, fold = record.data.name, fold_of(record)
        for table in tables_of(dataset, fold):
            if table.is_cross and not record.gallery_of_queries:
                continue  # it shows scores of another table
            found += _scores_in(table.identifier, record)
            if table.has_paper:
                with_paper.add((table.identifier, dataset))
    for numeral, dataset in sorted(with_paper):
        for method, figures in PRINTED[numeral].items():
            for measure, figure in figures.items():
                found.append(Score(numeral, dataset, method, "paper", "", "", "", measure, figure))
    *places, value = Score._fields
    every = DataFrame(found, columns=Score._fields)
    return every.groupby(places, sort=False, as_index=False)[value].mean()


def _scores_in(table: str, record: Record) -> Iterator[Score]:
    """Yield the scores of a record as lines of a table."""
    for measure, value in record.scores.items():
        yield Score(
            table,
            record.data.name,
            row_of(record),
            record.input,
            record.scorer,
            record.seed,
            fold_of(record),
            measure,
            value,
        )
