"""A process for one task at a time, which may crash, hang or run out of memory without harm to the run.

Messages from the worker are pairs: ``("aside", name)`` when work begins that is charged to no method and
``("aside", "")`` when it ends, ``("print", line)``, and ``("outcome", outcome)``.
"""

from __future__ import annotations

import ctypes
import io
import os
import pickle
import resource
import signal
import subprocess
import sys
import time
from bdb import BdbQuit
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, redirect_stdout, suppress
from multiprocessing.connection import Connection, Pipe
from typing import Any

from benchmark.run.jobs import Outcome, Step, Task

#: Work during which nothing is stopped: kernels may take minutes to compile.
_UNLIMITED = frozenset({"compiling"})

#: A child is killed when the thread that started it ends; this one ends with the program.
_starter = ThreadPoolExecutor(1, thread_name_prefix="workers")


class Worker:
    """A process that runs one task at a time.

    Parameters
    ----------
    memory
        Most bytes of memory that it may take.

    Raises
    ------
    OSError
        If it cannot be started.
    """

    def __init__(self, memory: int) -> None:
        self.connection, theirs = Pipe()
        command = [sys.executable, "-m", "benchmark.run.worker", str(theirs.fileno()), str(memory), str(os.getpid())]

        def start() -> subprocess.Popen[bytes]:
            return subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=2, pass_fds=[theirs.fileno()],
                start_new_session=True,
            )  # fmt: skip

        try:
            self.process = _starter.submit(start).result()
        finally:
            theirs.close()
        self.task = Task(())
        self.waiting: deque[Step] = deque()
        #: Plugin that it has served; "" for the suite.
        self.plugin: str | None = None
        #: Lines that plugins printed, with the name of their method.
        self.printed: list[str] = []
        self.aside = ""
        self._timeout = self._deadline = self._left = float("inf")

    def begin(self, task: Task, timeout: float) -> None:
        """Give it a task; each step may take ``timeout`` seconds, a ranking that for each of its shapes."""
        self.task, self.waiting, self.plugin = task, deque(task.steps), task.steps[0].job.plugin
        self._timeout = timeout * (len(task.gallery.shapes) if task.gallery else 1)
        self._deadline = time.monotonic() + self._timeout
        with suppress(OSError):  # it has just died; outcomes() says so
            self.connection.send(task)

    @property
    def is_alive(self) -> bool:
        """Whether the process runs."""
        return self.process.poll() is None

    def outcomes(self) -> Iterator[tuple[Step, Outcome]]:
        """Yield the steps that have ended; the first one without an outcome is to blame for a death or a time-out."""
        try:
            while self.waiting and self.connection.poll():
                yield from self._receive()
        except (EOFError, OSError, pickle.UnpicklingError):
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(1)
        if self.waiting and not self.is_alive:
            yield from self._blame("killed" if -self.process.returncode in _BY_HAND else "crashed", self._ending())
        elif self.waiting and time.monotonic() > self._deadline:
            self.kill()
            yield from self._blame("timeout", f"stopped after {self._timeout:g} s; pass a longer --timeout")

    def _receive(self) -> Iterator[tuple[Step, Outcome]]:
        kind, content = self.connection.recv()
        now = time.monotonic()
        if kind == "print":
            self.printed.append(f"{self.waiting[0].job.method.name}, {self.task.shape or 'ranking'}: {content}")
        elif kind == "aside":
            if not self.aside:
                self._left = self._deadline - now
            limit = self._timeout if content else self._left
            self.aside, self._deadline = content, float("inf") if content in _UNLIMITED else now + limit
        else:
            self.aside, self._deadline = "", now + self._timeout
            yield self.waiting.popleft(), content

    def _blame(self, status: str, reason: str) -> Iterator[tuple[Step, Outcome]]:
        """Blame the step at work, or the shape if it died over what all methods share."""
        if self.aside in ("preparation", "geodesics"):
            status, reason = "lost", f"its {self.aside}: {reason}"
        yield self.waiting.popleft(), Outcome(status, reason)

    def _ending(self) -> str:
        code = self.process.returncode
        return f"the process ended with {signal.Signals(-code).name if code < 0 else f'exit code {code}'}"

    def kill(self) -> None:
        """End the process and its children."""
        for end in (os.killpg, os.kill):  # there is no group before the session begins
            with suppress(OSError):
                end(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.connection.close()


#: Signals by which users and the system end a process.
_BY_HAND = frozenset({signal.SIGKILL, signal.SIGTERM})


# In the process ------------------------------------------------------------------------------------------------------


def serve(connection: Connection, memory: int, parent: int) -> None:
    """Run the tasks of a worker until its program ends."""
    _die_with(parent)
    resource.setrlimit(resource.RLIMIT_DATA, (memory, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    from benchmark.run.tasks import run_task

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
