"""Where the tasks of a run are done: in processes of this machine, or in this process for debugging.

A pool has a ``size``, what it ``waits_for``, and four methods: ``begin`` a task, which raises ``OSError`` where that
cannot be done just now; ``wait`` until one has ended, or a moment; ``stop`` one, after it has written down where it is;
``end`` one at once.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, replace
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from benchmark.arrays import Arrays
from benchmark.errors import BenchmarkError
from benchmark.execution.job_specs import Status, Task, task_of, to_json
from benchmark.execution.processes.channel import Facts, wait_for
from benchmark.execution.processes.process import INTERVAL, ForeignError, Process, ProcessEnded, Requester
from benchmark.execution.runner import work
from benchmark.machine import memory_per_process
from benchmark.pipeline.storage import lock
from benchmark.pipeline.storage.store import StorageError
from benchmark.plugins.remote import close_to_plugins
from benchmark.text import say

if TYPE_CHECKING:
    from benchmark.execution.dask_pool import DaskPool

#: Exit code of a process that could not write what it had to: by custom, an error of input or output.
UNWRITTEN = 74

#: Exit code of a task that was lost with the machine that it ran on: by custom, a failure that may pass.
LOST = 75

#: Bytes that a process needs at least; there are no more of them than have so much.
_SMALLEST = 2**29

#: Seconds for which a process waits for its next task.
_IDLE = 30.0


class Running:
    """A task under way, and what does it, as its pool knows it."""

    def __init__(self, task: Task, worker: Any = None) -> None:
        self.task = task
        self.worker = worker
        self.status = Status()
        self.is_finished = False
        #: How its process ended before the task was finished, or :data:`LOST`; it may have ended with 0, too.
        self.exit_code: int | None = None
        #: Where it was when it crashed or was stopped, as a traceback.
        self.trace = ""
        #: When it began, and when somebody looked at it last.
        self.begun = self.looked = time.monotonic()
        #: Seconds for which the process of a plugin has been starting.
        self.starting = 0.0

    @property
    def has_ended(self) -> bool:
        """Whether it is finished, or will never be."""
        return self.is_finished or self.exit_code is not None

    @property
    def keys(self) -> list[str]:
        """Keys of its jobs."""
        return [job.key for job in self.task.jobs]


Pool: TypeAlias = "LocalPool | DaskPool"


def lane_of(task: Task) -> str:
    """Return the lane of the tasks that may be done in one process with this one; "" for none."""
    if any(job.is_foreign for job in task.jobs):
        return ""
    return " ".join(sorted({job.package for job in task.jobs}))


class LocalPool:
    """Processes on this machine; one that has finished a task does others of the same lane.

    Parameters
    ----------
    size
        How many; no more than there is memory for.
    share
        Tasks that share the memory of this machine, where others than those of this pool do.
    """

    waits_for = ""

    def __init__(self, size: int, share: int = 1) -> None:
        self.size = max(1, min(size, memory_per_process() // _SMALLEST))
        self._memory = memory_per_process(max(self.size, share))
        self._idle: list[tuple[str, Process]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the processes that wait."""
        while self._idle:
            self._idle.pop()[1].end()

    def begin(self, task: Task) -> Running:
        """Give a task to a process that waits, or start one."""
        running = Running(task, self._process(lane_of(task)))
        running.worker.send({"task": to_json(task)})
        return running

    def _process(self, lane: str) -> Process:
        """Return a process of a lane; those of others that wait make room for it."""
        for place, (before, process) in enumerate(self._idle):
            if before == lane and process.exit_code is None:
                del self._idle[place]
                return process
        self.close()
        # A process beside it runs the code of a plugin: both together get the share of one.
        return Process(do_task, memory=self._memory if lane else self._memory // 2, idle=_IDLE)

    def wait(self, tasks: Sequence[Running], look: Callable[[], object]) -> None:
        """Wait until one of some tasks ends, or a moment."""
        until = time.monotonic() + INTERVAL
        while not any(running.has_ended for running in tasks) and (left := until - time.monotonic()) > 0:
            wait_for([running.worker for running in tasks], left)
            for running in tasks:
                self._update(running)
        for running in tasks:
            if running.is_finished and (lane := lane_of(running.task)):
                self._idle.append((lane, running.worker))
            elif running.has_ended:
                self.end(running)

    def _update(self, running: Running) -> None:
        def note(progress: Sequence[Any]) -> None:
            running.status = Status(*progress)

        try:
            running.is_finished = running.worker.receive(0.0, note) is not None
        except ProcessEnded as error:
            running.exit_code = error.code
        except (BenchmarkError, ForeignError, MemoryError) as error:  # none of a job, which would be its record
            say(f"a task ends: {error}", err=True)
            running.exit_code = 1

    def stop(self, running: Running) -> None:
        """End a task, after it has written down where it is."""
        running.worker.stop()
        self.end(running)

    def end(self, running: Running) -> None:
        """End the process of a task."""
        running.worker.end()
        running.trace = running.worker.trace


class PoolHere(LocalPool):
    """Does tasks in this process, for debugging: there is no timeout, and a crash ends the run.

    What code of plugins makes a part of is done in a process: this one does not import them.
    """

    def __init__(self) -> None:
        super().__init__(1)

    def begin(self, task: Task) -> Running:
        """Begin a task."""
        return Running(task) if lane_of(task) else super().begin(task)

    def wait(self, tasks: Sequence[Running], look: Callable[[], object]) -> None:
        """Do the task that this process is to do, or wait."""
        for running in tasks:
            if running.worker is not None:
                super().wait([running], look)
                continue

            def note(status: Status, running: Running = running) -> None:
                running.status = status
                look()

            work(running.task, note)
            running.is_finished = True

    def end(self, running: Running) -> None:
        """End the process of a task, if it has one."""
        if running.worker is not None:
            super().end(running)


def do_task(facts: Mapping[str, Any], arrays: Arrays, requester: Requester) -> tuple[Facts, Arrays]:
    """Do a task, in its process."""
    latest = Status()

    def report(status: Status) -> None:
        nonlocal latest
        latest = status
        requester.tell(astuple(status))

    close_to_plugins(lambda is_starting: report(replace(latest, is_starting=is_starting)))
    lock.forget()  # the code may have changed since the task before
    try:
        work(task_of(facts["task"]), report)
    except (StorageError, OSError):  # not even a record could be written; whoever waits for it says so
        os._exit(UNWRITTEN)
    return {}, {}
