"""Where tasks run: in worker processes or in this process.

A worker process that dies or hangs is replaced.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Pipe, wait
from typing import Protocol

from benchmark.errors import BenchmarkError
from benchmark.machine import THREADS
from benchmark.pipeline.stages import Incomplete
from benchmark.places import away_from_home, make_folder, remove_folder
from benchmark.registry.components import THIS_PROCESS
from benchmark.registry.modules import environment
from benchmark.runs.tasks import (
    UNCHARGED_WORK_ENDS,
    Outcome,
    Queue,
    RunContext,
    Step,
    Task,
    Work,
)
from benchmark.runs.unchanged import state_of_suite

#: Seconds between looks at the workers.
POLL_SECONDS = 0.2

#: Most seconds between two looks that count for a step: a machine may be paused.
_LONGEST_INTERVAL = 1.0

#: Most bytes of a message: what a plugin writes into the connection of its worker may announce any
#: number of them.
_LONGEST_MESSAGE = 2**28

#: Number of shapes for whose time the frame of a camera may be fitted: those of any data set.
_MOST_SHAPES = 10**6

#: Seconds of waiting work for which another process of the same code starts.
_WORTH_A_PROCESS = 1.0

#: Most threads that share a comparison of shapes: each takes some 16 MB, and the memory of a
#: process is the smaller the more there are.
_MOST_THREADS = 8

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

#: What may be behind signals that the system sends.
_CAUSES: dict[int, str] = {
    signal.SIGKILL: ": sent by somebody, or as memory or its processor time was used up",
    signal.SIGXCPU: (
        ": it used up its processor time, which 'ulimit -t', a batch system or a method limits"
    ),
}

#: Seconds that a process may take to end once its connection is closed.
_LONGEST_END = 10.0

#: The same once what it has sent cannot be read: it may have been killed while it sent that.
_LONGEST_END_OF_SENDER = 1.0

#: Why a process was ended that cannot be understood.
_CUT_OFF = (
    "its process closed the connection to the run, or sent what is no outcome; "
    "a method may not write to, or close, a descriptor that it did not open"
)

#: Environment variable without which each process has another order of the texts in a set, so that
#: a method that depends on it would have other figures in each run.
_ORDER_OF_SETS = "PYTHONHASHSEED"

#: The program of a worker; a module of its own would exist twice in it, as ``__main__``. The main
#: program stops it; batch systems send SIGINT to every process, and a file in the current folder
#: replaces no module of Python. It finds the modules that the main program finds, which may have
#: added folders to their path.
_PROGRAM = """
import sys
sys.path.append(sys.path.pop(0))
import json
import signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
numbers, places = map(json.loads, sys.argv[1:])
sys.path += [place for place in places if place not in sys.path]
from benchmark.runs.tasks import serve
serve(*numbers)
"""

#: A child is killed when the thread that started it ends; this one ends with the program.
_starter = ThreadPoolExecutor(1, thread_name_prefix="workers")


def _ends_by_itself(process: subprocess.Popen[bytes], error: Exception) -> bool:
    """Return whether a process ended that cannot be heard any more; if not, end it.

    Parameters
    ----------
    process
        The process.
    error
        What its connection raised. One that is closed tells of the end of the process, unless the
        process closed it itself. Any other error is of a message that the end of the process has
        cut off, or of what a method wrote into the connection.
    """
    is_closed = isinstance(error, EOFError | ConnectionError)
    try:
        process.wait(_LONGEST_END if is_closed else _LONGEST_END_OF_SENDER)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return False
    return True


def _ending(code: int) -> str:
    """Say how a process ended, by its exit code, which is negative for a signal."""
    if code >= 0:
        return f"exit code {code}"
    with suppress(ValueError):  # most signals of real time have no name
        return signal.Signals(-code).name + _CAUSES.get(-code, "")
    return f"signal {-code}"


class Workers(Protocol):
    """Where the tasks of a run are done."""

    @property
    def working(self) -> Sequence[str]:
        """What is being worked on, in words."""

    def poll(self, queue: Queue) -> Iterator[tuple[Step, Outcome]]:
        """Begin tasks of a queue, and yield the steps that have ended."""

    def close(self) -> None:
        """End all work."""


class _Countdown:
    """The seconds that are left for a step, as far as the machine was not paused."""

    def __init__(self) -> None:
        self.limit = 0.0
        self._left = 0.0
        self._last_look = 0.0

    def restart(self, *, is_limited: bool) -> None:
        """Begin again, with a limit or without one."""
        self._left = self.limit if is_limited else float("inf")
        self._last_look = time.monotonic()

    def look(self) -> None:
        """Take off the time since the last look."""
        now = time.monotonic()
        self._left -= min(now - self._last_look, _LONGEST_INTERVAL)
        self._last_look = now

    @property
    def is_over(self) -> bool:
        """Whether more time than the limit has passed."""
        return self._left < 0

    @property
    def elapsed(self) -> float:
        """Seconds that have passed; 0 without a limit."""
        return max(0.0, self.limit - self._left)


class Worker:
    """A process for one task at a time.

    It starts with the first task, and again after its end or for other code.

    Parameters
    ----------
    memory
        Most bytes of memory that its process may take.
    timeout
        Seconds that a step may take, and a ranking for each query and shape of the gallery.
    threads
        Threads that share the comparison of shapes of one ranking.
    """

    def __init__(self, memory: int, timeout: float, threads: int) -> None:
        """Prepare a worker; its process is started with its first task."""
        self._memory = memory
        self._timeout = timeout
        self._threads = threads
        self._process: subprocess.Popen[bytes] | None = None
        #: Empty folder that the process of a plugin sees as the user's home; "" for none.
        self._folder = ""
        self.task = Task(())
        #: Steps of the task without an outcome, in their order.
        self.waiting: deque[Step] = deque()
        #: Names of the work under way that counts against no time limit, such as "geodesics".
        self._uncharged: list[str] = []
        self._countdown = _Countdown()

    @property
    def is_alive(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.poll() is None

    @property
    def elapsed(self) -> float:
        """Seconds since it began what it does; 0 while it starts, loads or compiles."""
        return self._countdown.elapsed

    def begin(self, task: Task) -> None:
        """Give it a task; raise ``BenchmarkError`` if it cannot be started."""
        if not self.is_alive or self.task.process != task.process:
            self.close()
            self._start(task.process)
        self.task = task
        self.waiting = deque(task.steps)
        self._countdown.limit = self._time_limit(task)
        self._restart_countdown()
        with suppress(OSError):  # it has just died; outcomes() says so
            self.connection.send(task)

    def _time_limit(self, task: Task) -> float:
        """Return the seconds that each step of a task may take."""
        if task.record:
            n_shapes = sum(len(side.shapes) for side in task.record.sides)
            return self._timeout * n_shapes
        is_frame = not task.steps[0].view
        if is_frame:  # which takes as long as its data set is large
            return self._timeout * _MOST_SHAPES
        return self._timeout

    def _start(self, process: str) -> None:
        """Start the process of this worker, and connect to it.

        Parameters
        ----------
        process
            Name of the plugin whose code it will run; "" for the code of the suite. The process of
            a plugin sees an empty folder in place of the user's home.

        Raises
        ------
        BenchmarkError
            If the system starts no process, or makes no folder for it.
        """
        try:
            self.connection, theirs = Pipe()
            with theirs:
                numbers = theirs.fileno(), self._memory, os.getpid(), state_of_suite()
                places = [place for place in sys.path if isinstance(place, str)]
                arguments = json.dumps(numbers), json.dumps(places)
                variables = environment() | {THREADS: str(self._threads), _ORDER_OF_SETS: "0"}
                if process:  # of a plugin
                    self._folder = make_folder()
                    variables = away_from_home(variables, self._folder)
                # The system ends the process together with the thread that starts it, so that one
                # thread, which lasts as long as the program, starts all of them.
                starting = _starter.submit(
                    subprocess.Popen,
                    [sys.executable, "-c", _PROGRAM, *arguments],
                    stdin=subprocess.DEVNULL,
                    stdout=2,  # stderr: the program's stdout is for results
                    pass_fds=[theirs.fileno()],
                    start_new_session=True,
                    env=variables,
                )
                self._process = starting.result()
        except (OSError, RuntimeError) as error:  # the latter without a thread that starts it
            self.close()
            problem = f"no process can be started: {getattr(error, 'strerror', error)}"
            raise BenchmarkError(problem, "end other programs, or use -j 0") from error
        self._uncharged = ["starting"]

    def _restart_countdown(self) -> None:
        """Let the next step, or what follows uncharged work, have all of its time."""
        self._countdown.restart(is_limited=_UNLIMITED.isdisjoint(self._uncharged))

    def outcomes(self) -> Iterator[tuple[Step, Outcome]]:
        """Yield the steps of this worker that have ended since the last call, with their outcomes.

        If the process died, or took too long, the step at work ends with it.
        """
        process = self._process
        if process is None:
            return
        is_cut_off = False
        try:
            yield from self._received()
        except Exception as error:
            is_cut_off = not _ends_by_itself(process, error)
        if self._process is not process:  # _received() has closed it, as its code is outdated
            return

        self._countdown.look()
        if self.waiting and is_cut_off:
            yield self._blame("crashed", _CUT_OFF)
        elif self.waiting and not self.is_alive:
            yield self._ended(process.returncode)
        elif self.waiting and self._countdown.is_over:
            self.close()
            reason = f"stopped after {self._countdown.limit:g} s; pass a longer --timeout"
            yield self._blame("timeout", reason)

    def _received(self) -> Iterator[tuple[Step, Outcome]]:
        """Read the messages that have come, and yield each outcome among them with its step.

        The other messages tell when work begins and ends that counts against no time limit.
        """
        while self.waiting and self.connection.poll():
            content = self.connection.recv_bytes(_LONGEST_MESSAGE)
            message = pickle.loads(content)  # noqa: S301  # of a process of the same user
            if isinstance(message, Outcome):  # steps end in their order
                yield self.waiting.popleft(), message
                if message.ends_process:
                    self.close()
                    return
            elif message is UNCHARGED_WORK_ENDS:
                self._uncharged.pop()
            else:  # the name of such work, which begins
                self._uncharged.append(message)
            self._restart_countdown()

    def _ended(self, code: int) -> tuple[Step, Outcome]:
        """Return the step during which the process ended, with the outcome.

        Its own code ended it unless a signal came from outside, or it was still starting.
        """
        is_from_inside = code >= 0 or -code in _OWN_SIGNALS
        is_own = is_from_inside and "starting" not in self._uncharged
        status = "crashed" if is_own else "incomplete"
        return self._blame(status, f"the process ended with {_ending(code)}")

    def _blame(self, status: str, reason: str) -> tuple[Step, Outcome]:
        """Return the step at work, and its outcome after the process died or was stopped.

        The method of the step is to blame, unless the suite was computing geodesics or preparing a
        shape, or the process was ended from outside. The outcome is then ``"incomplete"``.

        Parameters
        ----------
        status
            What happened: ``"crashed"``, ``"timeout"``, or ``"incomplete"`` for an end from
            outside.
        reason
            The same in words.
        """
        step = self.waiting.popleft()
        in_geodesics = "geodesics" in self._uncharged
        if in_geodesics:
            work = "its geodesics: "
        elif step.stage == "prepared":
            work = "its preparation: "
        elif status == "incomplete":
            work = ""
        else:
            return step, Outcome(status, reason)  # the fault of the method

        subject = "the ranking" if self.task.record else step.view or "the camera"
        problem = Incomplete(f"{subject} has no result: {work}{reason}")
        return step, Outcome("incomplete", str(problem), of_shape=in_geodesics)

    def close(self) -> None:
        """End the process and its children, close its connection, and delete its home folder."""
        if self._process is not None:
            self._end_process(self._process)
        if self._folder:
            remove_folder(self._folder)
            self._folder = ""

    def _end_process(self, process: subprocess.Popen[bytes]) -> None:
        """End the process and its children, and close its connection."""
        # Kill the group that the process leads, and with it its children. In its first moments it
        # leads none, and has to be killed itself.
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
        process.kill()
        process.wait()
        self._process = None
        self.connection.close()


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
        self._size = size
        self._memory = memory
        self._timeout = timeout
        self._workers: list[Worker] = []
        self._context = RunContext()

    @property
    def working(self) -> list[str]:
        """What the workers are doing."""
        return [str(worker.waiting[0]) for worker in self._busy]

    @property
    def _busy(self) -> list[Worker]:
        """The workers that work."""
        return [worker for worker in self._workers if worker.waiting]

    def poll(self, queue: Queue) -> Iterator[tuple[Step, Outcome]]:
        """Give tasks of a queue to workers, and yield the steps that have ended."""
        yield from self._work_here(queue)
        self._begin_tasks(queue)
        busy = self._busy
        if busy:  # pause until one of them sends something
            wait([worker.connection for worker in busy], POLL_SECONDS)
        for worker in busy:
            yield from worker.outcomes()
            if not worker.is_alive:
                self._put_back(worker, queue)
                worker.close()  # this ends its children, too

    def _work_here(self, queue: Queue) -> Iterator[tuple[Step, Outcome]]:
        """Do the next task of objects of a program in this process."""
        task = queue.take(THIS_PROCESS)
        if task:
            work = Work(task, self._context)
            for step in task.steps:
                yield step, work.outcome(step)

    def _begin_tasks(self, queue: Queue) -> None:
        """Give waiting tasks to workers, until all are busy or no task should begin now."""
        while len(self._busy) < self._size:
            idle = [worker for worker in self._workers if not worker.waiting]
            task = queue.take_any([worker.task.process for worker in idle])
            if task is None:
                return
            worker = self._worker_for(task, idle, queue.count(task.process))
            if worker is None:  # it is faster to wait for a busy one
                queue.add(task, first=True)
                return
            worker.begin(task)
            if worker not in self._workers:
                self._workers.append(worker)

    def _worker_for(self, task: Task, idle: Sequence[Worker], n_waiting: int) -> Worker | None:
        """Return the worker for a task; None if the task had better wait for one that is busy.

        The suite and each plugin have processes of their own, because a plugin may change what is
        in the memory of its process.

        Parameters
        ----------
        task
            The task, of the suite or of a plugin.
        idle
            The workers without work.
        n_waiting
            Number of further tasks of the same plugin, or of the suite.
        """
        for worker in idle:
            if worker.task.process == task.process:
                return worker

        # Starting a process takes seconds. Short tasks are done sooner by the busy ones.
        elapsed = [worker.elapsed for worker in self._busy if worker.task.process == task.process]
        if elapsed and max(elapsed) * n_waiting < _WORTH_A_PROCESS:
            return None

        # Take the place of an idle process of another plugin, but keep those of the suite.
        for worker in idle:
            is_of_plugin = worker.task.process != ""
            if is_of_plugin:
                return worker
        # The last ranking of a run may use other cores, too. While other processes go on, its
        # threads share the cores with them.
        return Worker(self._memory, self._timeout, min(self._size, _MOST_THREADS))

    @staticmethod
    def _put_back(worker: Worker, queue: Queue) -> None:
        """Return the steps that a worker has not begun to the queue."""
        if worker.waiting:
            queue.add(worker.task._replace(steps=tuple(worker.waiting)), first=True)
            worker.waiting.clear()

    def close(self) -> None:
        """End the workers."""
        for worker in self._workers:
            worker.close()
