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

#: Longest reason in tables and lists of jobs, message in a record, and text that a plugin passes,
#: in characters.
LONGEST_REASON, LONGEST_MESSAGE, LONGEST_TEXT = 500, 1000, 20_000

#: Longest name, in characters: names become parts of file names.
LONGEST_NAME = 60

#: Names in a list before the rest is only counted.
_NAMED = 3

#: Pattern of names: lower-case words joined by hyphens.
NAME = rf"(?=.{{1,{LONGEST_NAME}}}$)[a-z][a-z0-9]*(-[a-z0-9]+)*"

_BREAKS = re.compile("[ \xa0]*[\t\n\v\f\r\x1c-\x1f\x85\u2028\u2029]\\s*")

#: ANSI escape sequences for colours and cursor movements.
_TERMINAL_CODES = re.compile(r"(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]")

_CUT = " ..."


def is_name(name: object) -> bool:
    """Return whether this is a valid name: lower-case words joined by hyphens, not too long."""
    return isinstance(name, str) and re.fullmatch(NAME, name) is not None


def nfc(name: object) -> str:
    """Return a name with composed characters (NFC), as which macOS and Linux write the same name alike."""
    return unicodedata.normalize("NFC", str(name))


def printable(name: str) -> str:
    r"""Return a name for records, of which no two are alike: in NFC, with escapes as in Python, such as ``\x00``."""
    return "".join(_escaped(c) if c == "\\" else _printable(c) for c in nfc(name))


def listed(texts: Iterable[str], joint: str = ", ") -> str:
    """Join the first few of some texts, and count the others."""
    every = list(texts)
    more = [f"{len(every) - _NAMED} more"] if len(every) > _NAMED + 1 else []
    return joint.join([*every[: _NAMED if more else None], *more])


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
    words = _as_text(text)
    if words.isprintable():
        return words
    words = _BREAKS.sub(" ", _TERMINAL_CODES.sub("", words))
    return "".join(" " if character.isspace() else _printable(character) for character in words)


def counted(number: int, one: str, many: str = "") -> str:
    """Return a number and what it counts: ``1 vertex``, ``2 vertices``."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def brief(text: object, longest: int = LONGEST_REASON) -> str:
    """Return cleaned text, cut to a number of characters."""
    words = clean_text(_as_text(text)[: 2 * longest])
    return words if len(words) <= longest else words[: longest - len(_CUT)] + _CUT


def clean_lines(text: str) -> str:
    """Return text with cleaned lines, from which the middle is cut if it is very long."""
    if len(text) > LONGEST_TEXT:
        text = f"{text[: LONGEST_TEXT // 2]}\n{_CUT.strip()}\n{text[-LONGEST_TEXT // 2 :]}"
    return "\n".join(
        line[: len(line) - len(line.lstrip(" "))] + clean_text(line.lstrip(" "))
        for line in text.splitlines()
    )


def _as_text(text: object) -> str:
    try:
        return str(text)
    except Exception as error:  # of an exception of a plugin, for example
        return f"{type(text).__name__} without a text ({type(error).__name__})"


def say(text: object = "", *, err: bool = False, indent: int = 2) -> None:
    """Print one cleaned line to stdout or stderr; a terminal gets it wrapped between words, with more indentation."""
    stream, line = sys.stderr if err else sys.stdout, clean_text(text)
    if stream.isatty():
        blanks = " " * (len(line) - len(line.lstrip()) + indent)
        width = shutil.get_terminal_size().columns
        line = textwrap.fill(
            line, width, subsequent_indent=blanks, break_long_words=False, break_on_hyphens=False
        )
    print(line, file=stream, flush=True)


class Printed(io.TextIOBase):
    """Standard output of a plugin: cleaned lines on stderr, which begin with the name of what prints, if it has one."""

    name = rest = ""

    def write(self, text: str) -> int:
        """Print the lines that end."""
        *lines, self.rest = (self.rest + text).split("\n")
        for line in lines:
            say(f"{self.name}: {brief(line)}" if self.name else brief(line), err=True)
        return len(text)


def say_lines(text: str) -> None:
    """Print text line by line, as it is for other programs."""
    for line in text.removesuffix("\n").split("\n"):
        print(clean_text(line), flush=True)  # noqa: T201


def say_table(rows: Sequence[Sequence[str]], whole: Collection[int] = ()) -> None:
    """Print rows in columns, wrapped between words at the width of the terminal but for those that stay ``whole``."""
    from rich.console import Console
    from rich.table import Column, Table
    from rich.text import Text

    has_width = sys.stdout.isatty() or "COLUMNS" in os.environ  # other programs read a row a line
    console = Console(highlight=False, width=None if has_width else LONGEST_TEXT)
    grid = Table.grid(
        *(Column(no_wrap=k in whole) for k in range(len(rows[0]))), padding=(0, 2, 0, 0)
    )
    for row in rows:
        grid.add_row(*(Text(clean_text(cell), overflow="fold") for cell in row))
    with console.capture() as captured:
        console.print(grid)
    say_lines("\n".join(map(str.rstrip, captured.get().splitlines())))


def _printable(character: str) -> str:
    return character if character.isprintable() else _escaped(character)


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
