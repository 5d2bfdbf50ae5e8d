"""Child processes that answer requests over a private pipe and can crash, hang or run out of memory in isolation.

Each runs in its own session and is killed, with all its descendants, when this process ends. A process serves one lane:
the suite alone, or the code of one plugin file. No other module starts processes;
:mod:`benchmark.execution.processes.child` is their main program.
"""

from __future__ import annotations

import itertools
import os
import pickle
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any

import numpy as np

from benchmark.arrays import Arrays
from benchmark.errors import from_facts
from benchmark.execution.processes import reaper
from benchmark.execution.processes.channel import Channel, Facts, Message

#: Reports progress, a JSON value, to the sender of the current request.
Tell = Callable[[Any], None]

#: Handler of a request: takes its facts, its arrays and a function that reports progress; returns facts and arrays.
Serve = Callable[[Mapping[str, Any], Arrays, Tell], tuple[Facts, Arrays]]

#: Seconds to wait for a killed process to end, and for its traceback before that.
GRACE, _LAST_WORDS = 5.0, 0.3

#: Seconds that a process may take to start on a busy machine, or to accept data.
BIRTH = 60.0

#: Seconds between checks whether a process has ended: a child that it left behind may hold its pipe open.
INTERVAL = 0.1

#: Maximum length of a traceback, in bytes.
_LONGEST_TRACE = 2**16

#: Signals that end a process through no fault of its own: sent by a user, or by the system when memory runs out.
BY_HAND = frozenset({signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT})

#: Exit codes, and minus the numbers of signals.
_CODES = range(-64, 256)

#: Key of the kind of a message in its facts.
KIND = "message"
BEGUN, PROGRESS, ANSWER, ERROR, RAISED, ENDED = "begun", "progress", "answer", "error", "raised", "ended"

#: Program of a new process.
_PROGRAM = (
    "import sys; sys.path[:] = sys.argv[4:]; from benchmark.execution.processes.child import run; run(*sys.argv[1:4])"
)

_numbers = itertools.count()


#: Mark of this process and file descriptor for its traceback, if it is a child; see :mod:`.child`.
own_mark, own_trace = "", -1

#: Child processes that have not been ended.
running: weakref.WeakSet[Process] = weakref.WeakSet()


class ForeignError(Exception):
    """Error in another process that is not one of :mod:`benchmark.errors`.

    Parameters
    ----------
    reason
        Class and message, on one line.
    trace
        Its traceback.
    """

    def __init__(self, reason: str, trace: str) -> None:
        super().__init__(reason)
        self.trace = trace


class ProcessEnded(Exception):
    """A process ended without answering; ``code`` is its exit code, or minus the number of a signal."""

    def __init__(self, code: int) -> None:
        super().__init__(ending(code))
        self.code = code


