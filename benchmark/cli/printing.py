"""How results are printed."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from benchmark.text import say_lines


def print_markdown(text: str) -> None:
    """Print Markdown, which a terminal shows with its marks."""
    if not sys.stdout.isatty():
        say_lines(text)
        return
    from rich.console import Console

    from benchmark.cli.terminal_tables import TerminalMarkdown

    Console().print(TerminalMarkdown(text))


#: Notes on a form that are lengths.
_IN_METRES = ("distance", "size")


def facts_of(notes: Mapping[str, float | str]) -> list[str]:
    """Return the notes on a form in words."""
    return [_fact(name, note) for name, note in notes.items()]


def _fact(name: str, note: float | str) -> str:
    """Return a note in words."""
    if name == "doubt":
        return f"doubt: {note}"
    if not isinstance(note, float):
        return f"{name} {note}"
    unit = " m" if name in _IN_METRES else ""
    return f"{name} {note:.4g}{unit}"
