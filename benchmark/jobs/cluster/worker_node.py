"""A worker of a dask cluster, as far as a run knows it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from benchmark.system.text import brief


@dataclass
class WorkerNode:
    """A dask worker.

    Parameters
    ----------
    address, host, threads
        Where it is, and how many tasks it takes at a time.
    asked
        When it was asked what is there.
    answer
        What it answered; see :func:`benchmark.jobs.cluster.supervisor.inspect`.
    seen
        When the scheduler heard of it last, by the clock there.
    given_up
        ``seen`` when it was given up; it is trusted again when the scheduler hears of it once more.
    models
        Digests of the models that it has been sent.
    anew
        Whether it is to send again what it has made.
    """

    address: str
    host: str
    threads: int
    asked: float
    seen: float = 0.0
    answer: dict[str, Any] | None = None
    given_up: float | None = None
    models: set[str] = field(default_factory=set)
    anew: bool = False

    @property
    def problems(self) -> list[str]:
        """Return why it would do other work than was planned."""
        return list(self.answer["problems"]) if self.answer else []

    @property
    def is_ready(self) -> bool:
        """Return whether it can be given work."""
        return self.answer is not None and not self.problems and self.given_up is None

    @property
    def shares_folder(self) -> bool:
        """Return whether it reads and writes the results folder of the run."""
        return bool(self.answer and self.answer["shares_folder"])

    @property
    def told(self) -> str:
        """Return which worker it is and what is wrong with it, in a line."""
        return f"worker {self.address}: {brief('; '.join(self.problems))}"
