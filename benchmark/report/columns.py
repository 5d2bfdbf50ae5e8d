"""Columns of a table, and the text of its cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmark.api.contracts import Input
from benchmark.report.cell import Cell, Figures
from benchmark.report.content import Row, TableContent
from benchmark.report.statistics.table_significance import CONTROL
from retrieval.measures import PRINTED

BLANK = "--"


@dataclass(frozen=True)
class Group:
    """Columns of one origin, one for each measure.

    Parameters
    ----------
    title
        What stands over them.
    input
        The input of our figures; None for those of the paper.
    is_difference
        Whether it is our figure minus the paper's.
    """

    title: str
    input: Input | None = None
    is_difference: bool = False


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


def groups_of(table: TableContent) -> list[Group]:
    """The paper first, if it has the table, then the inputs."""
    ours = [Group(input_, input_) for input_ in table.inputs]
    return [Group("paper"), *ours] if table.has_paper else ours


def cells(table: TableContent, groups: Sequence[Group], style: Style) -> list[list[str]]:
    """Format the figures of each row; of our columns the best, and what cannot be told from it, are marked.

    Marked as best is what reads as best: figures are compared after rounding, and equals are all marked. Controls take
    no part. Means are followed by their spread.
    """
    columns = [_column(table, group, metric, style) for group in groups for metric in PRINTED]
    return [list(line) for line in zip(*columns, strict=True)]


def _column(table: TableContent, group: Group, metric: str, style: Style) -> list[str]:
    if group.is_difference:
        return [_difference(row, group.input, metric, style.minus) for row in table.rows]
    contest = [number(_value(row, group.input, metric)) for row in table.rows if _competes(row, group.input)]
    highest = max((text for text in contest if text != BLANK), default="") if group.input else ""
    return [_marked(table, row, group.input, metric, style, highest) for row in table.rows]


def _marked(
    table: TableContent, row: Row, input_: Input | None, metric: str, style: Style, highest: str
) -> str:  # fmt: skip
    text = number(_value(row, input_, metric))
    marked = text
    if _competes(row, input_) and text == highest:
        marked = style.best.format(text)
    elif input_ and (judged := table.significance.get((row.method, input_, metric))) and judged.is_inseparable:
        marked = style.inseparable.format(text)
    cell = _cell(row, input_)
    return (
        marked if cell is None or not cell.deviation else marked + style.spread.format(number(cell.deviation[metric]))
    )


def _competes(row: Row, input_: Input | None) -> bool:
    """Return whether the figures of a row may be the best: those of a control, or of some shapes alone, may not."""
    cell = _cell(row, input_)
    return row.family != CONTROL and not (cell and cell.is_partial)


def _difference(row: Row, input_: Input | None, metric: str, minus: str) -> str:
    """Our figure minus the paper's, both as they are printed, so that a reader finds the same."""
    ours, theirs = _value(row, input_, metric), _value(row, None, metric)
    if ours is None or theirs is None:
        return BLANK
    hundredths = round(float(number(ours)) * 100) - round(float(number(theirs)) * 100)
    return f"{minus if hundredths < 0 else '+' if hundredths else ''}{number(abs(hundredths) / 100)}"


def _value(row: Row, input_: Input | None, metric: str) -> float | None:
    cell = _cell(row, input_)
    scores: Figures | None = row.paper if input_ is None else cell.scores if cell else None
    return scores[metric] if scores else None


def _cell(row: Row, input_: Input | None) -> Cell | None:
    return row.cells.get(input_) if input_ else None


def number(value: float | None) -> str:
    """Two decimals, as the paper prints them."""
    return BLANK if value is None else f"{value:.2f}"
