"""A worker of a run: it does tasks in turn, and tells in a file how far it is and where it was when it crashed."""

from __future__ import annotations

import faulthandler
import json
import os
import signal
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmark.jobs.foreign.remote import close_to_plugins
from benchmark.jobs.job_specs import task_of
from benchmark.storage import lock
from benchmark.storage.store import StorageError
from benchmark.system import services
from benchmark.system.files import write_text
from benchmark.system.workers import UNWRITTEN, Worker

#: Seconds that a process has to write down where it is before it is stopped.
_LAST_WORDS = 0.3

#: Seconds between two looks of a process without a task for the next one, and until it leaves.
_INTERVAL, _PATIENCE = 0.02, 30.0


@dataclass(frozen=True)
class Status:
    """Progress of a worker, as it said last.

    Parameters
    ----------
    job
        Key of the job that it is at; "" before the first one.
    steps
        Shapes of its batch that are behind it.
    shape
        Identifier of the shape that it is at; "" between shapes.
    is_done
        Whether the task is finished.
    """

    job: str = ""
    steps: int = 0
    shape: str = ""
    is_done: bool = False


class TaskWorker:
    """A running process with its task.

    Parameters
    ----------
    task
        What to do, as :func:`benchmark.jobs.job_specs.to_json` writes it.
    status_file
        Where it says how far it is.
    memory
        Bytes that it may take.
    package
        Package of the tasks that its process may do when it has finished this one; "" for none.

    Raises
    ------
    OSError
        If the system starts no further process.
    """

    def __init__(self, task: str, status_file: Path, memory: int, package: str = "") -> None:
        self.status_at_end = Status()
        #: Where it was when it crashed or was stopped, as a traceback.
        self.trace = ""
        self.package = package
        #: Whether its process waits for another task, and whether it was killed.
        self.waits = self.is_over = False
        self._status_file = status_file
        #: Where its process finds its further tasks.
        self._handover = _beside(status_file, "task")
        remove_status(status_file)
        self._handover.unlink(missing_ok=True)
        self._worker = Worker(_do_in_turn, task, status_file, memory=memory)

    @property
    def sentinel(self) -> int:
        """Handle that becomes ready when the process ends."""
        return self._worker.sentinel

    @property
    def exit_code(self) -> int | None:
        """Exit code, or minus the number of the signal, or 0 once the task is finished; None while it runs."""
        code = self._worker.exit_code
        return 0 if code is None and (self.status_at_end.is_done or self.status.is_done) else code

    @property
    def status(self) -> Status:
        """Return how far it is."""
        return read_status(self._status_file) or Status()

    def stop(self) -> None:
        """End a process that still runs, after it has written down where it is."""
        self._worker.send(signal.SIGUSR1)
        time.sleep(_LAST_WORDS)
        self.end()

    def do_next(self, task: str, status_file: Path) -> bool:
        """Hand another task to the process that waits for one; returns whether there still is such a process."""
        if not self.waits or self._worker.exit_code is not None:
            return False
        self._status_file = status_file
        write_text(self._handover, json.dumps([task, str(status_file)]))
        self.status_at_end, self.trace, self.waits = Status(), "", False
        return True

    def kill(self) -> None:
        """Kill the process, if it still runs, and everything that it started."""
        self.waits, self.is_over = False, True
        self._worker.end()
        self._handover.unlink(missing_ok=True)

    def end(self) -> None:
        """Kill the process, unless it has finished its task and may do another one: then it waits."""
        self.waits = bool(self.package) and self._worker.exit_code is None and self.status.is_done
        if not self.waits:
            self.kill()
        self.status_at_end = read_status(self._status_file) or self.status_at_end
        with suppress(OSError):
            self.trace = _beside(self._status_file, "trace").read_text(encoding="utf-8", errors="replace")
        remove_status(self._status_file)


def read_status(status_file: Path) -> Status | None:
    """Return how far a worker is; None where it has not said so."""
    try:
        return Status(**json.loads(status_file.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def remove_status(status_file: Path) -> None:
    """Remove what a worker has said."""
    for path in (status_file, *(_beside(status_file, what) for what in ("trace", "next"))):
        path.unlink(missing_ok=True)


def _beside(status_file: Path, what: str) -> Path:
    return status_file.with_name(f"{status_file.name}-{what}")


def _do_in_turn(task: str, status_file: Path) -> None:
    """Do the task, and then those that come after it, in their process; it is killed when there are no more."""
    following = _beside(status_file, "task")
    while True:
        _do(task, status_file)
        finished = time.monotonic()
        while not following.exists():
            if time.monotonic() > finished + _PATIENCE:
                return
            time.sleep(_INTERVAL)
        task, name = json.loads(following.read_text(encoding="utf-8"))
        status_file = Path(name)
        following.unlink()
        lock.forget()  # the code may have changed since


def _do(task: str, status_file: Path) -> None:
    """Do the task, in its process."""
    close_to_plugins()
    with suppress(OSError):  # somebody may have removed the folder; only the place of a crash stays unknown then
        trace_file = _beside(status_file, "trace")
        services.trace_to(trace_file)
        trace = trace_file.open("wb")  # stays open: the system writes to it when all is lost
        faulthandler.enable(trace, all_threads=False)
        faulthandler.register(signal.SIGUSR1, trace, all_threads=False, chain=True)
    from benchmark.jobs.execution.runner import work

    latest = Status()
    beside = _beside(status_file, "next")

    def tell(job: str, steps: int, shape: str = "", *, is_done: bool = False) -> None:
        nonlocal latest
        latest = Status(job, steps, shape, is_done)
        with suppress(OSError):  # a full disk is told of by what cannot do without it
            beside.parent.mkdir(exist_ok=True)  # somebody may have removed it
            beside.write_text(json.dumps(asdict(latest)), encoding="utf-8")
            beside.replace(status_file)  # so that no reader finds half of it

    try:
        work(task_of(task), tell)
    except (StorageError, OSError):  # not even a record could be written; whoever waits for it says so
        os._exit(UNWRITTEN)
    tell(latest.job, latest.steps, is_done=True)