class Process:
    """A child process that answers one request at a time.

    Parameters
    ----------
    serve
        Module-level function, or a partial of one, that the process calls for each request.
    memory
        Memory limit in bytes; None for no limit.
    quiet
        Whether to discard what it prints.
    is_plugin
        Whether it runs a plugin: it then records the files that it reads, and does not get the path of the data sets.
    idle
        Seconds without a request after which it ends; None for no limit.

    Raises
    ------
    OSError
        If the system cannot start another process.
    """

    #: Whether the last request left threads or processes running.
    is_occupied = False
    #: Traceback of the crash or stop.
    trace = ""
    _has_begun = False

    def __init__(
        self,
        serve: Serve,
        *,
        memory: int | None = None,
        quiet: bool = False,
        is_plugin: bool = False,
        idle: float | None = None,
    ) -> None:
        #: Digests of the files that it read, by path.
        self.files: dict[str, str] = {}
        # The descendants of this process inherit its mark.
        self._mark = f"{own_mark or token() + '-'}{next(_numbers)}-"
        self._trace = tempfile.TemporaryFile() if own_trace < 0 else None  # noqa: SIM115
        ours, theirs = socket.socketpair()
        self._channel = Channel(ours, BIRTH)
        self.fileno = ours.fileno
        try:
            with theirs:
                trace = self._trace.fileno() if self._trace else own_trace
                self._process = _start(theirs.fileno(), trace, self._mark, quiet)
        except BaseException:  # an interrupt must not leave an untracked process
            self._channel.close()
            reaper.kill_marked(self._mark)
            raise
        running.add(self)
        # Pickles go from this process to the child, never back.
        function = np.frombuffer(pickle.dumps(serve), np.uint8)
        self.send({"memory": memory, "is_plugin": is_plugin, "idle": idle}, {"function": function})

    @property
    def exit_code(self) -> int | None:
        """Exit code, or minus the number of the signal; None while it runs."""
        return self._process.poll()

    def send(self, facts: Facts, arrays: Arrays | None = None) -> None:
        """Send a request; receive its answer before sending the next one."""
        try:
            self._channel.send(facts, arrays)
        except OSError:  # it has ended or accepts no data; `receive` raises ProcessEnded
            self.signal(signal.SIGKILL)

    def receive(self, limit: float | None = None, progress: Callable[[Any], object] | None = None) -> Message | None:
        """Return the facts and arrays of the answer; None on a timeout.

        Parameters
        ----------
        limit
            Timeout in seconds; None for no limit. A starting process gets another minute, unless the limit is zero.
        progress
            Called with each progress report, after which the time begins again.

        Raises
        ------
        BenchmarkError
            If the handler raised one; its class is preserved if it is one of :mod:`benchmark.errors`.
        MemoryError
            If the process ran out of memory.
        ForeignError
            If the handler raised anything else.
        ProcessEnded
            If the process, or one that it relied on, ended, or sent something that is not a message.
        """
        until = self._end_of(limit)
        while (message := self._next(until)) is not None:
            kind = message[0].get(KIND)
            if kind == PROGRESS and progress:
                progress(message[0].get(PROGRESS))
                until = self._end_of(limit)
            elif kind == BEGUN and not self._has_begun:
                self._has_begun = True
                until = self._end_of(limit)
            elif kind not in (PROGRESS, BEGUN):
                return self._answer(*message)
        return None

    def _end_of(self, limit: float | None) -> float:
        birth = BIRTH if limit and not self._has_begun else 0.0
        return float("inf") if limit is None else time.monotonic() + limit + birth

    def request(
        self,
        facts: Facts,
        arrays: Arrays | None = None,
        *,
        progress: Callable[[Any], object] | None = None,
        limit: float | None = None,
    ) -> Message:
        """Send a request and return the facts and arrays of its answer; see :meth:`receive`.

        Raises
        ------
        TimeoutError
            If the limit is exceeded.
        """
        self.send(facts, arrays)
        if (answer := self.receive(limit, progress)) is None:
            raise TimeoutError
        return answer

    def _next(self, until: float) -> Message | None:
        while True:
            is_over = self.exit_code is not None
            left = 0.0 if is_over else min(INTERVAL, max(0.0, until - time.monotonic()))
            try:
                message = self._channel.receive(left)
            except Exception as error:  # the pipe was closed, or carries something that is not a message
                raise self._ended() from error
            if message is None and is_over:
                raise self._ended()
            if message is not None or time.monotonic() >= until:
                return message

    def _answer(self, facts: dict[str, Any], arrays: dict[str, Any]) -> Message:
        """Return the facts and arrays of an answer, or raise the error that it reports."""
        try:
            self.is_occupied = bool(facts.pop("is_occupied", False))
            self.files = {str(path): str(digest) for path, digest in facts.pop("files", {}).items()}
            if (kind := facts.pop(KIND)) == ANSWER:
                return facts, arrays
            raised: Exception
            if kind == ERROR:
                raised = from_facts(facts)
            elif kind == ENDED:
                raised = ProcessEnded(_CODES[_CODES.index(facts["code"])])
            elif (reason := str(facts.get("reason"))).startswith("MemoryError"):
                raised = MemoryError()
            else:
                raised = ForeignError(reason, str(facts.get("trace")))
        except Exception as error:  # not an answer
            raise self._ended() from error
        raise raised

    def stop(self) -> None:
        """End the process after it has written its traceback."""
        self.signal(signal.SIGUSR1)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_LAST_WORDS)
        self.end()

    def signal(self, number: int) -> None:
        """Send a signal to the process if it still runs."""
        with suppress(OSError):
            self._process.send_signal(number)

    def end(self) -> None:
        """Kill the process, if it still runs, and its descendants."""
        if self not in running:
            return
        with suppress(OSError):
            os.killpg(self._process.pid, signal.SIGKILL)  # its session has its process identifier
        self.signal(signal.SIGKILL)
        reaper.kill_marked(self._mark)  # those that started their own sessions
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(GRACE)
        running.discard(self)
        self._channel.close()
        if self._trace is not None:
            with self._trace:
                self._trace.seek(0)
                self.trace = self._trace.read(_LONGEST_TRACE).decode("utf-8", "replace")

    def _ended(self) -> ProcessEnded:
        """End the process; the code is 1 if it still ran but sent something that is not a message."""
        try:
            code = self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            code = 1
        self.end()
        return ProcessEnded(code)


def ending(code: int) -> str:
    """Describe how a process ended: ``"SIGSEGV"``, ``"exit code 3"``."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"


def is_child() -> bool:
    """Return whether this process was started by :class:`Process`."""
    return bool(own_mark)


@contextmanager
def one_of_us() -> Iterator[None]:
    """End any fork of this process that leaves the ``with`` block; otherwise both copies would continue."""
    before = os.getpid()
    try:
        yield
    finally:
        if os.getpid() != before:
            os._exit(0)


def _start(pipe: int, trace: int, mark: str, quiet: bool) -> subprocess.Popen[bytes]:
    """Start a process with one end of a pipe, a file descriptor for its traceback, and a mark."""
    output = subprocess.DEVNULL if quiet else None
    words = [sys.executable, "-c", _PROGRAM, str(pipe), str(trace), str(os.getpid()), *sys.path]
    return subprocess.Popen(
        words, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=os.environ | {reaper.MARK: mark},
        pass_fds=(pipe, trace), start_new_session=True,
    )  # fmt: skip


@cache
def token() -> str:
    """Start the reaper once, and return the prefix of the marks of all child processes."""
    mark = secrets.token_hex(16)
    read, _write = os.pipe()  # open for the lifetime of this process
    watching = subprocess.Popen(
        [sys.executable, "-P", reaper.__file__, mark, str(os.getpid())],
        stdin=read,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={name: value for name, value in os.environ.items() if name != reaper.MARK},
        start_new_session=True,  # a signal to the program must not end the reaper
    )
    os.close(read)
    watching.returncode = 0  # avoids a ResourceWarning: the reaper outlives this process on purpose
    return mark


def adopt() -> None:
    """Mark this process, so that processes started here by foreign code end with it; children are already marked."""
    if not own_mark:
        os.environ[reaper.MARK] = f"{token()}-here-"
