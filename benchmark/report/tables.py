"""Tables as they are printed: rows in blocks, means, the best of each block, chance, seconds and notes."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.parameters import format_value
from benchmark.defaults import DEFAULT_SCORER
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import (
    AVERAGED,
    ON_VIEWS,
    TABLES,
    TITLES,
    GalleryGroup,
    Kind,
    Table,
    gallery_name,
)
from benchmark.reference.paper import MEASURES, PRINTED
from benchmark.registry import BUILT_IN, Component
from benchmark.report.data_titles import data_title
from benchmark.report.frames import (
    ScoredBy,
    by_gallery,
    changed,
    file_name,
    fold_of,
    kind_of,
    row_of,
    scored_by,
    tables_of,
    two_scorers,
)
from benchmark.report.statistics import ALPHA, FEWEST_CLASSES, class_intervals, permutation_test
from benchmark.text import brief
from retrieval.measures import chance_levels

PAPER = "paper"

#: Group of the ranks of rows by a second scorer.
SECOND = "ranks by spherical harmonics"

BLOCKS: Mapping[Kind, str] = {
    "form": "Canonical forms",
    "network": "Networks",
    "descriptor": "Descriptors",
    "external": "Other programs",
}

#: Differences below half a unit of the last decimal of records are none.
SAME = 5e-7

#: Standard errors of means over three draws of the codebook, for records that do not hold theirs:
#: those of four methods on complete surfaces of TOSCA, over twelve draws.
DRAW_ERRORS = {"NN": 0.011, "FT": 0.004, "ST": 0.006, "DCG": 0.003}


@dataclass(frozen=True, eq=False)
class Scored:
    """A row in one column.

    Parameters
    ----------
    records
        Records with scores, by gallery; several of a gallery are trainings, over which it is
        averaged.
    missing
        Names of galleries without scores, which count as 0.
    values
        Measures of all queries of all galleries, shape (N, 4); 0 where a gallery is missing.
    labels
        Class of each of these queries, with its gallery.
    excused
        Refused shapes that all rows of its block lack: none of them is ahead by these.
    """

    records: Mapping[str, Sequence[Record]]
    missing: tuple[str, ...]
    values: NDArray[np.float64]
    labels: Sequence[str]
    excused: frozenset[str] = frozenset()

    @cached_property
    def of_galleries(self) -> NDArray[np.float64]:
        """Scores of each gallery, means over trainings, shape (galleries, measures); 0 for a missing one."""
        each = [
            [[r.scores[name] for name in MEASURES] for r in records]
            for records in self.records.values()
        ]
        return np.array(
            [*(np.mean(of, axis=0) for of in each), *[np.zeros(len(MEASURES))] * len(self.missing)]
        )

    @cached_property
    def means(self) -> dict[str, float]:
        """Means over galleries."""
        return dict(zip(MEASURES, self.of_galleries.mean(axis=0).tolist(), strict=True))

    @property
    def all_records(self) -> list[Record]:
        """All records with scores."""
        return [record for records in self.records.values() for record in records]

    @property
    def trainings(self) -> list[NDArray[np.float64]]:
        """Measures of all queries by training; galleries with fewer trainings repeat theirs."""
        each = [
            [query_measures([record]) for record in records] for records in self.records.values()
        ]
        return [
            np.concatenate([of[k % len(of)] for of in each]) for k in range(max(map(len, each)))
        ]

    @cached_property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Interval of each mean of enough classes; see :data:`benchmark.report.statistics.INTERVALS`."""
        ends = class_intervals(self.values, self.labels).tolist()
        return {
            name: (low, high)
            for name, (low, high) in zip(MEASURES, ends, strict=True)
            if not math.isnan(low)
        }

    @property
    def is_complete(self) -> bool:
        """Whether every gallery and every shape has a result."""
        return not self.missing and all(record.coverage >= 1 for record in self.all_records)

    @cached_property
    def refused(self) -> frozenset[str]:
        """Shapes without a result, with their gallery."""
        sides = [side for record in self.all_records for side in record.sides]
        return frozenset(f"{side.gallery} {name}" for side in sides for name, _ in side.unsupported)

    def is_rival(self, seen: frozenset[str] = frozenset()) -> bool:
        """Return whether it lacks no shape that others have, and was trained on shapes of no classes but these."""
        return not (self.missing or self.refused - self.excused or self.seen_classes - seen)

    @cached_property
    def seen_classes(self) -> frozenset[str]:
        """Classes of which a model was trained on a shape, with their gallery."""
        records = self.all_records
        return frozenset(
            f"{record.gallery} {label}" for record in records for label in seen_classes(record)
        )


