"""A process for one task at a time, which may crash, hang or run out of memory without harm to the run."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Pipe

from benchmark.runs.jobs import Outcome, Step, Task

#: Work during which nothing is stopped: kernels may take minutes to compile, and the program has imported plugins, too.
_UNLIMITED = frozenset({"starting", "loading", "compiling"})

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
        command = [sys.executable, "-m", "benchmark.runs.serve", str(theirs.fileno()), str(memory), str(os.getpid())]

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
        #: Work that is charged to no method; "" while a method is at work.
        self.aside = "starting"
        self._timeout = self._deadline = self._left = float("inf")

    def begin(self, task: Task, timeout: float) -> None:
        """Give it a task; each step may take ``timeout`` seconds, a ranking that for each of its shapes."""
        self.task, self.waiting, self.plugin = task, deque(task.steps), task.steps[0].job.plugin
        self._timeout = timeout * (len(task.gallery.shapes) if task.gallery else 1)
        self._left = self._timeout
        self._deadline = float("inf") if self.aside in _UNLIMITED else time.monotonic() + self._timeout
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
