"""Markdown on a terminal, whose tables keep the scores of a row below those of the row before.

A table of Markdown has the scores of a gallery in one cell, which rich would divide between two
lines where the terminal is narrow. Here they stay on one line, each below its measure. A table that
is wider than the terminal is continued below.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import ClassVar

from rich import box
from rich.console import Console, ConsoleOptions, NewLine, RenderResult
from rich.markdown import Markdown, TableElement
from rich.table import Table
from rich.text import Text

#: Characters that the names of rows get at least, if they are as long.
_LEAST_NAMES = 20

#: Blanks between two columns.
_GAP = 2

#: Style of headings, from the theme of rich.
_HEADING = "markdown.table.header"

#: The heading of a group of columns that names them: ``paper: NN FT ST DCG``.
_NAMED_GROUP = re.compile(r"(?P<title>.*): (?P<names>\S+(?: \S+)+)")


@dataclass(frozen=True)
class _Column:
    """A column of a table: its heading, which may have several lines, and its cells."""

    heading: Text
    cells: Sequence[Text]

    @property
    def width(self) -> int:
        """Characters of its longest line."""
        texts = [self.heading, *self.cells]
        lines = chain.from_iterable(text.split("\n") for text in texts)
        return max((line.cell_len for line in lines), default=0)


class _ScoresElement(TableElement):
    """A table of Markdown, in parts that fit the terminal."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        if self.header is None or self.header.row is None:
            return
        headings = [cell.content for cell in self.header.row.cells]
        cells = [self._cells_of(number) for number in range(len(headings))]
        names, *scores = [*zip(headings, cells, strict=True)]
        measures = _measures(headings)
        columns = [_column(heading.plain, texts, measures) for heading, texts in scores]
        yield from _tables(_Column(*names), columns, options.max_width)

    def _cells_of(self, number: int) -> list[Text]:
        """Return the cells of a column, without its heading."""
        rows = [] if self.body is None else self.body.rows
        return [row.cells[number].content for row in rows]


class TerminalMarkdown(Markdown):
    """Markdown with tables of scores."""

    elements: ClassVar = {**Markdown.elements, "table_open": _ScoresElement}


def _measures(headings: Iterable[Text]) -> list[str]:
    """Return the names of the measures of each group, which the heading of the first one lists."""
    for heading in headings:
        named = _NAMED_GROUP.fullmatch(heading.plain)
        if named is not None:
            return named["names"].split()
    return []


def _column(heading: str, cells: Sequence[Text], measures: Sequence[str]) -> _Column:
    """Return a column whose scores stand below their measures."""
    named = _NAMED_GROUP.fullmatch(heading)
    title = named["title"] if named else heading
    has_measures = any(len(cell.plain.split()) == len(measures) for cell in cells)
    if not measures or not has_measures:
        return _Column(_wrapped(title, cells), cells)
    names, *aligned = _aligned([Text(" ".join(measures)), *cells])
    lines = [_wrapped(title, [names]), Text(names.plain)]
    return _Column(Text("\n").join(lines), aligned)


def _wrapped(title: str, cells: Iterable[Text]) -> Text:
    """Return a heading in lines that are no longer than the cells, or than its longest word."""
    words = title.split()
    longest = max((cell.cell_len for cell in cells), default=0)
    width = max(longest, 1, *map(len, words))
    return Text("\n".join(textwrap.wrap(title, width, break_on_hyphens=False)))


def _aligned(cells: Sequence[Text]) -> list[Text]:
    """Return cells whose words stand below each other; those with fewer words stay as they are."""
    rows = [[*cell.split(" ")] for cell in cells]
    n_words = max(map(len, rows))
    whole = [row for row in rows if len(row) == n_words]
    for words in zip(*whole, strict=True):
        _align(words)
    return [
        Text(" ").join(row) if len(row) == n_words else cell
        for row, cell in zip(rows, cells, strict=True)
    ]


def _align(words: Sequence[Text]) -> None:
    """Fill words with blanks, so that numbers end at one place, with or without a parenthesis."""
    if any(word.plain.endswith(")") for word in words):
        for word in words:
            if not word.plain.endswith(")"):
                word.pad_right(1)
    width = max(word.cell_len for word in words)
    for word in words:
        word.pad_left(width - word.cell_len)


def _tables(names: _Column, columns: Iterable[_Column], room: int) -> Iterator[Table | NewLine]:
    """Yield a wide table in parts that fit a terminal, each with the names of the rows.

    Parameters
    ----------
    names
        The first column, with the names of the rows. It is wrapped where there is little room.
    columns
        The other columns, which are not wrapped.
    room
        Characters on a line of the terminal.
    """
    least = min(names.width, _LEAST_NAMES)
    # Add columns to a part until the next one does not fit.
    parts: list[list[_Column]] = [[]]
    used = least
    for column in columns:
        needed = _GAP + column.width
        if parts[-1] and used + needed > room:
            parts.append([])
            used = least
        parts[-1].append(column)
        used += needed
    for number, part in enumerate(parts):
        if number:
            yield NewLine()
        yield _table(names, part)


def _table(names: _Column, columns: Sequence[_Column]) -> Table:
    """Return a table whose names of rows alone may be divided between lines."""
    table = Table(
        box=box.SIMPLE_HEAD,
        header_style=_HEADING,
        show_edge=False,
        pad_edge=False,
        padding=(0, _GAP - 1, 0, 0),  # and the blank of the box
    )
    table.add_column(names.heading, vertical="top")
    for column in columns:
        table.add_column(column.heading, justify="right", no_wrap=True, vertical="top")
    for row in zip(names.cells, *(column.cells for column in columns), strict=True):
        if any(cell.plain for cell in row):  # a range over folds has no name
            table.add_row(*row)
    return table
