"""Where the tasks of a run are done: in processes of this machine, or in this process for debugging."""

from __future__ import annotations

import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from benchmark.arrays import Arrays
from benchmark.errors import BenchmarkError
from benchmark.execution.job_specs import Task, task_of, to_json
from benchmark.execution.processes.channel import Facts, wait_for
from benchmark.execution.processes.process import (
    INTERVAL,
    ForeignError,
    Process,
    ProcessEnded,
    Requester,
    memory_per_process,
)
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


@dataclass(frozen=True)
class Status:
    """Progress of a task, as its process said last.

    Parameters
    ----------
    job
        Key of the job that it is at; "" before the first one.
    steps
        Shapes of its batch that are behind it.
    shape
        Identifier of the shape that it is at; "" between shapes.
    is_starting
        Whether a process starts that imports the plugin of the job, which is no work of the job.
    """

    job: str = ""
    steps: int = 0
    shape: str = ""
    is_starting: bool = False


class Running(ABC):
    """A task under way.

    Parameters
    ----------
    task
        The task.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
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

    @abstractmethod
    def stop(self) -> None:
        """End it, after it has written down where it is."""

    @abstractmethod
    def end(self) -> None:
        """End it, if it still runs."""


#: Does tasks: ``begin`` raises ``OSError`` where that cannot be done just now, and ``wait`` returns when one has ended,
#: or after a moment.
Pool: TypeAlias = "LocalPool | DaskPool"


def lane_of(task: Task) -> str:
    """Return the lane of the tasks that may be done in one process with this one; "" for none."""
    if any(job.is_foreign for job in task.jobs):
        return ""
    return " ".join(sorted({job.package for job in task.jobs}))


class LocalTask(Running):
    """A task that a process beside this one is at."""

    def __init__(self, task: Task, process: Process) -> None:
        super().__init__(task)
        self.process = process

    def update(self) -> None:
        """Take in what the process has said."""
        try:
            while not self.has_ended and (message := self.process.receive(0.0)) is not None:
                if (status := message[0].get("progress")) is not None:
                    self.status = Status(*status)
                    continue
                self.process.result(message)
                self.is_finished = True
        except ProcessEnded as error:
            self.exit_code, self.trace = error.code, self.process.trace
        except (BenchmarkError, ForeignError, MemoryError) as error:  # none of a job, which would be its record
            say(f"a task ends: {error}", err=True)
            self.exit_code = 1
            self.end()

    def stop(self) -> None:
        """End it, after it has written down where it is."""
        self.process.stop()
        self.trace = self.process.trace

    def end(self) -> None:
        """End its process."""
        self.process.end()
        self.trace = self.trace or self.process.trace


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
        """Give a task to a process that waits, or start one; raises ``OSError`` if the system starts none."""
        running = LocalTask(task, self._process(lane_of(task)))
        running.process.send({"task": to_json(task)})
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

    def wait(self, running: Sequence[Any], look: Callable[[], object]) -> None:
        """Wait until one of them ends, or a moment."""
        until = time.monotonic() + INTERVAL
        while not any(task.has_ended for task in running) and (left := until - time.monotonic()) > 0:
            wait_for([task.process for task in running], left)
            for task in running:
                task.update()
        for task in running:
            if task.is_finished and (done := lane_of(task.task)):
                self._idle.append((done, task.process))
            elif task.has_ended:
                task.end()


class _TaskHere(Running):
    """A task that this process does."""

    def do(self, look: Callable[[], object]) -> None:
        """Do it."""

        def tell(status: Status) -> None:
            self.status = status
            look()

        _work(self.task, tell)
        self.is_finished = True

    def stop(self) -> None:
        """Do nothing: nobody looks at it while it is at work."""

    def end(self) -> None:
        """Do nothing."""


class PoolHere(LocalPool):
    """Does tasks in this process, for debugging: there is no timeout, and a crash ends the run.

    What code of plugins makes a part of is done in a process: this one does not import them.
    """

    def __init__(self) -> None:
        super().__init__(1)

    def begin(self, task: Task) -> Running:
        """Begin a task."""
        return _TaskHere(task) if lane_of(task) else super().begin(task)

    def wait(self, running: Sequence[Any], look: Callable[[], object]) -> None:
        """Do the task that this process is to do, or wait."""
        here = [task for task in running if isinstance(task, _TaskHere)]
        if not here:
            super().wait(running, look)
        for task in here:
            task.do(look)


def do_task(facts: Mapping[str, Any], arrays: Arrays, requester: Requester) -> tuple[Facts, Arrays]:
    """Do a task, in its process."""
    latest = Status()

    def tell(status: Status) -> None:
        nonlocal latest
        latest = status
        requester.tell(astuple(status))

    close_to_plugins(lambda is_starting: tell(replace(latest, is_starting=is_starting)))
    lock.forget()  # the code may have changed since the task before
    try:
        _work(task_of(facts["task"]), tell)
    except (StorageError, OSError):  # not even a record could be written; whoever waits for it says so
        os._exit(UNWRITTEN)
    return {}, {}


def _work(task: Task, tell: Callable[[Status], object]) -> None:
    from benchmark.execution.runner import work

    work(task, lambda job, steps, shape="": tell(Status(job, steps, shape)))
