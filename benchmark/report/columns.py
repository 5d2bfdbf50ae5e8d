"""Columns of tables: what each is called, and the value and the text of a row in it.

Markdown, LaTeX, JSON, HTML and data frames iterate over these; none has headings, counts or cells
of its own. ``scores.csv`` has one score a line instead, a :class:`Score`. A quantity that is
measured on each job is a line of :data:`QUANTITIES`.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from benchmark.pipeline.records import Record
from benchmark.protocols.tables import TABLE_MEASURES
from benchmark.reference.paper import PRINTED
from benchmark.report.notation import BLANK, hundredths, two_digits
from benchmark.report.record_facts import block_of, fold_of, row_of, seconds_of, tables_of
from benchmark.report.rows import TableRow, ranked_classes
from benchmark.report.table_view import SECOND, TableView
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
        if value is None:
            return BLANK
        return self.text(value)


@dataclass(frozen=True)
class Group:
    """Columns of scores below one heading: those of the paper, or those of a gallery."""

    title: str
    columns: tuple[Column[TableRow], ...]


@dataclass(frozen=True)
class Place:
    """A row of a table in one of its groups."""

    view: TableView
    row: TableRow
    group: str

    @property
    def records(self) -> list[Record]:
        """Records with scores."""
        if self.group not in self.row.scored:
            return []
        return self.row.scored[self.group].all_records

    @property
    def status(self) -> str:
        """Whether it has scores; why not, otherwise."""
        if self.records:
            return "ok"
        if self.group in self.row.failed:
            return self.row.failed[self.group][0].status
        return "missing"

    def fact(self, name: str, default: Any) -> Any:
        """Return a fact that all of its records share, and a default without records."""
        if not self.records:
            return default
        return getattr(self.records[0], name)

    @property
    def n_shapes(self) -> int:
        """Number of queries of all galleries of the group."""
        return sum(len(labels) for labels in self._labels)

    @property
    def n_classes(self) -> int:
        """Number of classes of the queries, each counted once a gallery."""
        return sum(len(set(labels)) for labels in self._labels)

    @property
    def coverage(self) -> float | None:
        """The least share of shapes with a result over its records; None without records."""
        return min((record.coverage for record in self.records), default=None)

    @property
    def _labels(self) -> list[list[str]]:
        """Classes of the queries of each gallery of the group."""
        return [ranked_classes(sample) for sample in self.view.samples.get(self.group, ())]


def cells(columns: Iterable[Column[Item]], item: Item) -> list[str]:
    """Return the texts of a row."""
    return [column.cell(item) for column in columns]


def values(columns: Iterable[Column[Item]], item: Item) -> dict[str, Any]:
    """Return the values of a row by key."""
    return {column.key: column.value(item) for column in columns}


def data_frame(columns: Iterable[Column[Item]], items: Iterable[Item]) -> DataFrame:
    """Return rows as a data frame; a value that a row lacks is NaN."""
    from pandas import DataFrame

    every = [*items]
    return DataFrame({column.key: [*map(column.value, every)] for column in columns})


# What is measured on each job
# ------------------------------------------------------------------------------------------------

#: Quantities of a job, None where they were not measured: in a table for print if they have a
#: title, in JSON and in the data frame of jobs.
QUANTITIES: tuple[Column[Record], ...] = (
    Column(
        "seconds", partial(seconds_of, of_wall=True), unit="median wall-clock seconds per shape"
    ),
    Column(
        "processor_seconds",
        seconds_of,
        title="s",
        unit="median processor seconds per shape for form and geodesics",
        text=two_digits,
    ),
)


def median(column: Column[Record]) -> Column[TableRow]:
    """Return a column of records as one of rows: the median over the jobs of a row."""

    def value(row: TableRow) -> float | None:
        of_jobs = [column.value(record) for record in row.records]
        measured = [number for number in of_jobs if number is not None]
        if not measured:
            return None
        return round(float(statistics.median(measured)), 4)

    return Column(column.key, value, column.title, column.unit, column.text)


#: The same of the rows of a table.
QUANTITIES_OF_ROW = tuple(map(median, QUANTITIES))

#: Those that stand in tables for print.
PRINTED_QUANTITIES = tuple(column for column in QUANTITIES_OF_ROW if column.title)


# Scores
# ------------------------------------------------------------------------------------------------


def score_groups(view: TableView) -> list[Group]:
    """Return the columns of the scores of a table by group."""
    return [Group(title, _columns_of_group(view, title)) for title in view.groups]


def _columns_of_group(view: TableView, group: str) -> tuple[Column[TableRow], ...]:
    """Return a column for each measure of a group."""
    return tuple(_score_in_group(view, group, measure) for measure in view.measures_of(group))


def _score_in_group(view: TableView, group: str, measure: str) -> Column[TableRow]:
    """Return the column of a measure of a group."""

    def value(row: TableRow) -> float | None:
        return view.scores(row, group).get(measure)

    text = str if group == SECOND else hundredths
    return Column(measure, value, measure, MEASURES[measure].definition, text)


def _score_of_record(measure: str) -> Column[Record]:
    """Return the column of a measure of records."""

    def value(record: Record) -> float | None:
        return record.scores.get(measure)

    return Column(measure, value, measure, MEASURES[measure].definition, hundredths)


#: Scores of a record in all measures, and in those of the tables.
SCORES = tuple(map(_score_of_record, MEASURES))
PRINTED_SCORES = tuple(map(_score_of_record, TABLE_MEASURES))


# Data frames, CSV and JSON
# ------------------------------------------------------------------------------------------------

#: Columns of the data frame of jobs.
JOBS: tuple[Column[Record], ...] = (
    Column("dataset", lambda record: record.data.name),
    Column("fold", fold_of),
    Column("quick", lambda record: record.data.quick),
    Column("kind", block_of),
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
    *QUANTITIES,
    Column("machine", lambda record: "; ".join(record.machines) or "unknown"),
)


def _rounded_score(measure: str) -> Column[Place]:
    """Return the column of a measure of a row in a group, in the six decimals of records."""

    def value(place: Place) -> float | None:
        score = place.view.scores(place.row, place.group).get(measure)
        if score is None:
            return None
        return round(score, 6)

    return Column(measure, value)


def _of_row(column: Column[TableRow]) -> Column[Place]:
    """Return a column of rows as one of rows in a group."""
    return Column(column.key, lambda place: column.value(place.row))


#: Keys of ``tables --format json``, on which other programs rely.
OBJECTS: tuple[Column[Place], ...] = (
    Column("table", lambda place: place.view.table.identifier),
    Column("dataset", lambda place: place.view.dataset),
    Column("stand_in", lambda place: bool(place.view.sample.data.stand_in_for)),
    Column("column", lambda place: place.group),
    Column("scorer", lambda place: place.fact("scorer", "")),
    Column("seed", lambda place: place.fact("seed", None)),
    Column("input", lambda place: place.fact("input", "")),
    Column("method", lambda place: place.row.method),
    Column("title", lambda place: place.row.title),
    *map(_rounded_score, TABLE_MEASURES),
    Column("paper", lambda place: place.view.paper.get(place.row.method)),
    Column("chance", lambda place: place.view.chance.get(place.group)),
    Column("status", lambda place: place.status),
    Column("n_shapes", lambda place: place.n_shapes),
    Column("n_classes", lambda place: place.n_classes),
    Column("coverage", lambda place: place.coverage),
    *map(_of_row, QUANTITIES_OF_ROW),
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

    Parameters
    ----------
    records
        Records of finished jobs.

    Returns
    -------
    pandas.DataFrame
        ``table``, ``dataset``, ``method``, ``input`` (``"mesh"``, ``"view"``, or ``"paper"`` for
        what it prints), ``scorer`` ("" for descriptors, and for the paper), ``seed``, ``fold``
        (part of the data set; "" for the whole one), ``measure``, ``value``: the mean over queries,
        and over seeds of a training.
    """
    from pandas import DataFrame

    scores: list[Score] = []
    versions: list[str] = []  # of the data of each score, of which none is averaged with another
    with_paper: set[tuple[str, str]] = set()  # table and data set, if the paper has scores
    for record in records:
        dataset = record.data.name
        for table in tables_of(dataset, fold_of(record)):
            # A table of queries in another gallery repeats no scores of shapes in their own one.
            if table.is_cross and not record.gallery_of_queries:
                continue
            of_record = list(_scores_of_record(table.identifier, record))
            scores += of_record
            versions += [record.gallery_digest] * len(of_record)
            if table.has_paper:
                with_paper.add((table.identifier, dataset))
    for numeral, dataset in sorted(with_paper):
        of_paper = list(_scores_of_paper(numeral, dataset))
        scores += of_paper
        versions += [""] * len(of_paper)
    frame = DataFrame(scores, columns=Score._fields).assign(version=versions)
    # A mean over lines that differ in the value alone: they are of several trainings of a network.
    *all_but_value, value = Score._fields
    means = frame.groupby([*all_but_value, "version"], sort=False, as_index=False)[value].mean()
    return means[[*Score._fields]]


def _scores_of_record(table: str, record: Record) -> Iterator[Score]:
    """Yield one line for each measure that a record holds.

    Parameters
    ----------
    table
        Identifier of the table, such as ``"III"``.
    record
        Record of a finished job; its scores are means over queries.
    """
    for measure, value in record.scores.items():
        yield Score(
            table=table,
            dataset=record.data.name,
            method=row_of(record),
            input=record.input,
            scorer=record.scorer,
            seed=record.seed,
            fold=fold_of(record),
            measure=measure,
            value=value,
        )


def _scores_of_paper(numeral: str, dataset: str) -> Iterator[Score]:
    """Yield the scores that the paper prints in a table, as lines of a data set."""
    for method, scores in PRINTED[numeral].items():
        for measure, value in scores.items():
            yield Score(numeral, dataset, method, "paper", "", "", "", measure, value)
