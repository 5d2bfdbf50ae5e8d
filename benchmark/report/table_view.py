"""A table with its data: what it is called, which rows it prints, and what its groups show."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

from benchmark.pipeline.records import Record
from benchmark.protocols.tables import QUICK_POSES, TABLES, Block, GalleryGroup, Table
from benchmark.reference.paper import PAPER_MEASURES
from benchmark.report.notation import file_name
from benchmark.report.record_facts import ScoredBy, change_of
from benchmark.report.rivals import ComparedRivals, compare_rivals
from benchmark.report.rows import BLOCKS, RowScores, TableRow, ranked_classes
from benchmark.report.second_scorer import Ranks, ranks_by_both
from benchmark.report.statistics import FEWEST_CLASSES
from retrieval.measures import chance_levels

#: What captions say of a quick run.
QUICK_RUN = f"quick run with at most {QUICK_POSES} poses of each class"

#: Group of the paper's figures.
PAPER = "paper"

#: Group of the ranks of rows by a second scorer.
SECOND = "ranks by spherical harmonics"


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
        Whether it is of a quick run.
    columns
        The columns in which some row has scores.
    measures
        Names of the measures that it shows: those of tables that all of its records hold.
    samples
        A record of each gallery, by column.
    rows
        All rows, in blocks; those of the paper first.
    paper
        The paper's figures by method; empty for a table without.
    methods
        Methods whose rows are printed; empty for all. Marks and verdicts come from all rows.
    left_out
        Notes on records of other versions of the data.
    scored_by
        Its scorer and seed.
    prints_unrun
        Whether to print methods of the paper that never ran.
    """

    table: Table
    dataset: str
    title: str
    quick: bool
    columns: tuple[GalleryGroup, ...]
    measures: tuple[str, ...]
    samples: Mapping[str, Sequence[Record]]
    rows: tuple[TableRow, ...]
    paper: Mapping[str, Mapping[str, float]]
    methods: frozenset[str]
    left_out: tuple[str, ...]
    scored_by: ScoredBy
    prints_unrun: bool = False

    @property
    def printed_rows(self) -> list[TableRow]:
        """The rows to print."""
        return [row for row in self.rows if self._is_printed(row)]

    def _is_printed(self, row: TableRow) -> bool:
        """Return whether a row ran or is printed without, and is of a chosen method."""
        if not (self.prints_unrun or row.scored or row.failed):
            return False
        return not self.methods or not self.methods.isdisjoint({row.method, row.base_name})

    @property
    def sample(self) -> Record:
        """A record of its data."""
        return next(iter(self.samples.values()))[0]

    @property
    def is_of_own_data(self) -> bool:
        """Whether it is the table of a data set, and has no name but that of the data."""
        return self.table not in TABLES or self.table.identifier == self.dataset

    @property
    def own_gallery(self) -> str:
        """Gallery of a table of own data, "against models"; "" if it is the data themselves."""
        if not (self.is_of_own_data and self.table.is_cross):
            return ""
        return self.table.identifier.removeprefix(self.dataset).strip()

    # What it is called
    # --------------------------------------------------------------------------------------------

    @property
    def size(self) -> str:
        """Numbers of shapes and classes of the galleries of each column."""
        texts = {column.title: _size(self.samples[column.title]) for column in self.columns}
        if len(set(texts.values())) == 1:
            return next(iter(texts.values()))
        return "; ".join(f"{title}: {text}" for title, text in texts.items())

    @property
    def caption(self) -> str:
        """Caption with the data; it says if they are a stand-in."""
        caption = self.table.caption
        title = self.title
        # That of a folder names its data already.
        data = "" if f" {title}" in caption or f"/{title}" in caption else f": {title}"
        quick = f", {QUICK_RUN}" if self.quick else ""
        return f"{caption}{data} ({self.size}{quick}){self.scored_by.caption}"

    @property
    def stem(self) -> str:
        """Name of its files without the extension."""
        name = f"table-{self.table.identifier}"
        if not self.is_of_own_data:
            change = change_of(self.dataset) or [self.dataset.removesuffix("[draw=0]")]
            name = "-".join([name, *change])
        stem = file_name(name + self.scored_by.suffix)
        return f"{stem}-quick" if self.quick else stem

    # Scores
    # --------------------------------------------------------------------------------------------

    @property
    def groups(self) -> list[str]:
        """Titles of the groups of scores: the paper's, ours, and ranks by a second scorer."""
        titles = [column.title for column in self.columns]
        if self.paper:
            titles.insert(0, PAPER)
        if self.ranks:
            titles.append(SECOND)
        return titles

    def measures_of(self, group: str) -> tuple[str, ...]:
        """Return the measures that a group of scores shows."""
        if group in (PAPER, SECOND):
            return PAPER_MEASURES
        return self.measures

    def scores(self, row: TableRow, group: str) -> Mapping[str, float]:
        """Return the scores of a row in a group, by measure; empty if it has none."""
        if group == PAPER:
            return self.paper.get(row.method, {})
        if group == SECOND:
            ranks = self.ranks.get(row.method, {})
            return {measure: both.by_second for measure, both in ranks.items()}
        if group in row.scored:
            return row.scored[group].means
        return {}

    def of_folds(self, row: TableRow, group: str) -> list[tuple[float, float]]:
        """Return the least and the greatest score of a row over folds, by measure.

        It is empty for a group without folds, and for a row that has scores of a single one.
        """
        has_folds = any(column.title == group and len(column.parts) > 1 for column in self.columns)
        if not has_folds or group not in row.scored:
            return []
        of_galleries = row.scored[group].of_galleries
        if len(of_galleries) == 1:
            return []
        return [(min(scores), max(scores)) for scores in of_galleries.T.tolist()]

    @cached_property
    def chance(self) -> dict[str, dict[str, float]]:
        """Scores of a random order, by column: means over galleries."""
        return {title: _chance(samples, self.measures) for title, samples in self.samples.items()}

    # Ranks by a second scorer
    # --------------------------------------------------------------------------------------------

    @property
    def has_ranks(self) -> bool:
        """Whether it may show ranks by a second scorer, as full runs of III and III-view do."""
        is_table_iii = (self.table.part_of or self.table.identifier) == "III"
        is_of_tosca = is_table_iii and self.dataset == "tosca"
        return is_of_tosca and not (self.quick or self.scored_by.caption)

    @cached_property
    def ranks(self) -> dict[str, dict[str, Ranks]]:
        """Ranks by both scorers, by method and measure, where both scored the same forms."""
        if not self.has_ranks:
            return {}
        title = self.columns[0].title
        scores = {row.method: self.scores(row, title) for row in self.rows}
        input_ = "view" if self.table.part_of else "mesh"
        return ranks_by_both(scores, input_)

    # Tests and marks
    # --------------------------------------------------------------------------------------------

    @cached_property
    def tests(self) -> dict[tuple[str, Block], ComparedRivals]:
        """Rivals with the outcome of their tests, by column and block.

        For blocks with several rivals.
        """
        tests = {}
        for column, block in product(self.columns, BLOCKS):
            rivals = self._rivals(column.title, block)
            if len(rivals) > 1:
                tests[column.title, block] = compare_rivals(rivals)
        return tests

    def _rivals(self, title: str, block: Block) -> dict[str, RowScores]:
        """Return the rows of a block that can be compared in a column, by method."""
        return {
            row.method: row.scored[title]
            for row in self.rows
            if row.kind == block and title in row.scored and row.scored[title].is_rival()
        }

    @cached_property
    def marks(self) -> dict[tuple[str, str], dict[str, str]]:
        """Marks of the scores of rivals, by method and column, then by measure."""
        marks = {}
        for (title, _), tested in self.tests.items():
            if tested.n_classes >= FEWEST_CLASSES:
                for method, of_row in tested.marks().items():
                    marks[method, title] = of_row
        return marks


