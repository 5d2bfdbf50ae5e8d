"""Where tasks run: in worker processes, of which one that dies or hangs is replaced, or in this process."""

from __future__ import annotations

import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Pipe, wait
from typing import Protocol

from benchmark.errors import BenchmarkError
from benchmark.pipeline.stages import Incomplete
from benchmark.places import PREFIX, away_from_home
from benchmark.registry.components import THIS_PROCESS
from benchmark.registry.modules import environment
from benchmark.runs.tasks import Outcome, Queue, RunContext, Step, Task, Work

#: Seconds between looks at the workers, and most of them that count between two: a machine may be
#: paused.
POLL_SECONDS, _LONGEST_INTERVAL = 0.2, 1.0

#: Most bytes of a message: what a plugin writes into the connection of its worker may announce any
#: number of them.
_LONGEST_MESSAGE = 2**28

#: Shapes of any data set.
_MANY = 10**6

#: Seconds of waiting work for which another process of the same code starts.
_STARTING = 1.0

#: Work during which nothing is stopped: kernels may take minutes to compile, and the program has
#: imported plugins, too.
_UNLIMITED = frozenset({"starting", "loading", "compiling"})

#: Signals that a process gets for what its own code does; all others come from outside.
_OWN_SIGNALS = frozenset(
    {
        signal.SIGSEGV,
        signal.SIGABRT,
        signal.SIGBUS,
        signal.SIGFPE,
        signal.SIGILL,
        signal.SIGTRAP,
        signal.SIGSYS,
    }
)

#: The program of a worker; a module of its own would exist twice in it, as ``__main__``. The main
#: program stops it; batch systems send SIGINT to every process, and a file in the current folder
#: replaces no module of Python.
_PROGRAM = (
    "import sys; sys.path.append(sys.path.pop(0)); import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); "
    "from benchmark.runs.tasks import serve; serve(*map(int, sys.argv[1:]))"
)

#: A child is killed when the thread that started it ends; this one ends with the program.
_starter = ThreadPoolExecutor(1, thread_name_prefix="workers")


class Workers(Protocol):
    """Where the tasks of a run are done."""

    @property
    def working(self) -> Sequence[str]:
        """What is being worked on, in words."""

    def poll(self, queue: Queue) -> Iterator[tuple[Step, Outcome]]:
        """Begin tasks of a queue, and yield the steps that have ended."""

    def close(self) -> None:
        """End all work."""