@dataclass(frozen=True, eq=False)
class Row:
    """A row of a table: by column its scores, and its records without; parameters that are not and are defaults."""

    method: str
    title: str
    kind: Kind
    scored: Mapping[str, Scored]
    failed: Mapping[str, Sequence[Record]] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    defaults: Mapping[str, Any] = field(default_factory=dict)

    def n_galleries(self, group: str) -> int:
        """Return how many galleries its scores in a column are means over."""
        return len(self.scored[group].records) if group in self.scored else 0

    @property
    def base(self) -> str:
        """Name of its method without parameters."""
        return self.method.partition("[")[0]

    @property
    def records(self) -> list[Record]:
        """All records with scores."""
        return [record for one in self.scored.values() for record in one.all_records]

    @property
    def is_published(self) -> bool:
        """Whether none of its jobs ran here."""
        return all(record.published for record in self.records)

    @property
    def cite(self) -> str:
        """What it cites: a key of the bibliography, or a BibTeX entry; that of the suite's methods is today's."""
        if self.base in BUILT_IN and self.kind != "external":
            return str(Component("method", self.base, BUILT_IN[self.base]).info.cite)
        return next((record.cite for record in self.records if record.cite), "")


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
    samples
        A record of each gallery, by column.
    rows
        All rows, in blocks; those of the paper first.
    paper
        The paper's figures by method; empty for a table without.
    shown
        Methods whose rows are printed; empty for all. Marks and verdicts come from all rows.
    left_out
        Notes on records of other versions of the data.
    by
        Its scorer and seed.
    never_ran
        Whether to print methods of the paper that never ran.
    """

    table: Table
    dataset: str
    title: str
    quick: bool
    columns: tuple[GalleryGroup, ...]
    samples: Mapping[str, Sequence[Record]]
    rows: tuple[Row, ...]
    paper: Mapping[str, Mapping[str, float]]
    shown: frozenset[str]
    left_out: tuple[str, ...]
    by: ScoredBy
    never_ran: bool = False

    @property
    def printed_rows(self) -> list[Row]:
        """The rows to print."""
        ran = [row for row in self.rows if self.never_ran or row.scored or row.failed]
        return [row for row in ran if not self.shown or {row.method, row.base} & self.shown]

    @property
    def size(self) -> str:
        """Numbers of shapes and classes of the galleries of each column."""
        texts = {}
        for column in self.columns:
            first, *others = self.samples[column.title]
            classes = ranked_classes(first)
            times = f"{len(others) + 1} x " if others else ""
            texts[column.title] = f"{times}{len(classes)} shapes of {len(set(classes))} classes"
            if first.gallery_of_queries:
                n_omitted = len(first.shapes) - len(classes)
                omitted = f", {n_omitted} left out" if n_omitted else ""
                size = f"{len(classes)} queries of {len(set(classes))} classes{omitted}"
                texts[column.title] = f"{size}, among {len(first.gallery_of_queries.shapes)} shapes"
        if len(set(texts.values())) == 1:
            return next(iter(texts.values()))
        return "; ".join(f"{title}: {text}" for title, text in texts.items())

    @property
    def caption(self) -> str:
        """Caption with the data; it says if they are a stand-in."""
        quick = ", quick run with some of the poses" if self.quick else ""
        is_named = any(
            f"{mark}{self.title}" in self.table.caption for mark in " /"
        )  # a folder is its own table
        named = "" if is_named else f": {self.title}"
        return f"{self.table.caption}{named} ({self.size}{quick}){self.by.caption}"

    @property
    def stem(self) -> str:
        """Name of its files."""
        name = f"table-{self.table.identifier}"
        base, *change = changed(self.dataset) or [self.dataset.removesuffix("[draw=0]")]
        name += f"-{'-'.join([base, *change])}" if self.dataset != self.table.identifier else ""
        return file_name(name + self.by.suffix) + "-quick" * self.quick

    @cached_property
    def chance(self) -> dict[str, dict[str, float]]:
        """Scores of a random order, by column: means over galleries."""
        each = {
            title: [chance_levels(one.labels, one.targets) for one in of]
            for title, of in self.samples.items()
        }
        return {
            title: {name: statistics.fmean(one[name] for one in of) for name in MEASURES}
            for title, of in each.items()
        }

    @property
    def groups(self) -> list[str]:
        """Titles of the groups of scores: the paper's, ours, and ranks by a second scorer."""
        return [
            *[PAPER] * bool(self.paper),
            *(column.title for column in self.columns),
            *[SECOND] * bool(self.ranks),
        ]

    @property
    def has_ranks(self) -> bool:
        """Whether a second scorer belongs to the table: it is III or III-view of TOSCA, by the default scorer."""
        return (self.table.part_of or self.table.identifier, self.dataset) == (
            "III",
            "tosca",
        ) and not self.by.caption

    @cached_property
    def ranks(self) -> dict[str, dict[str, tuple[int, int]]]:
        """Ranks of rows by CM-BOF and by the second scorer, by method and measure, if both scored these forms."""
        ranks: dict[str, dict[str, tuple[int, int]]] = {}
        input_, title = "view" if self.table.part_of else "mesh", self.columns[0].title
        for name in MEASURES if self.has_ranks else ():
            each = [
                two_scorers().get((input_, scorer, name), {})
                for scorer in (DEFAULT_SCORER, "spherical-harmonics")
            ]
            for row in self.rows:
                if (
                    abs(self.scores(row, title).get(name, np.nan) - each[0].get(row.method, np.nan))
                    < 1e-6
                ):
                    first, second = (
                        1 + sum(of[row.method] < score for score in of.values()) for of in each
                    )
                    ranks.setdefault(row.method, {})[name] = first, second
        return ranks

    def scores(self, row: Row, group: str) -> Mapping[str, float]:
        """Return the scores of a row in a group, by measure; empty if it has none."""
        if group == PAPER:
            return self.paper.get(row.method, {})
        if group == SECOND:
            return {name: second for name, (_, second) in self.ranks.get(row.method, {}).items()}
        return row.scored[group].means if group in row.scored else {}

    def of_folds(self, row: Row, group: str) -> list[tuple[float, float]]:
        """Return the least and the greatest score over the folds of a group, by measure; empty without folds."""
        has_folds = any(column.title == group and len(column.parts) > 1 for column in self.columns)
        one = row.scored.get(group) if has_folds else None
        several = one is not None and len(one.of_galleries) > 1
        return [(min(of), max(of)) for of in one.of_galleries.T.tolist()] if one and several else []

    @cached_property
    def tests(self) -> dict[tuple[str, Kind], Tested]:
        """Rivals with the outcome of their tests, by column and block; for blocks with several rivals."""
        tests = {}
        for column, kind in product(self.columns, BLOCKS):
            of_block = {
                row.method: row.scored.get(column.title) for row in self.rows if row.kind == kind
            }
            rivals = {name: one for name, one in of_block.items() if one and one.is_rival()}
            if len(rivals) > 1:
                tests[column.title, kind] = tested_rivals(rivals)
        return tests

    @cached_property
    def marks(self) -> dict[tuple[str, str], dict[str, str]]:
        """Marks of the scores of rivals by method and column, then by measure; see :func:`_marks`."""
        marks: dict[tuple[str, str], dict[str, str]] = {}
        for (title, _), tested in self.tests.items():
            if tested.n_classes >= FEWEST_CLASSES:
                each = zip(tested.rivals, _marks(tested).tolist(), strict=True)
                for name, of_row in each:
                    marks[name, title] = dict(zip(MEASURES, of_row, strict=True))
        return marks


