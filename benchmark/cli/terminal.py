"""Tables and progress in the terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Sequence

from rich.box import Box
from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.progress import track
from rich.table import Table
from rich.text import Text

from benchmark.api.datasets import Entry
from benchmark.report.content import TableContent
from benchmark.report.formats import markdown
from benchmark.report.frame import Style, figures, lines
from benchmark.report.notes import notes
from benchmark.text import clean, say, say_lines

#: Seconds between lines of progress without a terminal.
INTERVAL = 10.0

_STYLE = Style("{}", "{}", "±{}")
_FONTS = {"best": "bold", "inseparable": "italic", "": ""}

#: Terminal width that fits any table.
_WIDEST = 10_000

#: Least width of titles of methods.
_NARROWEST = 14

#: Borders of a table for rich: a rule below the heading, and a space between columns.
_RULE = "    \n    \n ── \n    \n    \n    \n    \n    \n"


def counting(what: str, entries: Sequence[Entry]) -> Iterator[Entry]:
    """Yield shapes and show progress on stderr: a bar in a terminal, otherwise occasional lines.

    Parameters
    ----------
    what
        Description, e.g. ``"checking humans"``.
    entries
        The shapes.
    """
    is_generated = any(entry.path is None for entry in entries)
    title = clean(f"{what}{', each shape generated first' if is_generated else ''}")
    if sys.stderr.isatty():
        yield from track(entries, escape(title), console=Console(file=sys.stderr))
        return
    say(f"{title}: 0 of {len(entries)}", err=True)
    start = shown = time.monotonic()
    for number, entry in enumerate(entries):
        now = time.monotonic()
        if number and now - shown >= INTERVAL:
            left = (now - start) / number * (len(entries) - number)
            say(f"{number} of {len(entries)}, about {left:.0f} s left", err=True)
            shown = now
        yield entry
    say(f"{len(entries)} of {len(entries)}", err=True)


def print_tables(tables: Iterable[TableContent], most_notes: int | None = None) -> None:
    """Print tables with so many notes: fitted to the width of a terminal, otherwise as Markdown."""
    if not sys.stdout.isatty():
        for table in tables:
            say_lines("\n" + markdown(table, most_notes))
        return
    console = Console(file=sys.stdout, highlight=False)
    for table in tables:
        whole = drawn(table)
        fits = Console(width=_WIDEST).measure(whole).minimum <= console.width
        for part in [whole] if fits else [drawn(table, name) for name in figures(table)["group"].unique()]:
            console.print()
            console.print(part)
        for note in notes(table, most=most_notes):
            console.print(Padding(Text(f"- {clean(note)}"), (0, 0, 0, 1)))


def drawn(table: TableContent, only: str = "") -> Table:
    """Return a table for rich; in a narrow terminal, titles of methods are wrapped, figures are not.

    Parameters
    ----------
    table
        The table.
    only
        Title of the group of columns to include; all by default.
    """
    rows = [
        (row, label, [figure for figure in row_figures if only in ("", figure["group"])])
        for row, label, row_figures in lines(table)
    ]
    title = f"Table {table.identifier}. {table.caption}: {table.data_title} ({table.size})."
    grid = Table(
        title=Text(clean(title)), title_justify="left", title_style="bold", box=Box(_RULE), show_edge=False,
        pad_edge=False, padding=0,
    )  # fmt: skip
    grid.add_column("Method", overflow="fold", min_width=_NARROWEST)
    for figure in rows[0][-1]:
        grid.add_column(f"{figure['group']}\n{figure['measure']}", justify="right", no_wrap=True)
    for row, label, row_figures in rows:
        cells = [Text(_STYLE.write(figure), style=_FONTS[figure["mark"]]) for figure in row_figures]
        grid.add_row(Text(clean(label), style="" if row else "italic"), *cells)
    return grid
