"""Clocks, and a row of the table."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

Work = Callable[[], object]


@dataclass(frozen=True)
class Row:
    """One measurement: seconds of ours and of another program, and what makes the comparison fair."""

    name: str
    seconds: float
    detail: str
    peer: str = ""
    peer_seconds: float = 0.0
    clock: str = "processor"

    def cells(self) -> tuple[str, ...]:
        """Cells of its line in the table."""
        peer = (self.peer, readable(self.peer_seconds), f"{self.peer_seconds / self.seconds:.2f}")
        return (self.name, readable(self.seconds), *(peer if self.peer else ("", "", "")), self.clock, self.detail)


def readable(seconds: float) -> str:
    """A time with three digits and its unit."""
    unit, scale = next((pair for pair in (("s", 1.0), ("ms", 1e-3)) if seconds >= pair[1]), ("µs", 1e-6))
    return f"{seconds / scale:.3g} {unit}"


def least(work: Work, repeats: int, clock: Callable[[], float] = time.process_time) -> float:
    """Least time of some runs, after one that compiles and fills the caches."""
    work()
    return min(_timed(work, clock) for _ in range(repeats))


def alternately(ours: Work, peer: Work, repeats: int) -> tuple[float, float]:
    """Least processor time of each, ours and the peer's in turn: other work on the machine can only add to them."""
    ours()
    times = [(_timed(ours, time.process_time), _timed(peer, time.process_time)) for _ in range(repeats)]
    return min(first for first, _ in times), min(second for _, second in times)


def _timed(work: Work, clock: Callable[[], float]) -> float:
    start = clock()
    work()
    return clock() - start
