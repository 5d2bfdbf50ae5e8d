"""Progress of a verb that takes one shape after the other."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

from benchmark.cli.options import INTERRUPTED
from benchmark.datasets.base import Entry, Watched
from benchmark.text import clean, say

#: Seconds between two lines where there is no terminal.
INTERVAL = 10.0


@contextmanager
def counting(what: str) -> Iterator[Watched]:
    """Tell on stderr how many shapes are done: a bar on a terminal, else a line at once and one every ten seconds.

    An interruption ends the program with one line and exit code 130.

    Parameters
    ----------
    what
        What is done, e.g. ``"checking humans"``.

    Yields
    ------
    Watched
        Counts the shapes that it hands on.
    """
    try:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                MofNCompleteColumn(),
                TimeRemainingColumn(),
            )
            with Progress(*columns, console=Console(file=sys.stderr)) as bar:
                yield lambda entries: bar.track(entries, description=_said(what, entries))
        else:
            yield lambda entries: _with_lines(entries, _said(what, entries))
    except KeyboardInterrupt:
        say(f"interrupted while {what}", err=True)
        sys.exit(INTERRUPTED)


def _said(what: str, entries: Sequence[Entry]) -> str:
    """Return what is done, and whether the shapes are generated, which takes longer than to read them."""
    generated = any(entry.path is None for entry in entries)
    return clean(f"{what}{', each shape generated first' if generated else ''}")


def _with_lines(entries: Sequence[Entry], said: str) -> Iterable[Entry]:
    say(f"{said}: 0 of {len(entries)}", err=True)
    begun = told = time.monotonic()
    for number, entry in enumerate(entries):
        now = time.monotonic()
        if number and now - told >= INTERVAL:
            left = (now - begun) / number * (len(entries) - number)
            say(f"{number} of {len(entries)}, about {left:.0f} s left", err=True)
            told = now
        yield entry
    say(f"{len(entries)} of {len(entries)}", err=True)
