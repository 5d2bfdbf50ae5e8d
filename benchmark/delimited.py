"""Tables in text: their lines, what separates their cells, and their cells."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence

from benchmark.errors import ConfigurationError
from benchmark.files import decode

#: What may separate cells, and what an error calls it.
SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}

#: A cell in quotes, in which separators are text.
_QUOTED = re.compile(r'(?<![^;,\t ])"(?:[^"]|"")*"(?![^;,\t ])')

#: A blank beside another separator.
_BESIDE_SEPARATOR = re.compile("[;,\t] | [;,\t]")

#: A first line that tells Excel which separator follows.
_FOR_EXCEL = re.compile(r'"?sep=.?"?', re.IGNORECASE)

#: Rows of a table, each with its cells.
TextRows = list[list[str]]


def lines_of(content: bytes) -> list[str]:
    """Return the lines of a table in a text file, without blank lines and comments (``#``).

    Parameters
    ----------
    content
        Bytes of the file.

    Raises
    ------
    ConfigurationError
        If there are no lines, or they are no plain table but JSON, or begin with a line for Excel.
    UnicodeError
        If the content is no text.
    """
    lines = []
    for line in decode(content).splitlines():
        is_comment = line.lstrip().startswith("#")
        if line.strip() and not is_comment:
            lines.append(line)
    if not lines:
        raise ConfigurationError("it is empty", "name another file")
    first = lines[0].strip()
    if _FOR_EXCEL.fullmatch(first):
        problem = f"its first line, '{first}', is for Excel and no row of the table"
        raise ConfigurationError(problem, "delete the first line")
    if first.startswith(("{", "[")):
        problem = f"it begins with '{first[0]}', as JSON and printed lists of Python do"
        raise ConfigurationError(problem, "write one row on each line, without brackets")
    if all(line.rstrip().endswith(";") for line in lines):  # as MATLAB ends rows
        return [line.rstrip(" ;") for line in lines]
    return lines


def separators_of(lines: Sequence[str], *, has_short_first: bool = False) -> list[str]:
    """Return what may separate the cells of lines.

    That is what occurs equally often in each line, outside of quotes.

    Parameters
    ----------
    lines
        The lines.
    has_short_first
        Whether the first line may have one cell less, as R leaves out the corner of a table.
    """
    bare = [_QUOTED.sub("q", line) for line in lines]
    return [mark for mark in SEPARATORS if _fits(mark, bare, has_short_first=has_short_first)]


def _fits(mark: str, lines: Sequence[str], *, has_short_first: bool) -> bool:
    """Return whether a separator divides all lines into the same number of cells.

    Parameters
    ----------
    mark
        The separator, such as ``","``. Of blanks, several in a row separate once.
    lines
        The lines of a table, without texts in quotes.
    has_short_first
        Whether the first line may have one cell less: it then holds the names of the columns, but
        nothing above the names of the rows.
    """
    if mark == " ":
        # Blanks around another separator, as in "a, b", separate nothing themselves.
        if any(_BESIDE_SEPARATOR.search(line) for line in lines):
            return False
        counts = [len(re.findall(" +", line.strip())) for line in lines]
    else:
        counts = [line.count(mark) for line in lines]

    # All lines after the first must agree; the only line of a table agrees with itself.
    first = counts[0]
    others = counts[1:] or counts
    usual = others[-1]
    if usual == 0 or any(count != usual for count in others):
        return False
    return first == usual or (has_short_first and first == usual - 1)


def holds_separator(line: str) -> bool:
    """Return whether a line has something outside of quotes that may separate cells."""
    bare = _QUOTED.sub("q", line.strip())
    return any(mark in bare for mark in SEPARATORS)


def usual_separator(lines: Iterable[str]) -> str:
    """Return the likeliest separator of lines in which none occurs equally often."""
    text = "\n".join(lines)
    for mark in SEPARATORS:
        if mark in text:
            return mark
    return " "


def cells_of(lines: Sequence[str], separator: str) -> TextRows:
    """Split lines at a separator.

    Cells may be in quotes. Empty cells that end each line are left out.

    Raises
    ------
    csv.Error
        If a quote does not end, or text follows it.
    """
    if separator == " ":
        lines = [line.strip() for line in lines]
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)
    rows = [_stripped(row) for row in reader]
    while all(len(row) > 1 and row[-1] == "" for row in rows):
        rows = [row[:-1] for row in rows]
    return rows


def _stripped(cells: Iterable[str]) -> list[str]:
    """Return cells without blanks around them."""
    return [cell.strip() for cell in cells]


def ambiguous(separators: Sequence[str]) -> ConfigurationError:
    """Return the error for lines that several separators divide."""
    names = [SEPARATORS[mark] for mark in separators]
    problem = f"{' and '.join(names)} divide each of its lines, so its cells are unknown"
    hint = "put cells that hold a separator in quotes, or separate the cells by another one"
    return ConfigurationError(problem, hint)
