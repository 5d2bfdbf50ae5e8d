"""Text from outside made fit to be shown: names, titles and reasons come from files, plugins and other machines."""

from __future__ import annotations

import re

import click

#: Characters of a reason that a table or a list of jobs shows; the record has it whole.
LONGEST_REASON = 500

_BREAKS = frozenset("\t\n\v\f\r\x1c\x1d\x1e\x1f\x85\u2028\u2029")

#: Colours and movements of the cursor, as programs write them into their errors.
_TERMINAL_CODES = re.compile(r"(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]")

_BLANKS = re.compile(r"\s+")

_CUT = " ..."


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


def say_lines(text: str, *, err: bool = False) -> None:
    """Print what has several lines by design, each for itself."""
    for line in text.removesuffix("\n").split("\n"):
        say(line, err=err)


def _without_breaks(found: re.Match[str]) -> str:
    return " " if _BREAKS & set(found[0]) else " " * len(found[0])


def _printable(character: str) -> str:
    return character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