def _size(samples: Sequence[Record]) -> str:
    """Return in words how many shapes and classes a column of a table is about.

    Parameters
    ----------
    samples
        One record of each gallery over which the column shows the mean, such as draws of one data
        set. They are of the same size.
    """
    first = samples[0]
    labels = ranked_classes(first)  # of queries that have something to find
    n_queries = len(labels)
    n_classes = len(set(labels))
    if first.gallery_of_queries is None:  # the queries are the gallery
        times = f"{len(samples)} x " if len(samples) > 1 else ""
        return f"{times}{n_queries} shapes of {n_classes} classes"
    n_omitted = len(first.shapes) - n_queries
    omitted = f", {n_omitted} left out" if n_omitted else ""
    n_ranked = len(first.gallery_of_queries.shapes)
    return f"{n_queries} queries of {n_classes} classes{omitted}, among {n_ranked} shapes"


def _chance(samples: Sequence[Record], measures: Sequence[str]) -> dict[str, float]:
    """Return the scores of a random order: means over galleries, by measure."""
    levels = [chance_levels(sample.labels, sample.targets) for sample in samples]
    means = {}
    for measure in measures:
        of_galleries = [of_gallery[measure] for of_gallery in levels]
        means[measure] = statistics.fmean(of_galleries)
    return means