@dataclass(frozen=True, eq=False)
class Tested:
    """Rows of a block in one column, with the outcome of their tests.

    Parameters
    ----------
    rivals
        The rows by method.
    is_significant
        Which differences have p < .05 in the test of all rows and measures, shape (rows, rows,
        measures).
    is_above_scatter
        Which of them are also larger than the scatter of codebooks and trainings.
    """

    rivals: Mapping[str, Scored]
    is_significant: NDArray[np.bool_]
    is_above_scatter: NDArray[np.bool_]

    @property
    def n_classes(self) -> int:
        """Number of classes over which is tested."""
        return len({*next(iter(self.rivals.values())).labels})


def tested_rivals(rivals: Mapping[str, Scored]) -> Tested:
    """Test the differences of some rows; a difference within the scatter may be that of two codebooks or seeds."""
    rows = [*rivals.values()]
    means = np.array([[one.means[name] for name in MEASURES] for one in rows])
    p_values = permutation_test([one.values for one in rows], rows[0].labels)
    is_above = np.abs(means[:, None] - means) > least_difference(rows)[0] + SAME
    is_significant = p_values < ALPHA
    return Tested(rivals, is_significant, is_significant & is_above)


def least_difference(rows: Sequence[Scored]) -> tuple[NDArray[np.float64], str]:
    """Return the difference, by measure, that one above the scatter exceeds, and what a smaller one may come from.

    It is twice the standard error of a difference over draws of the codebook; between networks,
    also the largest range of the scores of a row over its seeds and folds. A test over classes says
    nothing about either.
    """
    each = [one.all_records for one in rows]
    errors = [
        np.square([_draw_errors(record) for record in of]).sum(axis=0) / len(of) ** 2 for of in each
    ]
    least = np.asarray(2 * np.sqrt(2 * np.mean(errors, axis=0)))
    if {kind_of(of[0]) for of in each} != {"network"}:
        return least, "within the scatter of codebooks"
    scores = [
        [[record.scores[name] for name in MEASURES] for record in of] for of in each if len(of) > 1
    ]
    if not scores:
        return np.full(len(MEASURES), np.inf), "one training each"
    return np.maximum(
        least, np.max([np.ptp(of, axis=0) for of in scores], axis=0)
    ), "within the spread of trainings"


