"""Tables for a reader at a terminal, drawn to its width."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from benchmark.report.frame import Style, figures, lines
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
        for part in [whole] if fits else [drawn(table, name) for name in figures(table)["group"].unique()]:
            console.print()
            console.print(part)
        for note in notes(table):
            console.print(Padding(Text(f"- {clean(note)}"), (0, 0, 0, 1)))


def drawn(table: TableContent, only: str = "") -> Table:
    """A table for rich: figures stay whole, titles of methods are broken where the terminal is narrow.

    Parameters
    ----------
    table
        The table.
    only
        Title of the group of columns to draw; all by default.
    """
    from rich.box import Box
    from rich.table import Table
    from rich.text import Text

    shown = [
        (row, label, [figure for figure in of_row if only in ("", figure["group"])])
        for row, label, of_row in lines(table)
    ]
    title = f"Table {table.identifier}. {table.caption}: {table.data_title} ({table.size})."
    made = Table(
        title=Text(clean(title)), title_justify="left", title_style="bold", box=Box(_RULE), show_edge=False,
        pad_edge=False, padding=0,
    )  # fmt: skip
    made.add_column("Method", overflow="fold", min_width=_NARROWEST)
    for figure in shown[0][-1]:
        made.add_column(f"{figure['group']}\n{figure['measure']}", justify="right", no_wrap=True)
    for row, label, of_row in shown:
        made.add_row(Text(clean(label), style="" if row else "italic"), *map(_drawn, of_row))
    return made


def _drawn(figure: Mapping[str, str]) -> Text:
    from rich.text import Text

    return Text(_STYLE.write(figure), style=_FONTS[figure["mark"]])
