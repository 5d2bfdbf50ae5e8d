"""The overview of a report: one measure of each method on each data set, and which rows lead."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

from benchmark.protocols.tables import AGAINST, SURFACES, TABLES, Block, GalleryGroup
from benchmark.report.notes import block_lead, is_tested_whole
from benchmark.report.page_builder import Pages, data_label
from benchmark.report.rows import BLOCKS, RowScores, TableRow
from benchmark.report.table_view import TableView

#: Groups of the columns of the overview.
OVERVIEW_GROUPS = ("Complete surfaces", "One depth view", "View against surfaces")

#: Numbers of the groups.
_OF_SURFACES = 0
_OF_VIEWS = 1
_AGAINST_SURFACES = 2


class _Place(NamedTuple):
    """Where a column of a table stands in the overview: number of its group, label, and data set.

    Two data sets may have one label.
    """

    group: int
    label: str
    dataset: str


class _ColumnOfTable(NamedTuple):
    """A column of a table."""

    view: TableView
    column: GalleryGroup


class _Cell(NamedTuple):
    """A row in a column of the overview, its scores, and whether these are of views."""

    row: TableRow
    scores: RowScores
    is_view: bool


def matrix_of(pages: Pages, views: Iterable[TableView]) -> dict[str, Any]:
    """Return the content of the overview: a row for each method, a column for each data set.

    Parameters
    ----------
    pages
        The report, which knows the page of each table.
    views
        The tables, whose columns become columns of the overview.

    Returns
    -------
    dict
        What the template ``matrix.html`` reads: ``columns`` (for each its label, the name of its
        page, its table, and its column there), ``groups`` (number of columns by heading), ``rows``
        (by block and title of the row, its cell in each column, or None) and ``leads`` (sentences
        on the rows that lead).
    """
    # The same column may stand in several tables; the first one counts.
    columns: dict[_Place, _ColumnOfTable] = {}
    for view in views:
        for column in view.columns:
            columns.setdefault(_place(view, column), _ColumnOfTable(view, column))
    # Columns of a group keep their order, as sorting is stable.
    places = sorted(columns, key=lambda place: place.group)
    headings = []
    for place in places:
        view, column = columns[place]
        headings.append((place.label, pages.main(view).stem, view, column))
    rows_of_blocks = {}
    for block, heading in BLOCKS.items():
        rows = _rows_of_block(block, columns, places)
        if rows:
            rows_of_blocks[heading] = rows
    return {
        "columns": headings,
        "groups": _sizes_of_groups(places),
        "rows": rows_of_blocks,
        "leads": _leads(columns),
    }


def _place(view: TableView, column: GalleryGroup) -> _Place:
    """Return where a column of a table stands in the overview: its group and its label.

    Columns are grouped by what is compared: surfaces, depth views, or views with surfaces.
    """
    # The label names the data, and their part if the column does not show all of them.
    label = data_label(view)
    if view.table not in TABLES:
        label = ", ".join(filter(None, (label, *column.parts)))
    elif view.table.is_ablation:
        label += ", ablation"
    elif column.parts not in [("",), (SURFACES,)]:
        label += f", {column.title.removeprefix(AGAINST)}"
    is_against_others = any(part.startswith(AGAINST) for part in column.parts)
    group = _OF_SURFACES
    if column.input != "mesh" and is_against_others:
        group = _AGAINST_SURFACES
    elif column.input == "view":
        group = _OF_VIEWS
    return _Place(group, label, view.dataset)


def _sizes_of_groups(places: Iterable[_Place]) -> dict[str, int]:
    """Return how many columns each group has, by its heading."""
    sizes = dict.fromkeys(OVERVIEW_GROUPS, 0)
    for place in places:
        sizes[OVERVIEW_GROUPS[place.group]] += 1
    return sizes


def _rows_of_block(
    block: Block, columns: Mapping[_Place, _ColumnOfTable], places: Sequence[_Place]
) -> dict[str, list[_Cell | None]]:
    """Return the rows of a block, such as the canonical forms, in the overview.

    Parameters
    ----------
    block
        Name of the block.
    columns
        Columns of tables by their place in the overview.
    places
        The places in their order.

    Returns
    -------
    dict
        By title of a row, its cells in the order of the places; None where it has no scores.
    """
    cells_of_columns = []
    for place in places:
        has_own_views = place._replace(group=_OF_VIEWS) in columns
        cells = _cells_of_column(block, columns[place], has_own_views=has_own_views)
        cells_of_columns.append(cells)
    rows: dict[str, list[_Cell | None]] = {}
    for title in chain.from_iterable(cells_of_columns):
        rows[title] = [cells.get(title) for cells in cells_of_columns]
    return rows


def _cells_of_column(
    block: Block, column: _ColumnOfTable, *, has_own_views: bool
) -> dict[str, _Cell]:
    """Return the cells of one column of the overview, by the title of their row.

    Parameters
    ----------
    block
        Block of rows, such as ``"network"``.
    column
        A column with its table.
    has_own_views
        Whether the overview has a column for depth views of the same data. Scores of views, such as
        those of networks, are then left out of a column of complete surfaces.
    """
    title = column.column.title
    cells = {}
    for row in column.view.printed_rows:
        if row.kind != block or title not in row.scored:
            continue
        scores = row.scored[title]
        is_view = column.column.has_mixed_inputs and scores.all_records[0].input == "view"
        if is_view and has_own_views:
            continue
        cells[row.title] = _Cell(row, scores, is_view)
    return cells


def _leads(columns: Mapping[_Place, _ColumnOfTable]) -> list[str]:
    """Return a sentence on each row that is clearly above all other rows of its block.

    Clearly means significantly, and by more than repeated trainings or codebooks differ. The
    sentence names all the data on which the row leads. Quick runs decide nothing.
    """
    labels = defaultdict[str, list[str]](list)  # of the data, by first part of the sentence
    for place, (view, column) in sorted(columns.items()):
        for (title, block), tested in view.tests.items():
            # Networks see views, also in a column of surfaces.
            is_of_views = place.group == _OF_SURFACES and block == "network"
            if title != column.title or is_of_views or view.quick:
                continue
            row, n_worse = block_lead(view, title, block)
            if n_worse == len(tested.rivals) - 1:
                group = OVERVIEW_GROUPS[place.group]
                others = BLOCKS[block].lower()
                if not is_tested_whole(view, title, block):
                    others += " that are tested"
                leader = f"{group}: {row.title} scores above all other {others}"
                labels[leader].append(place.label)
    return [f"{leader} on {'; '.join(of_leader)}." for leader, of_leader in sorted(labels.items())]