def _draw_errors(record: Record) -> list[float]:
    is_default = record.scorer.partition("[")[0] == DEFAULT_SCORER
    return [
        (record.draw_errors or (DRAW_ERRORS if is_default else {})).get(name, 0.0)
        for name in MEASURES
    ]


def table_views(
    records: Iterable[Record],
    tables: Iterable[str] = (),
    methods: Iterable[str] = (),
    datasets: Iterable[str] = (),
    *,
    paper: bool = False,
) -> list[TableView]:
    """Return the tables that records fill.

    Parameters
    ----------
    records
        Records of one scorer and seed, one a job; see
        :func:`benchmark.report.frames.chosen_records`.
    tables
        Identifiers of tables, whose companions are added; empty for all.
    methods
        Methods whose rows are printed; empty for all. Marks and verdicts do not depend on it.
    datasets
        Names of data sets; empty for all.
    paper
        Whether to print methods of the paper that never ran.
    """
    wanted, sets, shown, records = set(tables), set(datasets), frozenset(methods), [*records]
    by = scored_by(records)
    by_table: dict[tuple[Table, str], list[Record]] = {}
    for record in records:
        name = record.data.name
        for table in tables_of(name, fold_of(record)):
            if name not in sets if sets else changed(name) and not table.is_cross:
                continue  # the table of robustness shows changed sets
            if not wanted or {table.identifier, table.part_of} & wanted:
                main = table.stand_ins[0] if name in table.stand_ins else name
                by_table.setdefault((table, main), []).append(record)
    order = {table: place for place, table in enumerate(TABLES)}
    own = [
        key
        for key, of in by_table.items()
        if not key[0].is_cross or any(record.gallery_of_queries for record in of)
    ]
    keys = sorted(
        own, key=lambda key: (order.get(key[0], len(order)), key[0].dataset != key[1], key[1])
    )
    every = [
        replace(_view(table, main, by_table[table, main], shown, by), never_ran=paper)
        for table, main in keys
    ]
    views = [view for view in every if any(row.scored or row.failed for row in view.rows)]
    return [view for view in views if not wanted or sets or _is_preferred(view, views)]


def _marks(tested: Tested) -> NDArray[np.str_]:
    """Return the marks of the rows of a block in one column, shape (rows, measures).

    ``"bold"`` for the best, ``"italic"`` where it is not significantly better than a row, and
    ``"scatter"`` where it is, but within the scatter of codebooks or trainings.
    """
    means = np.array([[one.means[name] for name in MEASURES] for one in tested.rivals.values()])
    is_best = means >= means.max(axis=0) - SAME
    best = is_best.argmax(axis=0)[None, None]
    is_worse = np.take_along_axis(tested.is_significant, best, axis=0)[0]
    is_above = np.take_along_axis(tested.is_above_scatter, best, axis=0)[0]
    marks = np.where(is_above, "", "scatter")
    marks[~is_worse] = "italic"
    marks[is_best] = "bold"
    return marks


