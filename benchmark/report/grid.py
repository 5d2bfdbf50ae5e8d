"""The grid of a table: its groups of columns, and the figures of each line; every format writes it in its own style.

A column that is no measure is a group of its own: its kind, and the function in ``_COLUMNS`` that makes its figures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from benchmark.api.contracts import Input
from benchmark.report.cell import Cell, Figures
from benchmark.report.content import Row, TableContent
from benchmark.report.rounding import BLANK, number
from benchmark.report.statistics.table_significance import CONTROL
from retrieval.measures import PRINTED

Kind = Literal["paper", "ours", "difference", "interval"]


@dataclass(frozen=True)
class Group:
    """Columns of one origin.

    Parameters
    ----------
    title
        What stands over them.
    kind
        The paper's figures, ours, ours minus the paper's, or the intervals of ours.
    input
        The input of our figures; None for those of the paper.
    names
        Headings of the columns.
    """

    title: str
    kind: Kind
    input: Input | None = None
    names: tuple[str, ...] = PRINTED


@dataclass(frozen=True)
class Figure:
    """A figure as it is printed.

    Parameters
    ----------
    text
        The figure; :data:`BLANK` for none.
    mark
        Whether it is the best of its column, or cannot be told from the best.
    spread
        Standard deviation behind a mean; "" for none.
    interval
        The ends of its interval; "" for none.
    """

    text: str
    mark: Literal["", "best", "inseparable"] = ""
    spread: str = ""
    interval: str = ""


@dataclass(frozen=True)
class Line:
    """A line of the grid.

    Parameters
    ----------
    label
        What stands before it.
    groups
        Its figures by group.
    row
        The row that it prints; None for the chance level.
    """

    label: str
    groups: tuple[tuple[Figure, ...], ...]
    row: Row | None = None

    @property
    def figures(self) -> list[Figure]:
        """All figures from left to right."""
        return [figure for group in self.groups for figure in group]


@dataclass(frozen=True)
class Grid:
    """Columns and lines of a table; the last line is the chance level."""

    groups: tuple[Group, ...]
    lines: tuple[Line, ...]


@dataclass(frozen=True)
class Style:
    """Style of figures in a format.

    Parameters
    ----------
    best, inseparable
        Patterns of a figure that is the best of its column, and of one that cannot be told from it.
    spread
        Pattern of a standard deviation behind a mean.
    minus
        The sign of a negative difference.
    """

    best: str
    inseparable: str
    spread: str = " ± {}"
    minus: str = "-"

    def write(self, figure: Figure) -> str:
        """Return a figure with its mark and its spread."""
        text = figure.text
        if text.startswith("-") and text != BLANK:
            text = self.minus + text[1:]
        patterns = {"best": self.best, "inseparable": self.inseparable, "": "{}"}
        return patterns[figure.mark].format(text) + (self.spread.format(figure.spread) if figure.spread else "")


def grid_of(table: TableContent, further: Sequence[Group] = ()) -> Grid:
    """Return the grid of a table: the paper first, if it has the table, then the inputs, then further groups.

    Marked as best is what reads as best: figures are compared after rounding, and equals are all marked. Controls take
    no part. Means are followed by their spread.
    """
    paper = [Group("paper", "paper")] if table.has_paper else []
    groups = (*paper, *(Group(input_, "ours", input_, PRINTED) for input_ in table.inputs), *further)
    made = [_lines(table, group) for group in groups]
    lines = [Line(table.label(row), tuple(figures), row) for row, *figures in zip(table.rows, *made, strict=True)]
    return Grid(groups, (*lines, Line("Chance", tuple(_chance(table, group) for group in groups))))


def _lines(table: TableContent, group: Group) -> list[tuple[Figure, ...]]:
    """Figures of a group, row by row."""
    columns = [_COLUMNS[group.kind](table, group.input, name) for name in group.names]
    return list(zip(*columns, strict=True))


def _paper(table: TableContent, input_: Input | None, measure: str) -> list[Figure]:
    return [Figure(number(_value(row.paper, measure))) for row in table.rows]


def _ours(table: TableContent, input_: Input | None, measure: str) -> list[Figure]:
    cells = [row.cells.get(input_) if input_ else None for row in table.rows]
    texts = [number(_value(cell.scores if cell else None, measure)) for cell in cells]
    competes = [_competes(row, cell) for row, cell in zip(table.rows, cells, strict=True)]
    highest = max((text for text, may in zip(texts, competes, strict=True) if may and text != BLANK), default="")
    found = []
    for row, cell, text, may in zip(table.rows, cells, texts, competes, strict=True):
        judged = table.significance.get((row.method, input_, measure)) if input_ else None
        is_best, is_inseparable = may and text == highest, judged is not None and judged.is_inseparable
        found.append(
            Figure(
                text,
                "best" if is_best else "inseparable" if is_inseparable else "",
                number(cell.deviation[measure]) if cell and cell.deviation and measure in cell.deviation else "",
                f"{number(judged.low)} to {number(judged.high)}" if judged else "",
            )
        )
    return found


def _difference(table: TableContent, input_: Input | None, measure: str) -> list[Figure]:
    """Our figures minus the paper's, both as they are printed, so that a reader finds the same."""
    ours, theirs = _ours(table, input_, measure), _paper(table, None, measure)
    return [Figure(_signed(a.text, b.text)) for a, b in zip(ours, theirs, strict=True)]


def _interval(table: TableContent, input_: Input | None, measure: str) -> list[Figure]:
    return [Figure(each.interval.replace(" to ", "\u2013") or BLANK) for each in _ours(table, input_, measure)]


def _signed(ours: str, theirs: str) -> str:
    if BLANK in (ours, theirs):
        return BLANK
    hundredths = round(float(ours) * 100) - round(float(theirs) * 100)
    return f"{'-' if hundredths < 0 else '+' if hundredths else ''}{number(abs(hundredths) / 100)}"


#: The figures of all rows in a column, by the kind of its group.
_COLUMNS: Mapping[Kind, Callable[[TableContent, Input | None, str], list[Figure]]] = {
    "paper": _paper,
    "ours": _ours,
    "difference": _difference,
    "interval": _interval,
}


def _chance(table: TableContent, group: Group) -> tuple[Figure, ...]:
    if group.kind in ("difference", "interval"):
        return (Figure(BLANK),) * len(group.names)
    return tuple(Figure(number(table.chance[name])) for name in group.names)


def _competes(row: Row, cell: Cell | None) -> bool:
    """Return whether the figures of a row may be the best: those of a control, or of some shapes alone, may not."""
    return row.family != CONTROL and not (cell and cell.is_partial)


def _value(scores: Figures | None, measure: str) -> float | None:
    return scores.get(measure) if scores else None
