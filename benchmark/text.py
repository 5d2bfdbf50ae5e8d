"""Text from users and plugins: check names, and clean titles and reasons before printing them."""

from __future__ import annotations

import io
import os
import re
import shutil
import sys
import textwrap
import unicodedata
from collections.abc import Collection, Iterable, Sequence

#: Longest reason in tables and lists of jobs, in characters.
LONGEST_REASON = 500

#: Longest message in a record, in characters.
LONGEST_MESSAGE = 1000

#: Longest text that a plugin passes, in characters.
LONGEST_TEXT = 20_000

#: Longest name, in characters: names become parts of file names.
LONGEST_NAME = 60

#: Number of names in a list before the rest is only counted.
_MOST_NAMED = 3

#: Pattern of names: lower-case words joined by hyphens.
NAME = rf"(?=.{{1,{LONGEST_NAME}}}$)[a-z][a-z0-9]*(-[a-z0-9]+)*"

#: Line breaks and tabs, with the blanks around them.
_BREAKS = re.compile("[ \xa0]*[\t\n\v\f\r\x1c-\x1f\x85\u2028\u2029]\\s*")

#: ANSI escape sequences for colours and cursor movements.
_TERMINAL_CODES = re.compile(r"(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]")

#: What stands for the rest of a text that is cut.
_ELLIPSIS = " ..."


def nfc(name: object) -> str:
    """Return a name with composed characters (NFC), which is the same from macOS and Linux."""
    return unicodedata.normalize("NFC", str(name))


def printable(name: str) -> str:
    r"""Return a name for records: in NFC, with escapes as in Python, such as ``\x00``.

    A backslash is escaped, too, so that no two names become one.
    """
    return "".join(map(_printable_in_name, nfc(name)))


def listed(texts: Iterable[str], joint: str = ", ") -> str:
    """Join the first few of some texts, and count the others."""
    named = list(texts)
    n_more = len(named) - _MOST_NAMED
    if n_more > 1:  # instead of "1 more", the last one is named
        named = [*named[:_MOST_NAMED], f"{n_more} more"]
    return joint.join(named)


def clean_text(text: object) -> str:
    r"""Return text as one printable line.

    Line breaks and tabs become one space, ANSI escape sequences are removed, and other characters
    that cannot be printed (control characters, changes of direction, surrogates) are escaped as in
    Python: ``\x00``.

    Parameters
    ----------
    text
        Anything; ``str`` is applied to it.
    """
    line = _as_text(text)
    if line.isprintable():
        return line
    line = _TERMINAL_CODES.sub("", line)
    line = _BREAKS.sub(" ", line)
    return "".join(map(_printable_in_line, line))


def counted(number: int, singular: str, plural: str = "") -> str:
    """Return a number and what it counts: ``1 vertex``, ``2 vertices``.

    The plural is that with an ``s`` unless it is given.
    """
    if number == 1:
        return f"1 {singular}"
    return f"{number} {plural or singular + 's'}"


def brief(text: object, longest: int = LONGEST_REASON) -> str:
    """Return cleaned text, cut to a number of characters."""
    line = clean_text(_as_text(text)[: 2 * longest])
    if len(line) <= longest:
        return line
    return line[: longest - len(_ELLIPSIS)] + _ELLIPSIS


def clean_lines(text: str) -> str:
    """Return text with cleaned lines, from which the middle is cut if it is very long."""
    if len(text) > LONGEST_TEXT:
        half = LONGEST_TEXT // 2
        text = f"{text[:half]}\n{_ELLIPSIS.strip()}\n{text[-half:]}"
    return "\n".join(map(_clean_after_indentation, text.splitlines()))


def _clean_after_indentation(line: str) -> str:
    """Return a cleaned line that begins with as many blanks as before."""
    words = line.lstrip(" ")
    indentation = line[: len(line) - len(words)]
    return indentation + clean_text(words)


def _as_text(text: object) -> str:
    """Return anything as text, also what raises an error when it is asked for its text."""
    try:
        return str(text)
    except Exception as error:  # of an exception of a plugin, for example
        return f"{type(text).__name__} without a text ({type(error).__name__})"


