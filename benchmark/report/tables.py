"""Tables from records: which record stands in which table, row and column."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from benchmark.api.contracts import Input
from benchmark.api.parameters import format_value
from benchmark.pipeline.records import Record, RecordedModel
from benchmark.protocols.published_models import is_published, published_models
from benchmark.protocols.tables import (
    AVERAGED_PARAMETERS,
    FROZEN,
    ON_VIEWS,
    OWN_MODEL,
    RECIPE,
    RECIPE_AS_PRINTED,
    TABLE_MEASURES,
    TABLES,
    TITLES,
    Block,
    GalleryGroup,
    Table,
    gallery_name,
)
from benchmark.reference.paper import AS_PRINTED, PRINTED
from benchmark.registry.names import base_name
from benchmark.report.data_titles import data_title
from benchmark.report.record_facts import (
    ScoredBy,
    block_of,
    by_gallery,
    change_of,
    fold_of,
    of_newest_versions,
    row_name,
    row_of,
    scored_by,
    tables_of,
)
from benchmark.report.rows import BLOCKS, RowScores, TableRow, query_measures, ranked_classes
from benchmark.report.table_view import TableView
from benchmark.text import brief


def table_views(
    records: Iterable[Record],
    tables: Iterable[str] = (),
    methods: Iterable[str] = (),
    datasets: Iterable[str] = (),
    *,
    paper: bool = False,
) -> list[TableView]:
    """Return the tables that records fill, one for each table and data set.

    Parameters
    ----------
    records
        Records of one scorer and seed, one a job; see
        :func:`benchmark.report.record_facts.chosen_records`.
    tables
        Identifiers of tables; empty for all. Tables that accompany them are added.
    methods
        Methods whose rows are printed; empty for all. Marks and verdicts do not depend on it.
    datasets
        Names of data sets; empty for all.
    paper
        Whether to print methods of the paper that never ran.
    """
    records = list(records)
    wanted_tables = frozenset(tables)
    wanted_datasets = frozenset(datasets)
    printed_methods = frozenset(map(row_name, methods))
    by = scored_by(records)
    by_table = _records_by_table(records, wanted_tables, wanted_datasets)
    views = []
    for table, dataset in sorted(by_table, key=_order_of_table):
        of_table = _RecordsOfTable(table, dataset, by_table[table, dataset])
        view = _view(of_table, printed_methods, by, prints_unrun=paper)
        if any(row.scored or row.failed for row in view.rows):
            views.append(view)
    if wanted_datasets or not wanted_tables:
        return views
    # A table that was asked for by name alone is printed for one of the data sets that fill it.
    return [view for view in views if _is_preferred(view, views)]


def _records_by_table(
    records: Iterable[Record], wanted: frozenset[str], names: frozenset[str]
) -> dict[tuple[Table, str], list[Record]]:
    """Sort records by the table that they fill, and the data set that it is printed for.

    Parameters
    ----------
    records
        Records of all data sets.
    wanted
        Identifiers of tables; empty for all.
    names
        Names of data sets; empty for all. Damaged ones, such as ``tosca[noise=2]``, have to be
        named, as they stand in the table of robustness by default.

    Returns
    -------
    dict
        Records by table and name of the data set. If the table shows means over several data sets,
        such as random draws, it is the name of the first, if that has records.
    """
    records = list(records)
    known = {record.data.name for record in records}
    if names:
        known &= names
    by_table: dict[tuple[Table, str], list[Record]] = {}
    for record in records:
        name = record.data.name
        for table in tables_of(name, fold_of(record)):
            has_wanted_data = name in names
            if not names:  # views of a gallery are a change, too, but no damage
                has_wanted_data = table.is_cross or not change_of(name)
            is_wanted = not wanted or not wanted.isdisjoint({table.identifier, table.part_of})
            if has_wanted_data and is_wanted:
                first = next((draw for draw in table.stand_ins if draw in known), "")
                dataset = first if name in table.stand_ins else name
                by_table.setdefault((table, dataset), []).append(record)
    return dict(filter(_has_queries, by_table.items()))


def _has_queries(of_table: tuple[tuple[Table, str], list[Record]]) -> bool:
    """Return whether a table has records of queries, if it is one of queries and another gallery.

    Parameters
    ----------
    of_table
        The table and its data set, and its records.
    """
    (table, _), records = of_table
    return not table.is_cross or any(record.gallery_of_queries for record in records)


def _order_of_table(place: tuple[Table, str]) -> tuple[int, bool, str]:
    """Return what tables on data sets are sorted by: the paper's order, and official data first."""
    table, dataset = place
    number = TABLES.index(table) if table in TABLES else len(TABLES)
    return number, table.dataset != dataset, dataset