class Worker:
    """A process for one task at a time; it starts with the first one, and again after its end or for other code.

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
        #: What the process of a plugin sees as the places of the user.
        self._folder = ""
        self.task = Task(())
        self.waiting: deque[Step] = deque()
        #: Work under way that is charged to no method.
        self._uncharged: list[str] = []
        #: Seconds for a step, those that are left of it, and the time of the last look.
        self._limit = self._left = self._looked = 0.0

    @property
    def is_alive(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.poll() is None

    def begin(self, task: Task) -> None:
        """Give it a task; raise ``BenchmarkError`` if it cannot be started."""
        if not self.is_alive or self.task.process != task.process:
            self.close()
            self._start(task.process)
        self.task, self.waiting = task, deque(task.steps)
        is_of_shape = bool(task.steps[0].shape)  # the camera takes as long as its data set is large
        self._limit = self._timeout * (
            len(task.record.shapes) if task.record else 1 if is_of_shape else _MANY
        )
        self._restart_clock()
        with suppress(OSError):  # it has just died; outcomes() says so
            self.connection.send(task)

    def _start(self, process: str) -> None:
        try:
            self.connection, theirs = Pipe()
            with theirs:
                numbers = theirs.fileno(), self._memory, os.getpid()
                command = [sys.executable, "-c", _PROGRAM, *map(str, numbers)]
                variables = environment()
                if process:  # of a plugin
                    self._folder = tempfile.mkdtemp(prefix=PREFIX)
                    variables = away_from_home(variables, self._folder)
                self._process = _starter.submit(
                    subprocess.Popen,
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=2,
                    pass_fds=[theirs.fileno()],
                    start_new_session=True,
                    env=variables,
                ).result()
        except OSError as error:
            problem = f"no process can be started: {error.strerror}"
            raise BenchmarkError(problem, "end other programs, or use -j 0") from error
        self._uncharged = ["starting"]

    @property
    def elapsed(self) -> float:
        """Seconds since it began what it does; 0 while it starts, loads or compiles."""
        return max(0.0, self._limit - self._left)

    def _restart_clock(self) -> None:
        self._left = self._limit if _UNLIMITED.isdisjoint(self._uncharged) else float("inf")
        self._looked = time.monotonic()

    def outcomes(self) -> Iterator[tuple[Step, Outcome]]:
        """Yield the steps that have ended; the first one without an outcome is to blame for a death or a time-out."""
        if self._process is None:
            return
        try:
            while self.waiting and self.connection.poll():
                message = pickle.loads(self.connection.recv_bytes(_LONGEST_MESSAGE))  # noqa: S301
                if isinstance(message, Outcome):
                    yield self.waiting.popleft(), message
                    if message.ends_process:
                        self.close()
                        return
                elif message is None:
                    self._uncharged.pop()
                else:
                    self._uncharged.append(message)
                self._restart_clock()
        except Exception:  # it has ended, or what it runs wrote into the connection
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1)
            self._process.kill()
            self._process.wait()
        before, self._looked = self._looked, time.monotonic()
        self._left -= min(self._looked - before, _LONGEST_INTERVAL)
        if self.waiting and not self.is_alive:
            code = self._process.returncode
            ending = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            is_own = "starting" not in self._uncharged and (code >= 0 or -code in _OWN_SIGNALS)
            yield self._blame(
                "crashed" if is_own else "incomplete", f"the process ended with {ending}"
            )
        elif self.waiting and self._left < 0:
            self.close()
            yield self._blame(
                "timeout", f"stopped after {self._limit:g} s; pass a longer --timeout"
            )

    def _blame(self, status: str, reason: str) -> tuple[Step, Outcome]:
        """Blame the method of the step at work, unless the process ended from outside, or over what is the suite's."""
        step, in_geodesics = self.waiting.popleft(), "geodesics" in self._uncharged
        if step.stage == "prepared" or in_geodesics or status == "incomplete":
            work = (
                "its geodesics: "
                if in_geodesics
                else "its preparation: "
                if step.stage == "prepared"
                else ""
            )
            what = "the ranking" if self.task.record else step.shape or "the camera"
            problem = Incomplete(f"{what} has no result: {work}{reason}")
            return step, Outcome("incomplete", str(problem), of_shape=in_geodesics)
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
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = ""


class Pool:
    """Workers on this machine; objects of a Python program run in this process, without time-outs.

    Parameters
    ----------
    size
        Number of workers that work at a time.
    memory
        Most bytes of memory of each.
    timeout
        Seconds that a method may take for a shape.
    """

    def __init__(self, size: int, memory: int, timeout: float) -> None:
        self._size, self._memory, self._timeout = size, memory, timeout
        self._workers: list[Worker] = []
        self._context = RunContext()

    @property
    def working(self) -> list[str]:
        """What the workers are doing."""
        return [str(worker.waiting[0]) for worker in self._busy]

    @property
    def _busy(self) -> list[Worker]:
        return [worker for worker in self._workers if worker.waiting]

    def poll(self, queue: Queue) -> Iterator[tuple[Step, Outcome]]:
        """Begin tasks of a queue, and yield the steps that have ended."""
        if task := queue.take(THIS_PROCESS):
            work = Work(task, self._context)
            for step in task.steps:
                yield step, work.outcome(step)
        while len(self._busy) < self._size:
            idle = [worker for worker in self._workers if not worker.waiting]
            task = queue.take_any([worker.task.process for worker in idle])
            if task is None:
                break
            # That of the suite waits while a plugin's works, and another plugin's ends.
            fitting = [worker for worker in idle if worker.task.process == task.process]
            others = [worker for worker in idle if worker.task.process]
            alike = [worker.elapsed for worker in self._busy if worker.task.process == task.process]
            if alike and not fitting and max(alike) * queue.count(task.process) < _STARTING:
                queue.add(task, first=True)
                break
            worker, *_ = fitting or others or [Worker(self._memory, self._timeout)]
            worker.begin(task)
            if worker not in self._workers:
                self._workers.append(worker)
        busy = self._busy
        wait([worker.connection for worker in busy], POLL_SECONDS if busy else 0)
        for worker in busy:
            yield from worker.outcomes()
            if not worker.is_alive:
                if worker.waiting:
                    queue.add(worker.task._replace(steps=tuple(worker.waiting)), first=True)
                    worker.waiting.clear()
                worker.close()  # its children

    def close(self) -> None:
        """End the workers."""
        for worker in self._workers:
            worker.close()