def say(text: object = "", *, err: bool = False, indent: int = 2, is_wrapped: bool = True) -> None:
    """Print one line without control characters.

    Parameters
    ----------
    text
        The line.
    err
        Whether to print to stderr instead of stdout.
    indent
        Number of blanks by which a wrapped line is indented more than the first one.
    is_wrapped
        Whether a terminal gets the line wrapped between words. A command that users copy is not.
    """
    stream = sys.stderr if err else sys.stdout
    line = clean_text(text)
    if is_wrapped and stream.isatty():
        n_blanks = len(line) - len(line.lstrip()) + indent
        line = textwrap.fill(
            line,
            shutil.get_terminal_size().columns,
            subsequent_indent=" " * n_blanks,
            break_long_words=False,
            break_on_hyphens=False,
        )
    print(line, file=stream, flush=True)


class Printed(io.TextIOBase):
    """Standard output of a plugin, which is printed as cleaned lines on stderr.

    A line also ends where another name begins, and with the stream.
    """

    def __init__(self) -> None:
        super().__init__()
        self._name = ""
        self._rest = ""  # the beginning of a line that has not ended

    @property
    def name(self) -> str:
        """Name of what prints, with which lines begin; "" for none."""
        return self._name

    @name.setter
    def name(self, name: str) -> None:
        self._end_line()
        self._name = name

    def write(self, text: str) -> int:
        """Print the lines that have ended."""
        *lines, rest = (self._rest + text).split("\n")
        for line in lines:
            self._print(line)
        self._rest = rest[: 2 * LONGEST_REASON]  # more of it is never printed
        return len(text)

    def close(self) -> None:
        """Print a line that has not ended, and close the stream."""
        self._end_line()
        super().close()

    def _end_line(self) -> None:
        """Print a line that has not ended."""
        if self._rest:
            self._print(self._rest)
        self._rest = ""

    def _print(self, line: str) -> None:
        """Print a line behind the name of what prints."""
        start = f"{self._name}: " if self._name else ""
        say(start + brief(line), err=True)


def say_lines(text: str) -> None:
    """Print text line by line, as it is for other programs."""
    for line in text.removesuffix("\n").split("\n"):
        print(clean_text(line), flush=True)  # noqa: T201


def say_table(
    rows: Sequence[Sequence[str]], whole: Collection[int] = (), numbers: Collection[int] = ()
) -> None:
    """Print a table in columns, whose cells are wrapped to fit the width of the terminal.

    Parameters
    ----------
    rows
        Cells of each row; all rows have the same number of cells.
    whole
        Indices of the columns that are not wrapped.
    numbers
        Indices of the columns of numbers, which are aligned to the right.
    """
    from rich.console import Console
    from rich.table import Column, Table
    from rich.text import Text

    # A pipe has no width: programs that read the table expect one row on each line.
    has_width = sys.stdout.isatty() or "COLUMNS" in os.environ
    width = None if has_width else LONGEST_TEXT
    console = Console(highlight=False, width=width)
    columns = [
        Column(no_wrap=place in whole, justify="right" if place in numbers else "left")
        for place in range(len(rows[0]))
    ]
    grid = Table.grid(*columns, padding=(0, 2, 0, 0))
    for row in rows:
        cells = [Text(clean_text(cell), overflow="fold") for cell in row]
        grid.add_row(*cells)
    with console.capture() as captured:
        console.print(grid)
    lines = captured.get().splitlines()
    say_lines("\n".join(line.rstrip() for line in lines))


def _printable_in_line(character: str) -> str:
    """Return a character of a line; any white space is a blank."""
    return " " if character.isspace() else _printable(character)


def _printable_in_name(character: str) -> str:
    """Return a character of a name, in which a backslash begins an escape."""
    return _escaped(character) if character == "\\" else _printable(character)


def _printable(character: str) -> str:
    return character if character.isprintable() else _escaped(character)


def _escaped(character: str) -> str:
    """Return a character as Python writes it in a text."""
    return character.encode("unicode_escape").decode("ascii")