def _is_preferred(view: TableView, views: Sequence[TableView]) -> bool:
    """Return whether a table that was asked for is shown on this data: where it ran here, else the official ones."""
    rivals = [other for other in views if other.table == view.table]
    here = [
        other for other in rivals if any(row.scored and not row.is_published for row in other.rows)
    ]
    return view in here if here else view is rivals[0]


def _view(
    table: Table, dataset: str, records: Sequence[Record], shown: frozenset[str], by: ScoredBy
) -> TableView:
    """Return one table with its rows, of which none may have scores or have failed."""
    current = {gallery: _of_newest_version(of) for gallery, of in by_gallery(records).items()}
    newest = [record for of in current.values() for record in of]
    left_out = [
        f"{r.method} on {r.gallery}, {r.input}" for r in records if r not in current[r.gallery]
    ]
    sample = next((record for record in newest if record.data.name == dataset), newest[0])
    samples = {
        gallery: next((record for record in of if record.labels), of[0])
        for gallery, of in current.items()
    }
    labels = {gallery: ranked_classes(record) for gallery, record in samples.items()}
    quick = sample.data.quick
    galleries = {
        column: _galleries(table, column, dataset, labels, quick=quick) for column in table.columns
    }
    printed = PRINTED[table.identifier] if table.has_paper and not quick else {}
    rows = {method: list[Record]() for method in printed}
    for record in newest:
        base = record.method.partition("[")[0]
        if table.includes(base) or {base, record.method} & shown or table not in TABLES:
            rows.setdefault(row_of(record), []).append(record)
    every = _excuse([_row(method, of, galleries, labels) for method, of in rows.items()])
    listed = [row for row in every if row.scored or row.failed or row.method in printed]
    listed = _arranged(
        listed, {method: place for place, method in enumerate(dict.fromkeys([*printed, *TITLES]))}
    )
    titles = Counter(row.title for row in listed)
    listed = [
        replace(row, title=f"{row.title} ({row.method})") if titles[row.title] > 1 else row
        for row in listed
    ]
    ranked = {
        column: [samples[name] for name in names if name in samples]
        for column, names in galleries.items()
    }
    known = [column for column in table.columns if ranked[column]]
    scored = tuple(column for column in known if any(column.title in row.scored for row in listed))
    columns = scored or tuple(sorted(known, key=lambda column: column.input != sample.input)[:1])
    return TableView(
        table,
        dataset,
        data_title(sample),
        quick,
        columns,
        {column.title: ranked[column] for column in known},
        tuple(listed),
        printed,
        shown,
        tuple(dict.fromkeys(left_out)),
        by,
    )


def _of_newest_version(records: Sequence[Record]) -> list[Record]:
    """Return the records of a gallery that rank the same shapes as its newest local one, or newest published one."""
    newest = max(
        records, key=lambda record: (record.status == "ok", not record.published, record.finished)
    )
    return [record for record in records if record.gallery_digest == newest.gallery_digest]


def _galleries(
    table: Table, column: GalleryGroup, dataset: str, known: Container[str], *, quick: bool
) -> list[str]:
    """Return the names of the galleries of a column; a quick run has only the first fold."""
    sets = table.stand_ins if column.over_draws and dataset in table.stand_ins else (dataset,)
    names = [gallery_name(name, part, quick=quick) for name in sets for part in column.parts]
    return [name for name in names if name in known] if quick else names


def _row(
    method: str,
    records: Sequence[Record],
    galleries: Mapping[GalleryGroup, Sequence[str]],
    labels: Mapping[str, Sequence[str]],
) -> Row:
    kind: Kind = (
        kind_of(records[0]) if records else "network" if method.startswith("learned") else "form"
    )
    first = min(records, key=lambda record: len(record.method), default=None)
    scored, failed = {}, {}
    for column, every in galleries.items():
        names = every[:1] if kind == "network" and column.over_draws else every
        of_column = [record for record in records if record.gallery in names]
        input_ = _input(column, kind, {record.input for record in of_column})
        part = [record for record in of_column if record.input == input_]
        ranked = by_gallery(record for record in part if record.status == "ok")
        having = {name: ranked[name] for name in names if name in ranked}
        if having:
            values = [query_measures(having.get(name, []), labels.get(name, ())) for name in names]
            classes = [f"{name} {label}" for name in names for label in labels.get(name, ())]
            missing = tuple(name for name in names if name not in having)
            scored[column.title] = Scored(having, missing, np.concatenate(values), classes)
        if of_failed := [record for record in part if record.status != "ok"]:
            failed[column.title] = of_failed
    chosen = (
        {name: value for name, value in first.parameters.items() if f"{name}=" not in AVERAGED}
        if first
        else {}
    )
    inputs = {record.input for one in scored.values() for record in one.all_records}
    title = _title(method, brief(first.title) if first else method, inputs)
    return Row(method, title, kind, scored, failed, chosen, first.defaults if first else {})


