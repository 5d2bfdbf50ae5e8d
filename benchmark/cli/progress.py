"""Progress of long work on stderr: a bar in a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from datetime import timedelta
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column

from benchmark.runs.runner import Progress as State
from benchmark.text import clean_text, say

#: Seconds between lines of progress without a terminal.
SECONDS_BETWEEN_LINES = 15.0

#: Letters that a bar takes.
_BAR_WIDTH = 16

_Item = TypeVar("_Item")


class Bar:
    """Progress of a run: forms and jobs that are done, time left, and what is being done.

    Parameters
    ----------
    n_jobs
        Number of jobs that run; 0 shows nothing.
    expected
        Seconds that they are expected to take, or 0 if nobody knows.
    console
        Where it is shown; stderr by default.
    """

    def __init__(self, n_jobs: int, expected: float, console: Console | None = None) -> None:
        """Prepare a bar for a terminal; elsewhere it stays hidden, and lines are printed."""
        self._n_jobs = n_jobs
        self._expected = expected
        self._n_ended = 0
        self._state = State(0, 0)
        self._start = time.monotonic()
        self._last_line = self._start
        # Beside the bar stand the counts, and in the rest of the line what is being done.
        console = console or Console(file=sys.stderr)
        is_shown = n_jobs > 0 and console.is_terminal
        rest = Column(ratio=1, no_wrap=True, overflow="ellipsis")
        self._bar = Progress(
            BarColumn(_BAR_WIDTH),
            TextColumn("{task.fields[counts]}", table_column=Column(no_wrap=True), markup=False),
            TextColumn("{task.description}", table_column=rest, markup=False),
            console=console,
            expand=True,
            disable=not is_shown,
        )
        self._task = self._bar.add_task("| starting", total=None, counts=self._counts())

    def __enter__(self) -> Bar:
        """Show the bar."""
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Take the bar away."""
        self._bar.stop()

    def watch(self, state: State) -> None:
        """Show the state of a run: how many steps are done, and what is at work."""
        self._state = state
        working = clean_text("; ".join(state.working))
        if not (working or state.done):
            working = "starting"
        counts = self._counts()
        self._bar.update(
            self._task,
            completed=state.done,
            total=state.total or 1,
            counts=counts,
            description=working and f"| {working}",
        )
        # Without a terminal, print a line now and then.
        now = time.monotonic()
        if self._bar.disable and now - self._last_line >= SECONDS_BETWEEN_LINES:
            self._last_line = now
            self._say(", ".join(filter(None, [counts, working])))

    def _counts(self) -> str:
        """Return how many steps and jobs are done, and the time left."""
        state = self._state
        seconds = self._seconds_left()
        time_left = f", {timedelta(seconds=round(seconds))} left" if seconds > 0 else ""
        return f"{state.done}/{state.total} steps, {self._n_ended}/{self._n_jobs} jobs{time_left}"

    def _seconds_left(self) -> float:
        """Return the seconds that the run is expected to take, 0 or less if nobody knows.

        The first forms wait for kernels to compile: until many are done, the estimate counts more
        than their seconds.
        """
        elapsed = time.monotonic() - self._start
        if not self._state.done:
            return self._expected - elapsed
        share = self._state.done / self._state.total
        expected = self._expected or elapsed / share
        return (1 - share) * ((1 - share) * expected + elapsed)

    def ended(self, job: str, outcome: str) -> None:
        """Print a finished job and its outcome, on two lines if one is too narrow."""
        self._n_ended += 1
        self._bar.update(self._task, counts=self._counts())
        line = f"{job}  {outcome}"
        is_too_long = len(line) > self._bar.console.width
        if is_too_long and not self._bar.disable:
            self._say(job.rstrip())
            self._say(f"  {outcome}")
        else:
            self._say(line)  # above the bar

    def _say(self, line: str) -> None:
        """Print a line; a closed output does not end the run."""
        with suppress(OSError):
            say(line, err=True)


def counting(
    what: str, items: Iterable[_Item], name: Callable[[_Item], str] | None = None
) -> Iterator[_Item]:
    """Yield items, such as shapes to check, and show on stderr how many are done.

    A terminal shows a bar with the time left; elsewhere, a line is printed now and then.

    Parameters
    ----------
    what
        What is done with them, such as "reading shapes".
    items
        The items.
    name
        Returns what an item is called; by default only its number is shown.
    """
    items = list(items)
    console = Console(file=sys.stderr)
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(_BAR_WIDTH),
        TimeRemainingColumn(),
    )
    last_line = -SECONDS_BETWEEN_LINES  # so that the first line is printed at once
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(clean_text(what), total=len(items))
        for number, item in enumerate(items, 1):
            line = f"{what}: {number} of {len(items)}"
            if name:
                line += f", {name(item)}"
            now = time.monotonic()
            if bar.disable and now - last_line >= SECONDS_BETWEEN_LINES:
                last_line = now
                say(line, err=True)
            bar.update(task, description=clean_text(line))
            yield item
            bar.advance(task)
