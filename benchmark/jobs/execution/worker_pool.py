"""Pools of workers that do the tasks of a run, on this machine or elsewhere."""

from __future__ import annotations

import itertools
import os
from collections.abc import Sequence
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any, Protocol

from benchmark.jobs.execution.worker import Status, TaskWorker
from benchmark.jobs.job_specs import Task, to_json
from benchmark.system.workers import memory_per_worker

#: Seconds between two looks at the workers.
INTERVAL = 0.1

#: Exit code of a worker that was lost with the machine that it ran on: by custom, a failure that may pass.
LOST = 75


class PoolWorker(Protocol):
    """A worker at a task; see :class:`benchmark.jobs.execution.worker.TaskWorker`."""

    status_at_end: Status
    trace: str

    @property
    def exit_code(self) -> int | None:
        """Exit code, minus the number of the signal, or :data:`LOST`; None while it runs."""
        ...

    @property
    def status(self) -> Status:
        """Return how far it is."""
        ...

    def stop(self) -> None:
        """End it, after it has written down where it is."""
        ...

    def end(self) -> None:
        """End it, if it still runs."""
        ...


class WorkerPool(Protocol):
    """Starts workers."""

    @property
    def size(self) -> int:
        """Tasks that it can do at a time; it may change."""
        ...

    @property
    def waits_for(self) -> str:
        """Return what it waits for where it can do nothing; "" where it can."""
        ...

    def begin(self, task: Task) -> PoolWorker:
        """Start a worker; raises ``OSError`` if there is none for this task just now."""
        ...

    def wait(self, running: Sequence[PoolWorker]) -> None:
        """Wait until one of them ends, or a moment."""
        ...


def package_of(task: Task) -> str:
    """Return the package of the tasks that may be done in one process with this one; "" for none."""
    if any(job.is_foreign for job in task.jobs):
        return ""
    return " ".join(sorted({job.package for job in task.jobs}))


class LocalWorkerPool:
    """Processes on this machine; one that has finished a task of the suite's own does others of the same package.

    Parameters
    ----------
    size
        How many.
    progress
        Folder of the files that say how far they are.
    """

    waits_for = ""

    def __init__(self, size: int, progress: Path) -> None:
        self.size = size
        self._progress = progress
        self._memory = memory_per_worker(size)
        self._numbers = itertools.count()
        self._begun: list[TaskWorker] = []

    def begin(self, task: Task) -> TaskWorker:
        """Give a task to a process that waits, or start one; raises ``OSError`` if the system starts none."""
        package, status_file = package_of(task), self._progress / f"{os.getpid()}-{next(self._numbers)}"
        for worker in [each for each in self._begun if each.waits]:
            if worker.package == package and worker.do_next(to_json(task), status_file):
                return worker
            worker.kill()
        self._begun = [each for each in self._begun if not each.is_over]  # each holds an open file
        begun = TaskWorker(to_json(task), status_file, self._memory, package)
        self._begun.append(begun)
        return begun

    def close(self) -> None:
        """End the processes that wait."""
        for worker in self._begun:
            if worker.waits:
                worker.kill()

    def wait(self, running: Sequence[Any]) -> None:
        """Wait until one of them ends, or a moment."""
        wait([worker.sentinel for worker in running], timeout=INTERVAL)
