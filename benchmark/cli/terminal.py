"""Tables for a reader at a terminal, drawn to its width."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from benchmark.report.columns import Style, cells, groups_of, number
from benchmark.report.notes import notes
from benchmark.system.text import clean
from retrieval.measures import PRINTED

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from benchmark.report.content import TableContent

__all__ = ["draw", "drawn"]

#: What stands before the best figures, and those that cannot be told from them, until they are drawn.
_BEST, _INSEPARABLE = "\x00", "\x01"

_STYLES = {_BEST: "bold", _INSEPARABLE: "italic"}

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
        for part in [whole] if fits else [drawn(table, group) for group in range(len(groups_of(table)))]:
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

    groups = groups_of(table)
    shown = [place for place in range(len(groups) * len(PRINTED)) if only in (None, place // len(PRINTED))]
    title = f"Table {table.identifier}. {table.caption}: {table.data_title} ({table.size})."
    made = Table(
        title=Text(clean(title)), title_justify="left", title_style="bold", box=Box(_RULE), show_edge=False,
        pad_edge=False, padding=0,
    )  # fmt: skip
    made.add_column("Method", overflow="fold", min_width=_NARROWEST)
    for place in shown:
        made.add_column(
            f"{groups[place // len(PRINTED)].title}\n{PRINTED[place % len(PRINTED)]}", justify="right", no_wrap=True
        )
    style = Style(f"{_BEST}{{}}", f"{_INSEPARABLE}{{}}", "±{}")
    for row, values in zip(table.rows, cells(table, groups, style), strict=True):
        made.add_row(Text(clean(row.label)), *(_figure(values[place]) for place in shown))
    chance = [number(table.chance[PRINTED[place % len(PRINTED)]]) for place in shown]
    made.add_row(Text("Chance", style="italic"), *chance)
    return made


def _figure(text: str) -> Text:
    from rich.text import Text

    style = _STYLES.get(text[:1], "")
    return Text(text[1:] if style else text, style=style)
