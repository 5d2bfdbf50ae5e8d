"""What the modules of this package share: clocks, and the form of a row."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

Work = Callable[[], object]


def row(
    name: str,
    seconds: float,
    *,
    target: str,
    met: bool,
    detail: str,
    clock: str = "processor",
    peer: str | None = None,
    peer_seconds: float | None = None,
    **figures: float,
) -> dict[str, Any]:
    """One measurement for ``results/speed.json``.

    Parameters
    ----------
    name
        What was timed.
    seconds
        Our time.
    target
        What we set out to reach, in words.
    met
        Whether this run reached it.
    detail
        What makes the comparison fair: size of the problem, agreement of the two results.
    clock
        ``"processor"`` time, of one thread unless the name says otherwise, or ``"wall"`` time.
    peer, peer_seconds
        Name and time of the program that does the same; the ratio is its time over ours.
    **figures
        Further numbers.
    """
    return {
        "name": name,
        "ours_seconds": seconds,
        "peer": peer,
        "peer_seconds": peer_seconds,
        "ratio": peer_seconds / seconds if peer_seconds else None,
        "clock": clock,
        "met": bool(met),
        "detail": f"target: {target}; {detail}",
        **figures,
    }


def processor_seconds(work: Work) -> float:
    """Processor time of one run: what else the machine does hardly enters."""
    start = time.process_time()
    work()
    return time.process_time() - start


def least_seconds(work: Work, repeats: int) -> float:
    """Least processor time of some runs, after one that compiles and fills the caches."""
    work()
    return min(processor_seconds(work) for _ in range(repeats))


def alternately(ours: Work, peer: Work, repeats: int) -> tuple[float, float]:
    """Least processor time of each, ours and the peer's in turn: other work on the machine can only add to them."""
    ours()
    times = [(processor_seconds(ours), processor_seconds(peer)) for _ in range(repeats)]
    return min(first for first, _ in times), min(second for _, second in times)


def least_wall_seconds(work: Work, repeats: int) -> float:
    """Least wall time of some runs, after one to warm up: for work that is spread over threads or processes."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)
