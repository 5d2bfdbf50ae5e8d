"""Tables as they are printed: rows in blocks, means, the best of each block, chance, seconds and notes."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmark.pipeline.records import Record
from benchmark.protocols.tables import OFFICIAL, TABLES, TITLES, Column, Kind, Table
from benchmark.reference.paper import MEASURES, PRINTED
from benchmark.report.frames import changed, chosen_records, fold_of, kind_of, row_of, seconds_of, tables_of
from benchmark.report.notes import notes
from benchmark.report.statistics import bootstrap_intervals
from benchmark.text import brief
from retrieval.measures import chance_levels

if TYPE_CHECKING:
    from pandas import DataFrame

PAPER = "paper"

BLOCKS: Mapping[Kind, str] = {
    "form": "Canonical forms", "network": "Networks", "descriptor": "Descriptors", "external": "Other programs",
}  # fmt: skip

#: Confidence level of the difference to the best row within which a row cannot be separated from it.
SEPARATED = 0.9

#: Differences below half a unit of the last decimal of records are none.
_SAME = 5e-7


@dataclass(frozen=True, eq=False)
class Scored:
    """A row in one column.

    Parameters
    ----------
    records
        Records with scores, by gallery; several of a gallery are trainings, over which it is averaged.
    missing
        Names of galleries without scores, which count as 0.
    values
        Measures of all queries of all galleries, shape (N, 4); 0 where a gallery is missing.
    labels
        Class of each of these queries, with its gallery.
    """

    records: Mapping[str, Sequence[Record]]
    missing: tuple[str, ...]
    values: NDArray[np.float64]
    labels: Sequence[str]

    @cached_property
    def means(self) -> dict[str, float]:
        """Means over galleries, each a mean over trainings."""
        each = [[[r.scores[name] for name in MEASURES] for r in records] for records in self.records.values()]
        totals = np.sum([np.mean(of_gallery, axis=0) for of_gallery in each], axis=0)
        return dict(zip(MEASURES, (totals / (len(each) + len(self.missing))).tolist(), strict=True))

    @property
    def all_records(self) -> list[Record]:
        """All records with scores."""
        return [record for records in self.records.values() for record in records]

    @property
    def is_complete(self) -> bool:
        """Whether every gallery and every shape has a result."""
        return not self.missing and all(record.coverage >= 1 for record in self.all_records)

    @property
    def is_rival(self) -> bool:
        """Whether it may be the best row: it is complete, and no model was trained on shapes of the gallery."""
        return self.is_complete and not any(record.seen for record in self.all_records)


@dataclass(frozen=True, eq=False)
class Row:
    """A row of a table: by column its scores, and its records without scores."""

    method: str
    title: str
    kind: Kind
    scored: Mapping[str, Scored]
    failed: tuple[Record, ...] = ()

    @property
    def is_published(self) -> bool:
        """Whether none of its jobs ran here."""
        return all(record.published for one in self.scored.values() for record in one.all_records)

    @property
    def seconds(self) -> float | None:
        """Seconds a shape for form and geodesics: the median over its jobs."""
        known = (seconds_of(record) for one in self.scored.values() for record in one.all_records)
        measured = [seconds for seconds in known if seconds is not None]
        return statistics.median(measured) if measured else None


@dataclass(frozen=True, eq=False)
class TableView:
    """One table on one data set.

    Parameters
    ----------
    table
        The table.
    dataset, title
        Name and title of the data.
    quick
        Whether poses were omitted to save time.
    columns
        The columns in which some row has scores.
    galleries
        Labels of each gallery, by column.
    rows
        All rows, in blocks; those of the paper first.
    shown
        Methods whose rows are printed; empty for all. Marks and verdicts come from all rows.
    left_out
        Notes on records of other versions of the data.
    """

    table: Table
    dataset: str
    title: str
    quick: bool
    columns: tuple[Column, ...]
    galleries: Mapping[str, Sequence[Sequence[str]]]
    rows: tuple[Row, ...]
    shown: frozenset[str] = frozenset()
    left_out: tuple[str, ...] = ()

    @property
    def printed_rows(self) -> list[Row]:
        """The rows to print."""
        return [row for row in self.rows if not self.shown or {row.method, row.method.partition("[")[0]} & self.shown]

    @property
    def paper(self) -> Mapping[str, Mapping[str, float]]:
        """The paper's figures by method; empty for a table without."""
        return PRINTED[self.table.identifier] if self.table.has_paper and not self.quick else {}

    @property
    def size(self) -> str:
        """Numbers of shapes and classes of the galleries of each column."""
        texts = {}
        for column in self.columns:
            first = self.galleries[column.title][0]
            count = len(self.galleries[column.title])
            times = f"{count} x " if count > 1 else ""
            texts[column.title] = f"{times}{len(first)} shapes of {len(set(first))} classes"
        if len(set(texts.values())) == 1:
            return next(iter(texts.values()))
        return "; ".join(f"{title}: {text}" for title, text in texts.items())

    @property
    def caption(self) -> str:
        """Caption with the data; it says if they are a stand-in."""
        quick = ", quick run with some of the poses" if self.quick else ""
        return f"{self.table.caption}: {self.title} ({self.size}{quick})"

    @property
    def stem(self) -> str:
        """Name of its files."""
        name = f"table-{self.table.identifier}"
        name += f"-{self.dataset.removesuffix('[draw=0]')}" if self.dataset != self.table.identifier else ""
        safe = "".join(c if c.isascii() and (c.isalnum() or c in ".-_") else "-" for c in name)
        return f"{safe[:80].strip('-')}{'-quick' if self.quick else ''}"

    @cached_property
    def chance(self) -> dict[str, dict[str, float]]:
        """Scores of a random order, by column: means over galleries."""
        levels = {title: [chance_levels(of) for of in galleries] for title, galleries in self.galleries.items()}
        return {
            title: {name: statistics.fmean(level[name] for level in each) for name in MEASURES}
            for title, each in levels.items()
        }

    @property
    def groups(self) -> list[str]:
        """Titles of the groups of scores: the paper's, then ours."""
        return [*([PAPER] if self.paper else []), *(column.title for column in self.columns)]

    @cached_property
    def scores(self) -> DataFrame:
        """Scores by method, in columns (group, measure): the paper's, then ours; NaN where there is none."""
        from pandas import DataFrame, MultiIndex

        columns = MultiIndex.from_product([self.groups, MEASURES])
        found = [
            {(PAPER, name): value for name, value in self.paper.get(row.method, {}).items()}
            | {(title, name): value for title, one in row.scored.items() for name, value in one.means.items()}
            for row in self.rows
        ]
        return DataFrame(found, [row.method for row in self.rows], columns, dtype=float)

    @cached_property
    def marks(self) -> DataFrame:
        """``"bold"`` for the best of a block, ``"italic"`` where it cannot be separated from it, else ``""``."""
        marks = self.scores.map(lambda _: "")
        for column in self.columns:
            for kind in BLOCKS:
                rivals = [row for row in self.rows if row.kind == kind and self._is_rival(row, column.title)]
                if len(rivals) > 1:
                    self._mark(marks, column.title, rivals)
        return marks

    def _is_rival(self, row: Row, title: str) -> bool:
        return title in row.scored and row.scored[title].is_rival

    def _mark(self, marks: DataFrame, title: str, rivals: Sequence[Row]) -> None:
        """Mark the best rows of a block in one column, by measure."""
        for place, measure in enumerate(MEASURES):
            means = {row.method: row.scored[title].means[measure] for row in rivals}
            best = next(row for row in rivals if means[row.method] >= max(means.values()) - _SAME)
            others = [row for row in rivals if means[row.method] < means[best.method] - _SAME]
            for row in rivals:
                marks.loc[row.method, (title, measure)] = "bold" if row not in others else ""
            if not others:
                continue
            leads = [(best.scored[title].values - row.scored[title].values)[:, place] for row in others]
            ends = bootstrap_intervals(np.column_stack(leads), best.scored[title].labels, SEPARATED)
            for row, (low, _) in zip(others, ends, strict=True):
                marks.loc[row.method, (title, measure)] = "italic" if low <= 0 else ""

    @cached_property
    def notes(self) -> list[str]:
        """At most eight short notes."""
        return notes(self)

    def intervals(self, row: Row, title: str, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Return the interval of each score of a row over resampled classes; empty without scores."""
        if title not in row.scored:
            return {}
        ends = bootstrap_intervals(row.scored[title].values, row.scored[title].labels, level)
        return {name: (low, high) for name, (low, high) in zip(MEASURES, ends.tolist(), strict=True)}


def table_views(
    records: Iterable[Record], tables: Iterable[str] = (), methods: Iterable[str] = (), datasets: Iterable[str] = (),
    *, quick: bool = False, scorer: str = "cm-bof", seed: int = 0,
) -> list[TableView]:  # fmt: skip
    """Return the tables that records fill.

    Parameters
    ----------
    records
        Records, one a job.
    tables
        Identifiers of tables, whose companions are added; empty for all.
    methods
        Methods whose rows are printed; empty for all. Marks and verdicts do not depend on it.
    datasets
        Names of data sets; empty for all.
    quick, scorer, seed
        The runs to show.
    """
    wanted, sets, shown = set(tables), set(datasets), frozenset(methods)
    grouped: dict[tuple[Table, str], list[Record]] = {}
    for record in chosen_records(records, quick=quick, scorer=scorer, seed=seed):
        if changed(record.data.name) and record.data.name not in sets:
            continue  # shown by the table of robustness
        for table in tables_of(record.data.name, fold_of(record)):
            is_wanted = not wanted or {table.identifier, table.part_of} & wanted
            if is_wanted and (not sets or record.data.name in sets):
                main = table.stand_ins[0] if record.data.name in table.stand_ins else record.data.name
                grouped.setdefault((table, main), []).append(record)
    order = {table: place for place, table in enumerate(TABLES)}
    keys = sorted(grouped, key=lambda key: (order.get(key[0], len(order)), key[0].dataset != key[1], key[1]))
    every = [_view(table, main, grouped[table, main], shown) for table, main in keys]
    views = [replace(view, shown=shown) for view in every if view is not None]
    return [view for view in views if not wanted or sets or _is_preferred(view, views)]


def _is_preferred(view: TableView, views: Sequence[TableView]) -> bool:
    """Return whether a table that was asked for is shown on this data: where it ran here, else the official ones."""
    rivals = [other for other in views if other.table == view.table]
    here = [other for other in rivals if any(row.scored and not row.is_published for row in other.rows)]
    return view in here if here else view is rivals[0]


def _view(table: Table, dataset: str, records: Sequence[Record], named: frozenset[str]) -> TableView | None:
    """Return one table; None if no row has scores or has failed in it."""
    by_gallery: dict[str, list[Record]] = {}
    for record in records:
        by_gallery.setdefault(record.gallery, []).append(record)
    current = {gallery: _of_newest_version(of) for gallery, of in by_gallery.items()}
    left_out = [record for gallery, of in by_gallery.items() for record in of if record not in current[gallery]]
    rows: dict[str, list[Record]] = {}
    for record in (record for of in current.values() for record in of):
        base = record.method.partition("[")[0]
        if table.includes(base) or {base, record.method} & named or table not in TABLES:
            rows.setdefault(row_of(record), []).append(record)
    if not rows:
        return None
    sample = next((record for of in current.values() for record in of if record.data.name == dataset), records[0])
    quick = sample.data.quick
    names = {column.title: _galleries(table, column, dataset, current, quick=quick) for column in table.columns}
    labels = {gallery: _ranked(next((r.labels for r in of if r.labels), ())) for gallery, of in current.items()}
    printed = PRINTED.get(table.identifier, {}) if table.has_paper and not quick else {}
    made = [
        _row(method, rows.get(method, []), table, names, labels)
        for method in dict.fromkeys([*printed, *rows])
    ]  # fmt: skip
    columns = tuple(column for column in table.columns if any(column.title in row.scored for row in made))
    made = [row for row in made if row.scored or row.failed or row.method in printed]
    if not columns and not any(row.failed for row in made):
        return None
    return TableView(
        table, dataset, _title(sample), quick, columns or table.columns[:1],
        {title: of for title, each in names.items() if (of := [labels[name] for name in each if name in labels])},
        tuple(sorted(made, key=lambda row: _place(row, printed))), left_out=_outdated(left_out),
    )  # fmt: skip


def _of_newest_version(records: Sequence[Record]) -> list[Record]:
    """Return the records of a gallery that rank the same shapes as its newest local one, or newest published one."""
    newest = max(records, key=lambda record: (record.status == "ok", not record.published, record.finished))
    return [record for record in records if record.gallery_digest == newest.gallery_digest]


def _galleries(
    table: Table, column: Column, dataset: str, current: Mapping[str, object], *, quick: bool
) -> tuple[str, ...]:
    """Return the names of the galleries of a column; a quick run has only the first fold."""
    sets = table.stand_ins if column.over_draws and dataset in table.stand_ins else (dataset,)
    names = tuple(f"{name} {part}".strip() + (" (quick)" if quick else "") for name in sets for part in column.parts)
    return tuple(name for name in names if name in current) if quick else names


def _row(
    method: str, records: Sequence[Record], table: Table, names: Mapping[str, Sequence[str]],
    labels: Mapping[str, Sequence[str]],
) -> Row:  # fmt: skip
    kind: Kind = kind_of(records[0]) if records else "network" if method.startswith("learned") else "form"
    first = min(records, key=lambda record: len(record.method), default=None)
    title = TITLES.get(method) or (brief(first.title) if first else method)
    scored, failed = {}, []
    for column in table.columns:
        galleries = names[column.title]
        if kind == "network" and column.over_draws:
            galleries = galleries[:1]
        input_ = _input(column, kind, {record.input for record in records if record.gallery in galleries})
        part = [record for record in records if record.gallery in galleries and record.input == input_]
        found = {name: [r for r in part if r.gallery == name and r.status == "ok"] for name in galleries}
        having = {name: of for name, of in found.items() if of}
        if having:
            values = [_values(found[name], labels.get(name, ())) for name in galleries]
            missing = tuple(name for name in galleries if name not in having)
            classes = [f"{name} {label}" for name in galleries for label in labels.get(name, ())]
            scored[column.title] = Scored(having, missing, np.concatenate(values), classes)
        failed += [record for record in part if record.status != "ok"]
    return Row(method, title, kind, scored, tuple(failed))


def _input(column: Column, kind: Kind, available: set[str]) -> str:
    if column.input != "as printed":
        return column.input
    preferred, other = ("view", "mesh") if kind == "network" else ("mesh", "view")
    is_bound = kind in ("form", "descriptor")
    return preferred if is_bound or preferred in available or other not in available else other


def _ranked(labels: Sequence[str]) -> list[str]:
    """Return the classes of the queries that have something to find: those of a class of one shape count nowhere."""
    sizes = Counter(labels)
    return [label for label in labels if sizes[label] > 1]


def _values(records: Sequence[Record], labels: Sequence[str]) -> NDArray[np.float64]:
    """Return the measures of each query of a gallery, averaged over trainings; 0 without records."""
    if not records:
        return np.zeros((len(labels), len(MEASURES)))
    each = [np.array([record.per_query[name] for name in MEASURES], dtype=np.float64).T for record in records]
    values = np.mean(each, axis=0)
    return np.asarray(values[~np.isnan(values).any(axis=1)])


def _place(row: Row, printed: Iterable[str]) -> tuple[int, int, int, str]:
    """Return a sort key: blocks, the paper's rows in its order, networks in the order of their titles, all others."""
    order, known = list(printed), list(TITLES)
    of_paper = order.index(row.method) if row.method in order else len(order)
    titled = known.index(row.method) if row.method in known else len(known)
    return list(BLOCKS).index(row.kind), of_paper, titled, row.title


def _title(record: Record) -> str:
    """Return the title of the data of a record; it always says if they are a stand-in."""
    if official := record.data.stand_in_for:
        name = record.data.name.partition("[draw=")[0]
        return f"generated stand-in '{name}', not {OFFICIAL.get(official, official)}"
    return brief(record.data.title)


def _outdated(records: Iterable[Record]) -> tuple[str, ...]:
    """Name the rows that rank another version of the data."""
    rows = dict.fromkeys(f"{record.method} on {record.gallery}, {record.input}" for record in records)
    return tuple(rows)
