"""A worker of a run: it does one task, and tells in a file how far it is and where it was when it crashed."""

from __future__ import annotations

import faulthandler
import json
import os
import signal
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmark.jobs.job_specs import from_json
from benchmark.storage.store import StorageError
from benchmark.system import fingerprints, plugins, services
from benchmark.system.workers import UNWRITTEN, Worker

#: Seconds that a process has to write down where it is before it is stopped.
_LAST_WORDS = 0.3


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

    Raises
    ------
    OSError
        If the system starts no further process.
    """

    def __init__(self, task: str, status_file: Path, memory: int) -> None:
        self.status_at_end = Status()
        #: Where it was when it crashed or was stopped, as a traceback.
        self.trace = ""
        self._status_file = status_file
        remove_status(status_file)
        self._worker = Worker(_do, task, status_file, fingerprints.export_cache(), memory=memory)

    @property
    def sentinel(self) -> int:
        """Handle that becomes ready when the process ends."""
        return self._worker.sentinel

    @property
    def exit_code(self) -> int | None:
        """Exit code, or minus the number of the signal; None while it runs."""
        return self._worker.exit_code

    @property
    def status(self) -> Status:
        """Return how far it is."""
        return read_status(self._status_file) or Status()

    def stop(self) -> None:
        """End a process that still runs, after it has written down where it is."""
        self._worker.send(signal.SIGUSR1)
        time.sleep(_LAST_WORDS)
        self.end()

    def end(self) -> None:
        """Kill the process, if it still runs, and everything that it started."""
        self._worker.end()
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
    for path in (status_file, _beside(status_file, "trace"), _beside(status_file, "next")):
        path.unlink(missing_ok=True)


def _beside(status_file: Path, what: str) -> Path:
    return status_file.with_name(f"{status_file.name}-{what}")


def _do(task: str, status_file: Path, known: fingerprints.ImportCache) -> None:
    """Do the task, in its process."""
    plugins.close_process()
    fingerprints.import_cache(known)
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
        work(from_json(task), tell)
    except (StorageError, OSError):  # not even a record could be written; whoever waits for it says so
        os._exit(UNWRITTEN)
    tell(latest.job, latest.steps, is_done=True)
