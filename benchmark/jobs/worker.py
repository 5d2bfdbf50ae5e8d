"""A worker: one process for one task, in a session of its own, that dies with the harness."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import secrets
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from pathlib import Path

from benchmark.jobs.orders import Task

_DONE = "done"

#: ``PR_SET_PDEATHSIG`` of Linux.
_PARENT_DEATH_SIGNAL = 1

#: Seconds that a process has to end once it was killed.
GRACE = 5.0

#: Environment variable by which the processes that a worker started are known as its own.
_MARK = "CANONICAL_FORMS_WORKER"


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
        self._mark = secrets.token_hex(16)
        self._status_file = status_file = progress / f"{os.getpid()}-{number}"
        status_file.unlink(missing_ok=True)
        resource_tracker.ensure_running()  # it serves all workers, and must not bear the mark of the first
        context = multiprocessing.get_context("spawn")
        self._process = context.Process(target=_main, args=(task, status_file, memory, os.getpid()))
        with _without_interrupts():
            os.environ[_MARK] = self._mark
            try:
                self._process.start()
            finally:
                del os.environ[_MARK]

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

    def end(self) -> None:
        """Kill the process, if it still runs, and everything that it started."""
        identifier = self._process.pid
        if identifier is not None:
            with suppress(OSError):
                os.killpg(identifier, signal.SIGKILL)  # the session of the worker bears its number
        for process in _marked(self._mark):  # those that began sessions of their own
            with suppress(OSError):
                os.kill(process, signal.SIGKILL)
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
    # All that counts is on the disk. Exit handlers and threads of a method could only hang or complain.
    os._exit(0)


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


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Let what is started in the body not hear of Ctrl-C, which is for the harness alone; it hears of it afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _marked(mark: str) -> Iterator[int]:
    """Processes that a worker started, directly or not: they have inherited the mark in its environment."""
    import psutil

    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if process.environ().get(_MARK) == mark:
                yield process.pid
