"""Where tasks run: in worker processes, of which one that dies or hangs is replaced, or in this process."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Pipe, wait

from benchmark.errors import BenchmarkError
from benchmark.runs.tasks import Outcome, Queue, Step, Task, Work

#: Steps that have ended: each with its task and its outcome.
Ended = Iterator[tuple[Task, Step, Outcome]]

#: Seconds between looks at the workers.
INTERVAL = 0.2

#: Work during which nothing is stopped: kernels may take minutes to compile, and the program has imported plugins, too.
_UNLIMITED = frozenset({"starting", "loading", "compiling"})

#: Signals by which users and the system end a process.
_BY_HAND = frozenset({signal.SIGKILL, signal.SIGTERM})

#: The program of a worker; a module of its own would exist twice in it, as ``__main__``.
_PROGRAM = "import sys; from benchmark.runs.tasks import serve; serve(*map(int, sys.argv[1:]))"

#: A child is killed when the thread that started it ends; this one ends with the program.
_starter = ThreadPoolExecutor(1, thread_name_prefix="workers")


class Here:
    """Run tasks in the main process, so that ``breakpoint()`` works: without time-outs, and a crash ends the run."""

    working: tuple[str, ...] = ()

    def poll(self, queue: Queue) -> Ended:
        """Run the next task of a queue."""
        if task := queue.take():
            work = Work(task)
            for step in task.steps:
                yield task, step, work.outcome(step)

    def close(self) -> None:
        """Do nothing."""


class Worker:
    """A process that runs one task at a time.

    Parameters
    ----------
    memory
        Most bytes of memory that it may take.

    Raises
    ------
    BenchmarkError
        If it cannot be started.
    """

    def __init__(self, memory: int) -> None:
        try:
            self.connection, theirs = Pipe()
            with theirs:
                numbers = theirs.fileno(), memory, os.getpid()
                command = [sys.executable, "-c", _PROGRAM, *map(str, numbers)]
                self.process = _starter.submit(
                    subprocess.Popen, command,
                    stdin=subprocess.DEVNULL, stdout=2, pass_fds=[theirs.fileno()], start_new_session=True,
                ).result()  # fmt: skip
        except OSError as error:
            problem = f"no process can be started: {error.strerror}"
            raise BenchmarkError(problem, "end other programs, or use -j 0") from error
        self.task = Task(())
        self.waiting: deque[Step] = deque()
        #: Plugin that it has served; "" for the suite.
        self.plugin: str | None = None
        #: Work that is charged to no method; "" while a method is at work.
        self.aside = "starting"
        self._timeout = self._deadline = self._left = float("inf")

    def begin(self, task: Task, timeout: float) -> None:
        """Give it a task; each step may take ``timeout`` seconds, a ranking that for each of its shapes."""
        self.task, self.waiting, self.plugin = task, deque(task.steps), task.steps[0].job.plugin
        self._timeout = self._left = timeout * (len(task.gallery.shapes) if task.gallery else 1)
        self._deadline = self._in(self._timeout)
        with suppress(OSError):  # it has just died; outcomes() says so
            self.connection.send(task)

    def _in(self, seconds: float) -> float:
        return float("inf") if self.aside in _UNLIMITED else time.monotonic() + seconds

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
            code = self.process.returncode
            ending = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            yield self._blame("killed" if -code in _BY_HAND else "crashed", f"the process ended with {ending}")
        elif self.waiting and time.monotonic() > self._deadline:
            self.kill()
            yield self._blame("timeout", f"stopped after {self._timeout:g} s; pass a longer --timeout")

    def _receive(self) -> Iterator[tuple[Step, Outcome]]:
        kind, content = self.connection.recv()
        if kind == "aside":
            if not self.aside:
                self._left = self._deadline - time.monotonic()
            self.aside = content
            self._deadline = self._in(self._timeout if content else self._left)
        else:
            self.aside = ""
            self._deadline = self._in(self._timeout)
            yield self.waiting.popleft(), content

    def _blame(self, status: str, reason: str) -> tuple[Step, Outcome]:
        """Blame the step at work, or the shape if it died over what all methods share."""
        if self.aside in ("preparation", "geodesics"):
            status, reason = "lost", f"its {self.aside}: {reason}"
        return self.waiting.popleft(), Outcome(status, reason)

    def kill(self) -> None:
        """End the process and its children."""
        for end in (os.killpg, os.kill):  # there is no group before the session begins
            with suppress(OSError):
                end(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.connection.close()


class Pool:
    """Workers on this machine.

    Parameters
    ----------
    size
        Number of workers.
    memory
        Most bytes of memory of each.
    timeout
        Seconds that a method may take for a shape.
    """

    def __init__(self, size: int, memory: int, timeout: float) -> None:
        self.size, self.memory, self.timeout = size, memory, timeout
        self._idle: list[Worker] = []
        self._busy: list[Worker] = []
        self._deaths: Counter[str] = Counter()

    @property
    def working(self) -> list[str]:
        """What the workers are doing."""
        steps = ((worker.waiting[0].job, worker.task.shape) for worker in self._busy if worker.waiting)
        return [f"{job.method.name}, {shape}" if shape else f"ranking {job.name}" for job, shape in steps]

    def poll(self, queue: Queue) -> Ended:
        """Begin tasks of a queue, and yield the steps that have ended."""
        while len(self._busy) < self.size and (task := queue.take()):
            worker = self._worker_for(task.steps[0].job.plugin)
            self._busy.append(worker)
            worker.begin(task, self.timeout)
        wait([worker.connection for worker in self._busy], INTERVAL)
        for worker in list(self._busy):
            yield from self._look_at(worker, queue)

    def close(self) -> None:
        """End the workers."""
        for worker in self._busy + self._idle:
            worker.kill()

    def _worker_for(self, plugin: str) -> Worker:
        """Return an idle worker that serves a plugin, or a new one, for which another one makes room."""
        for worker in self._idle:
            if worker.is_alive and worker.plugin == plugin:
                self._idle.remove(worker)
                return worker
        if self._idle:
            self._idle.pop().kill()
        return Worker(self.memory)

    def _look_at(self, worker: Worker, queue: Queue) -> Ended:
        for step, outcome in worker.outcomes():
            if outcome.status in ("crashed", "killed") and self._tries_again(worker, step, outcome):
                queue.appendleft(worker.task._replace(steps=(step,)))
            else:
                yield worker.task, step, outcome
        if not worker.is_alive:
            worker.kill()  # its children
            self._busy.remove(worker)
            queue.appendleft(worker.task._replace(steps=tuple(worker.waiting)))
        elif not worker.waiting:
            self._busy.remove(worker)
            self._idle.append(worker)

    def _tries_again(self, worker: Worker, step: Step, outcome: Outcome) -> bool:
        """Return whether a step gets a second worker: another job of the task, or a user, may be the cause."""
        self._deaths[step.job.key] += 1
        is_alone = len(worker.task.steps) == 1
        return self._deaths[step.job.key] == 1 and (outcome.status == "killed" or not is_alone)