def _title(method: str, own: str, inputs: Container[str]) -> str:
    """Return the title of a row, which says where views are treated by another method."""
    title = TITLES.get(method, own)
    words = ON_VIEWS.get(method.partition("[")[0])
    if words is None or "view" not in inputs:
        return title
    if "mesh" in inputs:
        words = f"views: {words}"
    has_parameters = title.endswith(")")
    return f"{title.removesuffix(')')}, {words})" if has_parameters else f"{title} ({words})"


def _excuse(rows: Sequence[Row]) -> list[Row]:
    """Return rows that know which refused shapes all rows of their block lack in a column, and who gains by none."""
    lacking: dict[tuple[str, Kind], frozenset[str]] = {}
    for row in rows:
        for title, one in row.scored.items():
            lacking[title, row.kind] = lacking.get((title, row.kind), one.refused) & one.refused
    return [
        replace(
            row,
            scored={
                name: replace(one, excused=lacking[name, row.kind])
                for name, one in row.scored.items()
            },
        )
        for row in rows
    ]


def _arranged(rows: Sequence[Row], order: Mapping[str, int]) -> list[Row]:
    """Return rows in blocks and by title; if a method has several parameters, each shows those in which they differ."""
    swept: dict[str, dict[str, None]] = {}
    for row in rows:
        if row.method not in TITLES:
            swept.setdefault(row.base, {}).update(dict.fromkeys(row.parameters))
    placed = []
    for row in rows:
        values = {
            name: {**row.defaults, **row.parameters}.get(name) for name in swept.get(row.base, ())
        }
        ranks = [
            (0, value, "") if isinstance(value, int | float) else (1, 0, str(value))
            for value in values.values()
        ]
        place = order.get(row.method, order.get(row.base, len(order)))
        key = list(BLOCKS).index(row.kind), place, row.title.partition(" (")[0], ranks, row.title
        texts = [
            f"{name}={format_value(row.defaults[name])}" for name in values if name in row.defaults
        ]
        own = row.title.removesuffix(")") + ", " if row.parameters else f"{row.title} ("
        placed.append((key, replace(row, title=f"{own}{', '.join(texts)})") if texts else row))
    return [row for _, row in sorted(placed, key=lambda pair: pair[0])]


def _input(column: GalleryGroup, kind: Kind, available: set[str]) -> str:
    """Return the input of a row; forms of other programs, and networks, may be of another one than is printed."""
    if column.input != "as printed":
        return column.input
    preferred, other = ("view", "mesh") if kind == "network" else ("mesh", "view")
    return other if kind in ("network", "external") and available == {other} else preferred


def seen_classes(record: Record) -> set[str]:
    """Return the classes of which a model of a record was trained on a shape."""
    seen = frozenset(record.seen)
    return {
        label for shape, label in zip(record.shapes, record.labels, strict=True) if shape in seen
    }


def ranked_classes(record: Record) -> list[str]:
    """Return the classes of the queries that have something to find; the others count nowhere."""
    return [
        label for label, counts in zip(record.labels, record.are_queries, strict=True) if counts
    ]


def query_measures(records: Sequence[Record], labels: Sequence[str] = ()) -> NDArray[np.float64]:
    """Return the measures of each query of a gallery, averaged over trainings; 0 without records."""
    if not records:
        return np.zeros((len(labels), len(MEASURES)))
    each = [
        np.array([record.per_query[name] for name in MEASURES], dtype=np.float64).T
        for record in records
    ]
    values = np.mean(each, axis=0)
    return np.asarray(values[~np.isnan(values).any(axis=1)])
