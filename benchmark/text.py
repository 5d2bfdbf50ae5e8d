"""Text from outside: names that can be used, and titles and reasons made fit to be shown."""

from __future__ import annotations

import re
from collections.abc import Sequence

import click

#: Characters of a reason that a table or a list of jobs shows; the record has it whole.
LONGEST_REASON = 500

#: Characters of the longest name, which becomes part of the names of files.
LONGEST_NAME = 60

#: Environment variable of the folder of the official data sets where ``--data-root`` is not passed.
DATA_VARIABLE = "CANONICAL_FORMS_DATA"

#: Words on the command line that stand for several methods, so that none can be called like them.
RESERVED = frozenset({"all", "finished"})

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")

_BREAKS = frozenset("\t\n\v\f\r\x1c\x1d\x1e\x1f\x85\u2028\u2029")

#: Colours and movements of the cursor, as programs write them into their errors.
_TERMINAL_CODES = re.compile(r"(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]")

_BLANKS = re.compile(r"\s+")

_CUT = " ..."


def is_name(name: object) -> bool:
    """Return whether something can be called like this: lower-case words joined by hyphens, not too long."""
    return isinstance(name, str) and len(name) <= LONGEST_NAME and _NAME.fullmatch(name) is not None


def clean(text: object) -> str:
    r"""One line of text that no terminal, file or reader takes for anything else.

    Line breaks and tabs become one space, codes that colour a terminal go, and whatever else cannot be printed (control
    characters, changes of direction, halves of characters) is written as Python writes it: ``\x00``.

    Parameters
    ----------
    text
        Anything; what is no text is shown as Python shows it.
    """
    told = str(text)
    if told.isprintable():
        return told
    told = _BLANKS.sub(_without_breaks, _TERMINAL_CODES.sub("", told))
    return "".join(_printable(character) for character in told)


def brief(text: object) -> str:
    """The same, cut off where it is longer than a reason may be in a table."""
    told = clean(text)
    return told if len(told) <= LONGEST_REASON else told[: LONGEST_REASON - len(_CUT)] + _CUT


def say(text: object = "", *, err: bool = False) -> None:
    """Print one line, whatever it holds, to stdout or stderr."""
    click.echo(clean(text), err=err)


def say_lines(text: str) -> None:
    """Print what has several lines by design, each for itself."""
    for line in text.removesuffix("\n").split("\n"):
        say(line)


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of rows whose columns are aligned."""
    rows = [[clean(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _without_breaks(found: re.Match[str]) -> str:
    return " " if _BREAKS & set(found[0]) else " " * len(found[0])


def _printable(character: str) -> str:
    return character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
