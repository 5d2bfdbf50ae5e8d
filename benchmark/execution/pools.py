"""Pools of workers: processes on this machine, or this process itself for debugging.

A pool has a ``size``, a text ``waits_for``, and four methods. ``begin`` starts a task, or raises ``OSError`` if it
finds no worker; ``wait`` returns when a task has ended or after a moment; ``stop`` ends a task after it has written its
traceback; ``end`` ends it immediately.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, replace
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from benchmark.arrays import Arrays
from benchmark.errors import BenchmarkError
from benchmark.execution.job_specs import Status, Task, task_of, to_json
from benchmark.execution.processes.channel import Facts, wait_for
from benchmark.execution.processes.process import INTERVAL, ForeignError, Process, ProcessEnded, Tell
from benchmark.execution.runner import work
from benchmark.machine import memory_per_process
from benchmark.pipeline.storage import lock
from benchmark.pipeline.storage.store import StorageError
from benchmark.plugins.remote import close_to_plugins
from benchmark.text import say

if TYPE_CHECKING:
    from benchmark.execution.dask_pool import DaskPool

#: Codes of a task whose results could not be written, and of one whose worker was lost; no process ends with them.
UNWRITTEN, LOST = 256, 257

#: Minimum memory of a process, in bytes; limits the number of processes.
_SMALLEST = 2**29

#: Seconds after which an idle process ends.
_IDLE = 30.0


class Running:
    """A running task with its worker."""

    def __init__(self, task: Task, worker: Any = None) -> None:
        self.task = task
        self.worker = worker
        self.status = Status()
        self.is_finished = False
        #: Exit code of a process that ended before its task was finished, :data:`UNWRITTEN`, or :data:`LOST`.
        self.exit_code: int | None = None
        #: Traceback of the crash or stop.
        self.trace = ""
        #: Times of its start and of the last check.
        self.begun = self.looked = time.monotonic()
        #: Seconds for which the process of a plugin has been starting.
        self.starting = 0.0

    @property
    def has_ended(self) -> bool:
        """Whether it is finished or has failed."""
        return self.is_finished or self.exit_code is not None


Pool: TypeAlias = "LocalPool | DaskPool"


def lane_of(task: Task) -> str:
    """Return the lane of a task; a process serves one lane. "" stands for tasks with foreign code."""
    if any(job.is_foreign for job in task.jobs):
        return ""
    return " ".join(sorted({job.package for job in task.jobs}))


class LocalPool:
    """Processes on this machine; each is reused for other tasks of its lane.

    Parameters
    ----------
    size
        Number of processes; lowered if there is not enough memory.
    share
        Number of tasks that share the memory of this machine, if more than ``size``.
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
        """End the idle processes."""
        while self._idle:
            self._idle.pop()[1].end()

    def begin(self, task: Task) -> Running:
        """Give a task to an idle process or to a new one."""
        running = Running(task, self._process(lane_of(task)))
        running.worker.send({"task": to_json(task)})
        return running

    def _process(self, lane: str) -> Process:
        """Return a process of a lane; end the idle processes of other lanes if a new one must start."""
        for place, (before, process) in enumerate(self._idle):
            if before == lane and process.exit_code is None:
                del self._idle[place]
                return process
        self.close()
        # The process of a plugin runs alongside its worker, so each gets half of the memory.
        return Process(do_task, memory=self._memory if lane else self._memory // 2, idle=_IDLE)

    def wait(self, tasks: Sequence[Running], look: Callable[[], object]) -> None:
        """Wait for a moment, or until one of the tasks ends."""
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
            if answer := running.worker.receive(0.0, note):
                running.exit_code = answer[0].get("code")
                running.is_finished = running.exit_code is None
        except ProcessEnded as error:
            running.exit_code = error.code
        except (BenchmarkError, ForeignError, MemoryError) as error:  # not an error of a job, which would have a record
            say(f"a task ends: {error}", err=True)
            running.exit_code = 1

    def stop(self, running: Running) -> None:
        """End a task after it has written its traceback."""
        running.worker.stop()
        self.end(running)

    def end(self, running: Running) -> None:
        """End the process of a task."""
        running.worker.end()
        running.trace = running.worker.trace


class PoolHere(LocalPool):
    """Pool that runs tasks in this process, for debugging: no timeout, and a crash ends the run.

    Tasks with foreign code still run in another process, since the main process does not import plugins.
    """

    def __init__(self) -> None:
        super().__init__(1)

    def begin(self, task: Task) -> Running:
        """Begin a task."""
        return Running(task) if lane_of(task) else super().begin(task)

    def wait(self, tasks: Sequence[Running], look: Callable[[], object]) -> None:
        """Run the tasks of this process, or wait for those of another."""
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


def do_task(facts: Mapping[str, Any], arrays: Arrays, tell: Tell) -> tuple[Facts, Arrays]:
    """Run a task, in a child process."""
    latest = Status()

    def report(status: Status) -> None:
        nonlocal latest
        latest = status
        tell(astuple(status))

    close_to_plugins(lambda is_starting: report(replace(latest, is_starting=is_starting)))
    lock.forget()  # the code may have changed since the previous task
    try:
        work(task_of(facts["task"]), report)
    except (StorageError, OSError):  # not even a record could be written; the parent reports it
        return {"code": UNWRITTEN}, {}
    return {}, {}
