"""A worker: one process for one task, in a session of its own, that dies with the harness."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmark.jobs.orders import Task

_DONE = "done"

#: ``PR_SET_PDEATHSIG`` of Linux.
_PARENT_DEATH_SIGNAL = 1

#: Seconds that a process has to end once its task is done.
GRACE = 5.0


@dataclass(frozen=True)
class Status:
    """How far a worker is, as it said last.

    Parameters
    ----------
    job
        Key of the job that it is at; "" before the first one.
    steps
        Shapes of its share that are behind it.
    is_done
        Whether the task is finished.
    """

    job: str = ""
    steps: int = 0
    is_done: bool = False


class Worker:
    """A running process with its task.

    What it brings about is on the disk: records, artefacts, and a file that says how far it is. Nothing is trusted to a
    pipe, which a process that is killed may hold locked or leave half written.

    Parameters
    ----------
    task
        What to do.
    number
        Place among the workers that run at the same time.
    progress
        Folder of the files that say how far workers are.
    memory
        Bytes that it may take.
    """

    def __init__(self, task: Task, number: int, progress: Path, memory: int) -> None:
        self.task = task
        self.number = number
        self.looked = time.monotonic()
        self.status_at_end = Status()
        self._done_since: float | None = None
        self._status_file = status_file = progress / f"{os.getpid()}-{number}"
        status_file.unlink(missing_ok=True)
        context = multiprocessing.get_context("spawn")
        self._process = context.Process(target=_main, args=(task, status_file, memory, os.getpid()))
        self._process.start()

    @property
    def sentinel(self) -> int:
        """Handle that becomes ready when the process ends."""
        return self._process.sentinel

    @property
    def exit_code(self) -> int | None:
        """Exit code, or minus the number of the signal; None while it runs."""
        return self._process.exitcode

    @property
    def status(self) -> Status:
        """How far it is."""
        try:
            job, steps, done = self._status_file.read_text().split(";")
            return Status(job, int(steps), done == _DONE)
        except (OSError, ValueError):
            return Status()

    @property
    def overstays(self) -> bool:
        """Whether its task is done, but threads or exit handlers keep the process alive beyond its grace."""
        if not self.status.is_done:
            return False
        self._done_since = self._done_since or time.monotonic()
        return time.monotonic() - self._done_since > GRACE

    def end(self) -> None:
        """Kill the process, if it still runs, and everything that it started."""
        identifier = self._process.pid
        if identifier is not None:
            descendants = _descendants(identifier)
            with suppress(OSError):
                os.killpg(identifier, signal.SIGKILL)  # the session of the worker bears its number
            for descendant in descendants:  # those that began sessions of their own
                with suppress(OSError):
                    os.kill(descendant, signal.SIGKILL)
        self._process.join(GRACE)
        self.status_at_end = self.status
        self._status_file.unlink(missing_ok=True)


def memory_per_worker(workers: int, share: float) -> int:
    """Bytes that one of several workers may take."""
    import psutil

    return int(psutil.virtual_memory().total * share / workers)


def _main(task: Task, status_file: Path, memory: int, harness: int) -> None:
    """Entry point of the process."""
    with suppress(OSError):
        os.setsid()
    _die_with(harness)
    _limit_memory(memory)
    from benchmark.jobs.runner import work

    latest = ["", "0"]

    def tell(job: str, steps: int) -> None:
        latest[:] = job, str(steps)
        status_file.write_text(f"{job};{steps};")

    work(task, tell)
    status_file.write_text(f"{latest[0]};{latest[1]};{_DONE}")


def _die_with(harness: int) -> None:
    """Ask the system to kill this process when the harness ends, however it ends."""
    if sys.platform != "linux":
        return
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != harness:
        os._exit(1)  # it ended before the system was asked


def _limit_memory(limit: int) -> None:
    """Let a job that eats memory fail alone with a ``MemoryError`` rather than take the machine down."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (limit, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    except (ImportError, ValueError, OSError):
        return  # not every system has this limit; the job then runs without one


def _descendants(identifier: int) -> Sequence[int]:
    import psutil

    try:
        children: list[Any] = psutil.Process(identifier).children(recursive=True)
    except psutil.Error:
        return ()
    return [child.pid for child in children]
