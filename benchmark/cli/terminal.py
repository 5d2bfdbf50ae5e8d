"""Tables for a reader at a terminal, drawn to its width."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from benchmark.report.grid import Figure, Style, grid_of
from benchmark.report.notes import notes
from benchmark.text import clean

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from benchmark.report.content import TableContent

__all__ = ["draw", "drawn"]

_STYLE = Style("{}", "{}", "±{}")

_FONTS = {"best": "bold", "inseparable": "italic", "": ""}

#: More columns than a table has.
_WIDEST = 10_000

#: Columns that the titles of methods have at least.
_NARROWEST = 14

#: Lines of a table as rich wants them: a rule below the heading, and a blank between columns.
_RULE = "    \n    \n ── \n    \n    \n    \n    \n    \n"


def draw(tables: Iterable[TableContent]) -> None:
    """Draw tables to the width of the terminal, with their notes."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    console = Console(file=sys.stdout, highlight=False)
    for table in tables:
        whole = drawn(table)
        fits = Console(width=_WIDEST).measure(whole).minimum <= console.width
        for part in [whole] if fits else [drawn(table, group) for group in range(len(grid_of(table).groups))]:
            console.print()
            console.print(part)
        for note in notes(table):
            console.print(Padding(Text(f"- {clean(note)}"), (0, 0, 0, 1)))


def drawn(table: TableContent, only: int | None = None) -> Table:
    """A table for rich: figures stay whole, titles of methods are broken where the terminal is narrow.

    Parameters
    ----------
    table
        The table.
    only
        Which of its groups of columns to draw; all by default.
    """
    from rich.box import Box
    from rich.table import Table
    from rich.text import Text

    grid = grid_of(table)
    shown = range(len(grid.groups)) if only is None else [only]
    title = f"Table {table.identifier}. {table.caption}: {table.data_title} ({table.size})."
    made = Table(
        title=Text(clean(title)), title_justify="left", title_style="bold", box=Box(_RULE), show_edge=False,
        pad_edge=False, padding=0,
    )  # fmt: skip
    made.add_column("Method", overflow="fold", min_width=_NARROWEST)
    for group in (grid.groups[place] for place in shown):
        for name in group.names:
            made.add_column(f"{group.title}\n{name}", justify="right", no_wrap=True)
    for line in grid.lines:
        label = Text(clean(line.label), style="" if line.row else "italic")
        made.add_row(label, *(_drawn(figure) for place in shown for figure in line.groups[place]))
    return made


def _drawn(figure: Figure) -> Text:
    from rich.text import Text

    return Text(_STYLE.write(figure), style=_FONTS[figure.mark])
