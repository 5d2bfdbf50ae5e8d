"""Where tasks run: in worker processes, of which one that dies or hangs is replaced, or in this process."""

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
from multiprocessing.connection import Pipe, wait

from benchmark.errors import BenchmarkError
from benchmark.pipeline.stages import Incomplete
from benchmark.runs.tasks import Outcome, Queue, RunContext, Step, Task, Work

#: Seconds between looks at the workers, and most of them that count between two: a machine may be paused.
INTERVAL, _LONGEST_INTERVAL = 0.2, 1.0

#: Work during which nothing is stopped: kernels may take minutes to compile, and the program has imported plugins, too.
_UNLIMITED = frozenset({"starting", "loading", "compiling"})

#: Signals that a process gets for what its own code does; all others come from outside.
_OWN_SIGNALS = frozenset(
    {signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGTRAP, signal.SIGSYS}
)

#: Work before a method's own, which all methods at a shape share.
_SHARED = frozenset({"preparation", "geodesics"})

#: The program of a worker; a module of its own would exist twice in it, as ``__main__``. The main program stops it;
#: batch systems send SIGINT to every process.
_PROGRAM = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); "
    "from benchmark.runs.tasks import serve; serve(*map(int, sys.argv[1:]))"
)

#: A child is killed when the thread that started it ends; this one ends with the program.
_starter = ThreadPoolExecutor(1, thread_name_prefix="workers")


class Worker:
    """A process for one task at a time; it starts with the first one, and again after its end or for another plugin.

    Parameters
    ----------
    memory
        Most bytes of memory that it may take.
    timeout
        Seconds that a step may take, and a ranking for each of its shapes.
    """

    def __init__(self, memory: int, timeout: float) -> None:
        self._memory, self._timeout = memory, timeout
        self._process: subprocess.Popen[bytes] | None = None
        self.task = Task(())
        self.waiting: deque[Step] = deque()
        #: Plugin that it serves; "" for the suite, None before its start.
        self.plugin: str | None = None
        #: Work under way that is charged to no method.
        self._uncharged: list[str] = []
        #: Seconds for a step, those that are left of it, and the time of the last look at it.
        self._limit = self._left = self._looked = 0.0

    @property
    def is_alive(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.poll() is None

    def begin(self, task: Task) -> None:
        """Give it a task; raise ``BenchmarkError`` if it cannot be started."""
        plugin = task.steps[0].job.plugin
        if not self.is_alive or self.plugin != plugin:
            self.close()
            self._start()
        self.task, self.waiting, self.plugin = task, deque(task.steps), plugin
        self._limit = self._timeout * (len(task.record.shapes) if task.record else 1)
        self._restart_clock()
        with suppress(OSError):  # it has just died; outcomes() says so
            self.connection.send(task)

    def _start(self) -> None:
        try:
            self.connection, theirs = Pipe()
            with theirs:
                numbers = theirs.fileno(), self._memory, os.getpid()
                command = [sys.executable, "-c", _PROGRAM, *map(str, numbers)]
                self._process = _starter.submit(
                    subprocess.Popen, command,
                    stdin=subprocess.DEVNULL, stdout=2, pass_fds=[theirs.fileno()], start_new_session=True,
                ).result()  # fmt: skip
        except OSError as error:
            problem = f"no process can be started: {error.strerror}"
            raise BenchmarkError(problem, "end other programs, or use -j 0") from error
        self._uncharged = ["starting"]

    def _restart_clock(self) -> None:
        self._left = self._limit if _UNLIMITED.isdisjoint(self._uncharged) else float("inf")
        self._looked = time.monotonic()

    def outcomes(self) -> Iterator[tuple[Step, Outcome]]:
        """Yield the steps that have ended; the first one without an outcome is to blame for a death or a time-out."""
        if self._process is None:
            return
        try:
            while self.waiting and self.connection.poll():
                message = self.connection.recv()
                if isinstance(message, Outcome):
                    yield self.waiting.popleft(), message
                elif message is None:
                    self._uncharged.pop()
                else:
                    self._uncharged.append(message)
                self._restart_clock()
        except (EOFError, OSError, pickle.UnpicklingError):
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1)
        before, self._looked = self._looked, time.monotonic()
        self._left -= min(self._looked - before, _LONGEST_INTERVAL)
        if self.waiting and not self.is_alive:
            code = self._process.returncode
            ending = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            is_own = "starting" not in self._uncharged and (code >= 0 or -code in _OWN_SIGNALS)
            yield self._blame("crashed" if is_own else "incomplete", f"the process ended with {ending}")
        elif self.waiting and self._left < 0:
            self.close()
            yield self._blame("timeout", f"stopped after {self._limit:g} s; pass a longer --timeout")

    def _blame(self, status: str, reason: str) -> tuple[Step, Outcome]:
        """Blame the step at work, unless the process ended from outside, or over what all methods share."""
        step, shared = self.waiting.popleft(), _SHARED.intersection(() if self.task.record else self._uncharged)
        for work in shared:
            problem = Incomplete(f"{step.shape} has no result: its {work}: {reason}")
            return step, Outcome("incomplete", str(problem), scope="shape")
        if status == "incomplete":
            reason = str(Incomplete(f"{step.shape or 'the ranking'} has no result: {reason}"))
        return step, Outcome(status, reason)

    def close(self) -> None:
        """End the process and its children."""
        if self._process is None:
            return
        for end in (os.killpg, os.kill):  # there is no group before the session begins
            with suppress(OSError):
                end(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._process = None
        self.connection.close()


class Pool:
    """Workers on this machine.

    Parameters
    ----------
    size
        Number of workers; with 0, tasks run in this process, so that ``breakpoint()`` works: without time-outs, and a
        crash ends the run.
    memory
        Most bytes of memory of each.
    timeout
        Seconds that a method may take for a shape.
    """

    def __init__(self, size: int, memory: int, timeout: float) -> None:
        self._workers = [Worker(memory, timeout) for _ in range(size)]
        self._context = RunContext()

    @property
    def working(self) -> list[str]:
        """What the workers are doing."""
        return [str(worker.waiting[0]) for worker in self._workers if worker.waiting]

    def poll(self, queue: Queue) -> Iterator[tuple[Step, Outcome]]:
        """Begin tasks of a queue, and yield the steps that have ended."""
        if not self._workers and (task := queue.take()):
            work = Work(task, self._context)
            for step in task.steps:
                yield step, work.outcome(step)
        free = [worker for worker in self._workers if not worker.waiting]
        while free and (task := queue.take()):
            free.sort(key=lambda worker: worker.plugin == task.steps[0].job.plugin)
            free.pop().begin(task)
        busy = [worker for worker in self._workers if worker.waiting]
        wait([worker.connection for worker in busy], INTERVAL if busy else 0)
        for worker in busy:
            yield from worker.outcomes()
            if not worker.is_alive:
                queue.appendleft(worker.task._replace(steps=tuple(worker.waiting)))
                worker.waiting.clear()
                worker.close()  # its children

    def close(self) -> None:
        """End the workers."""
        for worker in self._workers:
            worker.close()
