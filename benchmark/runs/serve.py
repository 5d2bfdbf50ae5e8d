"""The program of a worker: it runs tasks until its program ends.

Messages to the program are pairs: ``("aside", name)`` when work begins that is charged to no method and
``("aside", "")`` when it ends, ``("print", line)``, and ``("outcome", outcome)``.
"""

from __future__ import annotations

import ctypes
import io
import os
import resource
import signal
import sys
from bdb import BdbQuit
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from multiprocessing.connection import Connection
from typing import Any

from benchmark.runs.jobs import Outcome
from benchmark.runs.tasks import run_task


def serve(connection: Connection, memory: int, parent: int) -> None:
    """Run the tasks of a worker until its program ends."""
    _die_with(parent)
    resource.setrlimit(resource.RLIMIT_DATA, (memory, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    at_work = [""]

    @contextmanager
    def aside(name: str) -> Iterator[None]:
        at_work.append(name)
        connection.send(("aside", name))
        try:
            yield
        finally:
            at_work.pop()
            connection.send(("aside", at_work[-1]))

    _watch_compiling(aside)
    connection.send(("aside", ""))
    with suppress(EOFError, OSError), redirect_stdout(_Printed(connection)):  # the program has ended
        while True:
            task = connection.recv()
            for outcome in _interruptible(run_task(task, aside)):
                connection.send(("outcome", outcome))


def _interruptible(outcomes: Iterator[Outcome]) -> Iterator[Outcome]:
    """Yield outcomes; what ends a run in the main process only fails a step here, where there is no terminal."""
    try:
        yield from outcomes
    except (KeyboardInterrupt, BdbQuit) as error:
        yield Outcome("failed", f"it raises {type(error).__name__}: use a debugger with -j 0")


class _Printed(io.TextIOBase):
    """Standard output of plugins, which goes to the main program line by line."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._rest = connection, ""

    def write(self, text: str) -> int:
        *lines, self._rest = (self._rest + text).split("\n")
        for line in lines:
            self._connection.send(("print", line))
        return len(text)


def _die_with(parent: int) -> None:
    """Let the system end this process with its parent, also if that is killed."""
    with suppress(AttributeError, OSError):  # only Linux has it; elsewhere, a worker ends after its task
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        sys.exit(1)


def _watch_compiling(aside: Any) -> None:
    """Say when numba compiles, which counts for no time-out."""
    from numba.core import event

    class Compiling(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            block = aside("compiling")
            block.__enter__()
            blocks.append(block)

        def on_end(self, event: Any) -> None:
            blocks.pop().__exit__(None, None, None)

    blocks: list[Any] = []
    event.register("numba:compile", Compiling())


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])), int(sys.argv[2]), int(sys.argv[3]))
