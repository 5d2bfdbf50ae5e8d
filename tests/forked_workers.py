"""Workers that are forked from a process which has imported the suite, in place of processes that start afresh.

They begin in a tenth of a second rather than two and know nothing of the process of the tests. Tests of processes
themselves start real ones.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import forkserver
from multiprocessing.reduction import DupFd
from pathlib import Path
from typing import Any

from benchmark.execution.processes import child
from benchmark.execution.processes import process as processes

_SERVER = forkserver._forkserver


class _Inherited:
    """Environment, folder and open files of whoever sends it: a forked process has those of its server."""

    def __init__(self, mark: str, *files: int) -> None:
        self.environment, self.folder, self.files = os.environ | {processes.reaper.MARK: mark}, Path.cwd(), files

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, ((self.environment, self.folder, *map(DupFd, self.files)),)


class _Forked:
    """What :class:`subprocess.Popen` offers of a process."""

    def __init__(self, process: Any) -> None:
        self._process, self.pid = process, process.pid

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired("", timeout or 0.0)
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        if self._process.exitcode is None:
            os.kill(self.pid, number)


def _begin(address: str, inherited: tuple[Any, ...], quiet: bool) -> None:
    """Begin like a process that starts afresh."""
    environment, folder, *files = inherited
    os.environ.clear()
    os.environ.update(environment)
    with suppress(OSError):
        os.chdir(folder)
    output, error, pipe, trace = (file.detach() for file in files)
    for number, file in ((1, output), (2, error)):
        os.dup2(os.open(os.devnull, os.O_WRONLY) if quiet else file, number)
        os.close(file)
    with suppress(OSError):
        os.setsid()
    _SERVER._forkserver_address, _SERVER.ensure_running = address, lambda: None
    processes._start = start
    child.run(str(pipe), str(trace), str(os.getppid()))


def start(pipe: int, trace: int, mark: str, quiet: bool) -> Any:
    """Fork a process; see :func:`benchmark.execution.processes.process._start`."""
    context = multiprocessing.get_context("forkserver")
    inherited = _Inherited(mark, 1, 2, pipe, trace)
    process = context.Process(target=_begin, args=(_SERVER._forkserver_address, inherited, quiet))
    process.start()
    return _Forked(process)


@contextmanager
def server() -> Iterator[Callable[..., Any]]:
    """Start the process that others are forked from."""
    forkserver.set_forkserver_preload(["tests.forked_imports"])
    forkserver.ensure_running()  # before it could inherit the mark of a worker
    yield start
    os.kill(_SERVER._forkserver_pid, signal.SIGTERM)  # it would wait for all that hold its pipe
    _SERVER._stop()