def _is_preferred(view: TableView, views: Sequence[TableView]) -> bool:
    """Return whether a table that was asked for is shown on this data.

    It is shown on the data on which rows ran here; if there are none, on the first ones, which are
    the official ones where they have records.
    """
    rivals = [other for other in views if other.table == view.table]
    here = [other for other in rivals if _ran_here(other)]
    return view in (here or rivals[:1])


def _ran_here(view: TableView) -> bool:
    """Return whether a row of a table has scores of jobs that ran here."""
    return any(row.scored and not row.is_published for row in view.rows)


# A table on one data set
# ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _RecordsOfTable:
    """The records of a table on a data set; those of other versions of the data are left out.

    Parameters
    ----------
    table
        The table.
    dataset
        Name of the data set, or of the first stand-in with records.
    every
        The records, of all versions of the data.
    """

    table: Table
    dataset: str
    every: Sequence[Record]

    @cached_property
    def current(self) -> dict[str, list[Record]]:
        """Records of the newest version of the data, by gallery."""
        return by_gallery(of_newest_versions(self.every))

    @cached_property
    def records(self) -> list[Record]:
        """All records of the newest version."""
        return [*chain.from_iterable(self.current.values())]

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the rows of other versions, each once."""
        others = [
            record
            for record in self.every
            if record.gallery_digest != self.samples[record.gallery].gallery_digest
        ]
        names = [f"{record.method} on {record.gallery}, {record.input}" for record in others]
        return tuple(dict.fromkeys(names))

    @cached_property
    def sample(self) -> Record:
        """A record of the data set itself, if there is one."""
        of_dataset = (record for record in self.records if record.data.name == self.dataset)
        return next(of_dataset, self.records[0])

    @cached_property
    def samples(self) -> dict[str, Record]:
        """A record of each gallery, which says which shapes this has."""
        return {gallery: records[0] for gallery, records in self.current.items()}

    @cached_property
    def labels(self) -> dict[str, list[str]]:
        """Classes of the queries of each gallery."""
        return {gallery: ranked_classes(record) for gallery, record in self.samples.items()}

    @cached_property
    def measures(self) -> tuple[str, ...]:
        """Measures of tables that all records with scores hold; older ones may lack a new one."""
        scored = [record.per_query for record in self.records if record.status == "ok"]
        held = set(TABLE_MEASURES).intersection(*scored)
        return tuple(measure for measure in TABLE_MEASURES if measure in held)

    @property
    def quick(self) -> bool:
        """Whether they are of quick runs."""
        return self.sample.data.quick

    @cached_property
    def galleries(self) -> dict[GalleryGroup, list[str]]:
        """Names of the galleries of each column."""
        return {column: self._galleries_of(column) for column in self.table.columns}

    def _galleries_of(self, column: GalleryGroup) -> list[str]:
        """Return the names of the galleries over which a column shows the mean.

        They are the folds of a data set, or those random draws of it that have records. A quick run
        has the first alone.
        """
        sets: tuple[str, ...] = (self.dataset,)
        may_be_left_out = self.quick
        if column.over_draws and self.dataset in self.table.stand_ins:
            sets = self.table.stand_ins
            may_be_left_out = True
        names = []
        for dataset in sets:
            for part in column.parts:
                name = gallery_name(dataset, part, quick=self.quick)
                if name in self.labels or not may_be_left_out:
                    names.append(name)
        return names

    def samples_of(self, column: GalleryGroup) -> list[Record]:
        """Return a record of each gallery of a column that has some."""
        return [self.samples[name] for name in self.galleries[column] if name in self.samples]


def _view(
    records: _RecordsOfTable, methods: frozenset[str], by: ScoredBy, *, prints_unrun: bool
) -> TableView:
    """Return one table with all of its rows, of which some may have no scores.

    Parameters
    ----------
    records
        The table, and the records that fill it.
    methods
        Names of the methods whose rows are printed; empty for all.
    by
        Scorer and seed of the records.
    prints_unrun
        Whether to print methods of the paper that never ran.
    """
    table = records.table
    printed: Mapping[str, Mapping[str, float]] = {}  # scores in the paper, by method
    if table.has_paper and not records.quick:
        printed = PRINTED[table.identifier]
    rows = _rows(records, printed, methods)
    samples = {column: records.samples_of(column) for column in table.columns}
    columns_with_records = [column for column in table.columns if samples[column]]
    return TableView(
        table=table,
        dataset=records.dataset,
        title=data_title(records.sample),
        quick=records.quick,
        columns=_columns(columns_with_records, rows, records.sample.input),
        measures=records.measures,
        samples={column.title: samples[column] for column in columns_with_records},
        rows=tuple(rows),
        paper=printed,
        methods=methods,
        left_out=records.left_out,
        scored_by=by,
        prints_unrun=prints_unrun,
    )


def _columns(
    known: Sequence[GalleryGroup], rows: Iterable[TableRow], input_: Input
) -> tuple[GalleryGroup, ...]:
    """Return the columns in which a row has scores; without any, one, if possible of an input."""
    titles = set(chain.from_iterable(row.scored for row in rows))
    scored = tuple(column for column in known if column.title in titles)
    if scored:
        return scored
    return tuple(sorted(known, key=lambda column: column.input != input_)[:1])


# Rows
# ------------------------------------------------------------------------------------------------


def _rows(
    records: _RecordsOfTable, printed: Collection[str], methods: frozenset[str]
) -> list[TableRow]:
    """Return the rows of a table in order; those that the paper prints need no records."""
    of_rows = {method: list[Record]() for method in printed}
    for record in records.records:
        if _has_row(record, records.table, methods):
            of_rows.setdefault(row_of(record), []).append(record)
    rows = [_row(method, of_row, records) for method, of_row in of_rows.items()]
    rows = [row for row in rows if row.scored or row.failed or row.method in printed]
    return _with_different_titles(_arranged(_excused(rows), [*printed, *TITLES]))


def _has_row(record: Record, table: Table, methods: frozenset[str]) -> bool:
    """Return whether a record has a row: of a method of the table, or one that was asked for."""
    base = base_name(record.method)
    is_asked_for = not methods.isdisjoint({base, row_of(record)})
    return table not in TABLES or table.includes(base) or is_asked_for


def _row(method: str, records: Sequence[Record], of_table: _RecordsOfTable) -> TableRow:
    """Return the row of a method in a table.

    Parameters
    ----------
    method
        Name of the method, with its parameters.
    records
        Its records; none for a method of the paper that never ran.
    of_table
        All records of the table, which say over which galleries its columns are means.
    """
    if not records:  # a row without scores
        block: Block = "network" if method.startswith("learned") else "form"
        return TableRow(method, TITLES.get(method, method), block, {})
    blocks = [block_of(record) for record in records]
    # A job of a network that failed before it had a model does not say that it is of one.
    block = "network" if "network" in blocks else blocks[0]
    first = min(records, key=lambda record: len(record.method))  # with the fewest parameters

    scored, failed = _scores_by_column(records, block, of_table)
    chosen = {
        name: value
        for name, value in first.parameters.items()
        if f"{name}=" not in AVERAGED_PARAMETERS
    }
    return TableRow(
        method=method,
        title=_title(method, brief(first.title), scored.values()),
        kind=block,
        scored=scored,
        failed=failed,
        parameters=chosen,
        defaults=first.defaults,
    )


def _scores_by_column(
    records: Sequence[Record], block: Block, of_table: _RecordsOfTable
) -> tuple[dict[str, RowScores], dict[str, list[Record]]]:
    """Return the scores of a row in each column, and in each column its records without scores.

    Parameters
    ----------
    records
        All records of the row.
    block
        Its block, such as ``"network"``.
    of_table
        All records of the table, which say over which galleries its columns are means.

    Returns
    -------
    scored : dict
        Scores by the title of the column.
    failed : dict
        Records that say why there are no scores, by the title of the column.
    """
    scored = {}
    failed = {}
    for column, galleries in of_table.galleries.items():
        # Networks were trained for the first random draw of the data alone.
        names = galleries[:1] if block == "network" and column.over_draws else galleries
        of_column = _records_of_column(records, column, block, names)
        ranked = by_gallery(record for record in of_column if record.status == "ok")
        if ranked:
            scored[column.title] = _scores(ranked, names, of_table)
        without_scores = [record for record in of_column if record.status != "ok"]
        if without_scores:
            failed[column.title] = without_scores
    return scored, failed


def _title(method: str, own: str, scores: Iterable[RowScores]) -> str:
    """Return the title of a row.

    Some methods treat depth views differently from complete surfaces; if the row has scores of
    views, its title says how. The title of a network means certain models; if others made the
    forms, it says so.

    Parameters
    ----------
    method
        Name of the method with parameters.
    own
        Title that the method gives itself, which is used if the suite has no title for it.
    scores
        Scores of the row in all columns.
    """
    title = TITLES.get(method, own)
    records = list(chain.from_iterable(of_column.all_records for of_column in scores))
    models = list(chain.from_iterable(record.models for record in records))
    if method in TITLES and not all(_is_meant(model, method) for model in models):
        title = f"{title.removesuffix(f', {FROZEN}')}, {OWN_MODEL}"
    inputs = {record.input for record in records}
    base = base_name(method)
    if base not in ON_VIEWS or "view" not in inputs:
        return title
    words = ON_VIEWS[base]
    if "mesh" in inputs:
        words = f"views: {words}"
    if title.endswith(")"):  # parameters stand there already
        return f"{title.removesuffix(')')}, {words})"
    return f"{title} ({words})"


def _is_meant(model: RecordedModel, method: str) -> bool:
    """Return whether a model is one that the title of its row in the tables means.

    It is if it is published, or if there is none to publish and it follows the recipe.
    """
    if is_published(model.digest):
        return True
    trainings = {name.partition("/")[0] for name in published_models()}
    recipe = RECIPE_AS_PRINTED if method == AS_PRINTED else RECIPE
    return model.training not in trainings and re.match(recipe, model.schedule) is not None


def _records_of_column(
    records: Iterable[Record], column: GalleryGroup, block: Block, galleries: Container[str]
) -> list[Record]:
    """Return the records of a row that stand in a column: those of its galleries and input."""
    of_column = [record for record in records if record.gallery in galleries]
    input_ = _input(column, block, {record.input for record in of_column})
    return [record for record in of_column if record.input == input_]


def _input(column: GalleryGroup, block: Block, available: set[Input]) -> str:
    """Return the input of a row in a column.

    Where surfaces and views stand in one column, networks see views and all others surfaces. A
    network, or forms of another program, that exist only of the other input are shown with that.
    """
    if not column.has_mixed_inputs:
        return column.input
    preferred: Input = "view" if block == "network" else "mesh"
    other: Input = "mesh" if block == "network" else "view"
    if block in ("network", "external") and available == {other}:
        return other
    return preferred


def _scores(
    ranked: Mapping[str, Sequence[Record]],
    galleries: Sequence[str],
    of_table: _RecordsOfTable,
) -> RowScores:
    """Return the scores of a row in a column.

    Parameters
    ----------
    ranked
        Records with scores, by gallery.
    galleries
        Names of the galleries of the column; one without records counts as 0.
    of_table
        All records of the table, which say which measures it shows, and the classes of the queries
        of each gallery.
    """
    values = []
    classes: list[str] = []
    for name in galleries:
        of_gallery = of_table.labels.get(name, ())
        values.append(query_measures(ranked.get(name, ()), of_table.measures, of_gallery))
        classes += [f"{name} {label}" for label in of_gallery]
    records = {name: ranked[name] for name in galleries if name in ranked}
    missing = tuple(name for name in galleries if name not in ranked)
    return RowScores(records, missing, of_table.measures, np.concatenate(values), classes)


def _excused(rows: Sequence[TableRow]) -> list[TableRow]:
    """Return rows that know which of the shapes they lack do not keep them from a comparison.

    A row that lacks a shape cannot be compared with rows that have it. But if all rows of a block
    lack it, because its file cannot be read, they can be compared on the others. A row that lacks a
    whole gallery is not compared, so that it does not count here.
    """
    refused_by_all: dict[tuple[str, Block], frozenset[str]] = {}  # by column and block
    for row in rows:
        complete = {title: scores for title, scores in row.scored.items() if not scores.missing}
        for title, scores in complete.items():
            place = title, row.kind
            refused_by_all[place] = refused_by_all.get(place, scores.refused) & scores.refused
    excused_rows = []
    for row in rows:
        scored = {
            title: replace(scores, excused=refused_by_all.get((title, row.kind), frozenset()))
            for title, scores in row.scored.items()
        }
        excused_rows.append(replace(row, scored=scored))
    return excused_rows


def _arranged(rows: Sequence[TableRow], known: Iterable[str]) -> list[TableRow]:
    """Return the rows of a table in their order: by block, then known methods first.

    Rows of one method with different parameters are sorted by the values of these, and the title
    of each shows the values of all parameters in which they differ.

    Parameters
    ----------
    rows
        The rows.
    known
        Names of methods in their order.
    """
    order = {method: number for number, method in enumerate(dict.fromkeys(known))}
    # Parameters in which rows of a method differ, by method; dicts are used as ordered sets.
    swept = defaultdict[str, dict[str, None]](dict)
    for row in rows:
        if row.method not in TITLES:
            swept[row.base_name].update(dict.fromkeys(row.parameters))

    def place(row: TableRow) -> tuple[Any, ...]:
        """Return what rows are sorted by: block, method, title, and values of a sweep."""
        number = order.get(row.method, order.get(row.base_name, len(order)))
        values = {**row.defaults, **row.parameters}
        ranks = [_rank_of_value(values.get(name)) for name in swept[row.base_name]]
        title = row.title.partition(" (")[0]
        return [*BLOCKS].index(row.kind), number, title, ranks, row.title

    ordered = sorted(rows, key=place)
    return [_showing_defaults(row, swept[row.base_name]) for row in ordered]


def _rank_of_value(value: Any) -> tuple[int, float, str]:
    """Return what the values of a parameter are sorted by: numbers before texts."""
    if isinstance(value, int | float):
        return 0, value, ""
    return 1, 0, str(value)


def _showing_defaults(row: TableRow, names: Iterable[str]) -> TableRow:
    """Return a row whose title also shows those of some parameters that have their defaults.

    An empty text is not shown: it chooses nothing.
    """
    shown = [name for name in names if row.defaults.get(name, "") != ""]
    texts = [f"{name}={format_value(row.defaults[name])}" for name in shown]
    if not texts:
        return row
    defaults = ", ".join(texts)
    if row.parameters and row.method not in TITLES:  # they stand in brackets at the end
        return replace(row, title=f"{row.title.removesuffix(')')}, {defaults})")
    return replace(row, title=f"{row.title} ({defaults})")


def _with_different_titles(rows: Sequence[TableRow]) -> list[TableRow]:
    """Return rows of which those with one title also show the names of their methods."""
    counts = Counter(row.title for row in rows)
    different = []
    for row in rows:
        if counts[row.title] > 1:
            different.append(replace(row, title=f"{row.title} ({row.method})"))
        else:
            different.append(row)
    return different
