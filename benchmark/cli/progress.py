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
INTERVAL = 15.0

T = TypeVar("T")


class Bar:
    """Progress of a run: forms and jobs that are done, time left, and what is being done.

    Parameters
    ----------
    n_jobs
        Number of jobs that run.
    expected
        Seconds that they are expected to take, or 0 if nobody knows.
    console
        Where it is shown; stderr by default.
    """

    def __init__(self, n_jobs: int, expected: float, console: Console | None = None) -> None:
        self._n_jobs, self._expected, self._n_ended, self._state = n_jobs, expected, 0, State(0, 0)
        self._start = self._shown = time.monotonic()
        console = console or Console(file=sys.stderr)
        rest = Column(ratio=1, no_wrap=True, overflow="ellipsis")
        self._bar = Progress(
            BarColumn(16),
            TextColumn("{task.fields[counts]}", table_column=Column(no_wrap=True), markup=False),
            TextColumn("{task.description}", table_column=rest, markup=False),
            console=console,
            expand=True,
            disable=not (n_jobs and console.is_terminal),
        )
        self._task = self._bar.add_task("starting", total=None, counts=self._counts())

    def __enter__(self) -> Bar:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def watch(self, state: State) -> None:
        """Show how far the run is."""
        self._state = state
        working = clean_text("; ".join(state.working)) or "ranking"
        counts = self._counts()
        self._bar.update(
            self._task,
            completed=state.done,
            total=state.total or 1,
            counts=counts,
            description=working,
        )
        now = time.monotonic()
        if self._bar.disable and now - self._shown >= INTERVAL:
            self._shown = now
            self._say(f"{counts}, {working}")

    def _counts(self) -> str:
        state = self._state
        elapsed = time.monotonic() - self._start
        # The first forms wait for kernels to compile: until many are done, the estimate counts more
        # than their seconds.
        share = state.done / state.total if state.total else 0.0
        expected = self._expected or (elapsed / share if share else 0.0)
        left = (1 - share) * ((1 - share) * expected + elapsed) if share else expected - elapsed
        time_left = f", {timedelta(seconds=round(left))} left" if left > 0 else ""
        return f"{state.done}/{state.total} steps, {self._n_ended}/{self._n_jobs} jobs{time_left}"

    def ended(self, line: str) -> None:
        """Print the line of a finished job."""
        self._n_ended += 1
        self._bar.update(self._task, counts=self._counts())
        self._say(line)  # above the bar

    def _say(self, line: str) -> None:
        with suppress(OSError):  # a closed output does not end the run
            say(line, err=True)


def counting(what: str, items: Iterable[T], name: Callable[[T], str] | None = None) -> Iterator[T]:
    """Yield items, such as the shapes of ``"checking people"``, and show how many are done, and the time left.

    Parameters
    ----------
    what
        What is done with them.
    items
        The items.
    name
        Returns what an item is called.
    """
    every = [*items]
    console = Console(file=sys.stderr)
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(16),
        TimeRemainingColumn(),
    )
    shown = -INTERVAL
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(clean_text(what), total=len(every))
        for number, item in enumerate(every, 1):
            named = f", {name(item)}" if name else ""
            line = f"{what}: {number} of {len(every)}{named}"
            now = time.monotonic()
            if bar.disable and now - shown >= INTERVAL:
                shown = now
                say(line, err=True)
            bar.update(task, description=clean_text(line))
            yield item
            bar.advance(task)
