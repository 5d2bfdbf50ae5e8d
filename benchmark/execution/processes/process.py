"""A process beside this one that answers requests over a private pipe: it may crash, hang or run out of memory alone.

It runs in a session of its own, dies with this process, and takes along what it has started. No process serves two
lanes: one runs the suite alone, or the code of one plugin file. This is the only module that starts processes;
:mod:`benchmark.execution.processes.child` is what runs in them.
"""

from __future__ import annotations

import faulthandler
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
from typing import Any, NoReturn

import numpy as np

from benchmark.arrays import Arrays
from benchmark.errors import BenchmarkError, from_facts
from benchmark.execution.processes import reaper
from benchmark.execution.processes.channel import Channel, Facts, Message


class Requester:
    """Whoever sent the request that a process is at."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel

    def tell(self, progress: Any) -> None:
        """Say how far the work is, as JSON."""
        self._channel.send({KIND: PROGRESS, PROGRESS: progress})


#: Answers a request, facts and arrays; the last argument is whoever sent it.
Serve = Callable[[Mapping[str, Any], Arrays, Requester], tuple[Facts, Arrays]]

#: Seconds that a process has to end once it was killed, and to say where it is before that.
GRACE, _LAST_WORDS = 5.0, 0.3

#: Seconds that a process may take to begin on a machine that is busy with other work, or to take what is sent to it.
BIRTH = 60.0

#: Seconds between two looks whether a process has ended: a child that it left may hold its pipe open.
INTERVAL = 0.1

#: Bytes of a traceback that are read.
_LONGEST_TRACE = 2**16

#: Signals by which somebody, or the system for want of memory, ends a process that has done nothing wrong.
BY_HAND = frozenset({signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT})

#: Entry of the facts of each message of a process that says what it is.
KIND = "message"
BEGUN, PROGRESS, ANSWER, ERROR, RAISED = "begun", "progress", "answer", "error", "raised"

#: What a new process runs.
_PROGRAM = (
    "import sys; sys.path[:] = sys.argv[4:]; from benchmark.execution.processes.child import run; run(*sys.argv[1:4])"
)

_numbers = itertools.count()


#: Mark of this process, and the file for its traceback, where it was started by another one; see :mod:`.child`.
own_mark, own_trace = "", -1

#: Processes that this one has started and not ended.
running: weakref.WeakSet[Process] = weakref.WeakSet()


class ForeignError(Exception):
    """Code in another process raised what is none of our errors.

    Parameters
    ----------
    reason
        Class and message, on one line.
    trace
        Where it was raised, as a traceback.
    """

    def __init__(self, reason: str, trace: str) -> None:
        super().__init__(reason)
        self.trace = trace


class ProcessEnded(Exception):
    """A process ended instead of answering: its exit code, or minus the number of the signal."""

    def __init__(self, code: int) -> None:
        super().__init__(ending(code))
        self.code = code


class Process:
    """A running process that answers requests, one after the other.

    Parameters
    ----------
    serve
        A function of a module, or a partial of one, called in the process for each request.
    memory
        Bytes that it may take; None for no limit of its own.
    quiet
        Whether nothing that it prints is seen.
    is_plugin
        Whether it runs a plugin: the files that it reads are noted, and where the data lies is none of its business.
    idle
        Seconds without a request after which it leaves; None for no limit.

    Raises
    ------
    OSError
        If the system starts no further process.
    """

    #: Whether the latest work has left threads or processes that are still there.
    is_occupied = False
    #: Where it was when it crashed or was stopped, as a traceback.
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
        #: Digests of the files that it has read, by path.
        self.files: dict[str, str] = {}
        # All that this process starts bears its mark, too.
        self._mark = f"{own_mark or token() + '-'}{next(_numbers)}-"
        self._trace = tempfile.TemporaryFile() if own_trace < 0 else None  # noqa: SIM115
        ours, theirs = socket.socketpair()
        self._channel = Channel(ours, BIRTH)
        self.fileno = ours.fileno
        try:
            with theirs:
                trace = self._trace.fileno() if self._trace else own_trace
                self._process = _start(theirs.fileno(), trace, self._mark, quiet)
        except BaseException:  # an interrupt, of one that nobody would know of
            self._channel.close()
            reaper.kill_marked(self._mark)
            raise
        running.add(self)
        # Only what this process says is pickled, never what it is told.
        function = np.frombuffer(pickle.dumps(serve), np.uint8)
        self.send({"memory": memory, "is_plugin": is_plugin, "idle": idle}, {"function": function})

    @property
    def exit_code(self) -> int | None:
        """Exit code, or minus the number of the signal; None while it runs."""
        return self._process.poll()

    def send(self, facts: Facts, arrays: Arrays | None = None) -> None:
        """Send a request; its answer is to be received before the next one."""
        try:
            self._channel.send(facts, arrays)
        except OSError:  # it has ended, or takes nothing: whoever waits for the answer hears of its end
            self.signal(signal.SIGKILL)

    def receive(
        self, limit: float | None = None, progress: Callable[[Any], object] = lambda progress: None
    ) -> Message | None:
        """Return facts and arrays of the answer; None if it says nothing for too long.

        Parameters
        ----------
        limit
            Seconds from one thing that it says to the next; None for no limit. To begin, it has a minute more, unless
            the limit is zero.
        progress
            Told what it says meanwhile.

        Raises
        ------
        BenchmarkError
            What the function raised of this kind, with its own class where that is one of :mod:`benchmark.errors`.
        MemoryError
            If the process has no more memory.
        ForeignError
            If the function raised anything else.
        ProcessEnded
            If it ended instead, or sends what is no message.
        """
        while (message := self._next(limit)) is not None:
            kind = message[0].get(KIND)
            if kind == PROGRESS:
                progress(message[0].get(PROGRESS))
            elif kind == BEGUN:
                self._has_begun = True
            else:
                return self._answer(*message)
        return None

    def request(
        self,
        facts: Facts,
        arrays: Arrays | None = None,
        *,
        progress: Callable[[Any], object] = lambda progress: None,
        limit: float | None = None,
    ) -> Message:
        """Send a request and return facts and arrays of its answer; see :meth:`receive`.

        Raises
        ------
        TimeoutError
            If it says nothing for too long.
        """
        self.send(facts, arrays)
        if (answer := self.receive(limit, progress)) is None:
            raise TimeoutError
        return answer

    def request_or_end_alike(self, facts: Facts, arrays: Arrays | None = None) -> Message:
        """Send a request; if the process ends, this one ends alike, so that whoever watches over it finds the fault.

        Raises
        ------
        BenchmarkError
            Where nobody watches over this process: also if it ends, or raises what is none of our errors.
        """
        try:
            return self.request(facts, arrays)
        except (ProcessEnded, ForeignError) as error:
            if not is_child():
                verb = "ended its process:" if isinstance(error, ProcessEnded) else "raises"
                raise BenchmarkError(f"a plugin {verb} {error}", "correct it; 'check' shows more") from error
            if isinstance(error, ForeignError):
                raise
            end_like(error.code)

    def _next(self, limit: float | None) -> Message | None:
        birth = BIRTH if limit and not self._has_begun else 0.0
        until = float("inf") if limit is None else time.monotonic() + limit + birth
        while True:
            is_over = self.exit_code is not None
            left = 0.0 if is_over else min(INTERVAL, max(0.0, until - time.monotonic()))
            try:
                message = self._channel.receive(left)
            except Exception as error:  # the pipe has ended, or whatever is at the other end
                raise self._ended() from error
            if message is None and is_over:
                raise self._ended()
            if message is not None or time.monotonic() >= until:
                return message

    def _answer(self, facts: dict[str, Any], arrays: dict[str, Any]) -> Message:
        """Return facts and arrays of an answer, or raise what it tells."""
        try:
            self.is_occupied = bool(facts.pop("is_occupied", False))
            self.files = {str(path): str(digest) for path, digest in facts.pop("files", {}).items()}
            if (kind := facts.pop(KIND)) == ANSWER:
                return facts, arrays
            reason, trace = str(facts.get("reason")), str(facts.get("trace"))
            is_memory = reason.startswith("MemoryError")
            raised = from_facts(facts) if kind == ERROR else MemoryError() if is_memory else ForeignError(reason, trace)
        except Exception as error:  # it is no answer at all
            raise self._ended() from error
        raise raised

    def stop(self) -> None:
        """End it, after it has written down where it is."""
        self.signal(signal.SIGUSR1)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_LAST_WORDS)
        self.end()

    def signal(self, number: int) -> None:
        """Send it a signal, if it still runs."""
        with suppress(OSError):
            self._process.send_signal(number)

    def end(self) -> None:
        """Kill it, if it still runs, and everything that it started."""
        if self not in running:
            return
        with suppress(OSError):
            os.killpg(self._process.pid, signal.SIGKILL)  # the session of the process bears its number
        self.signal(signal.SIGKILL)
        reaper.kill_marked(self._mark)  # those that began sessions of their own
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(GRACE)
        running.discard(self)
        self._channel.close()
        if self._trace is not None:
            with self._trace:
                self._trace.seek(0)
                self.trace = self._trace.read(_LONGEST_TRACE).decode("utf-8", "replace")

    def _ended(self) -> ProcessEnded:
        """End it; its exit code is 1 where it still runs, but sends what is no message."""
        try:
            code = self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            code = 1
        self.end()
        return ProcessEnded(code)


def ending(code: int) -> str:
    """Say how a process ended: ``"SIGSEGV"``, ``"exit code 3"``."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"


def end_like(code: int) -> NoReturn:
    """End this process as another one ended, with its exit code or by minus the number of its signal."""
    faulthandler.disable()  # the other one has told where it was
    if code < 0:
        with suppress(OSError):  # there is no handler for some signals
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    os._exit(abs(code))


def is_child() -> bool:
    """Return whether this process was started by :class:`Process`."""
    return bool(own_mark)


@contextmanager
def one_of_us() -> Iterator[None]:
    """End a copy of this process that comes out of the body: both would go on, and copy again."""
    before = os.getpid()
    try:
        yield
    finally:
        if os.getpid() != before:
            os._exit(0)


def _start(pipe: int, trace: int, mark: str, quiet: bool) -> subprocess.Popen[bytes]:
    """Start a process with one end of a pipe, a file for its traceback, and a mark."""
    output = subprocess.DEVNULL if quiet else None
    words = [sys.executable, "-c", _PROGRAM, str(pipe), str(trace), str(os.getpid()), *sys.path]
    return subprocess.Popen(
        words, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=os.environ | {reaper.MARK: mark},
        pass_fds=(pipe, trace), start_new_session=True,
    )  # fmt: skip


@cache
def token() -> str:
    """First part of the marks of all processes of this program, for which a reaper is watching from now on."""
    mark = secrets.token_hex(16)
    read, _write = os.pipe()  # which stays open for as long as this process lives
    watching = subprocess.Popen(
        [sys.executable, "-P", reaper.__file__, mark, str(os.getpid())],
        stdin=read,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={name: value for name, value in os.environ.items() if name != reaper.MARK},
        start_new_session=True,  # what ends the program must not end its reaper
    )
    os.close(read)
    watching.returncode = 0  # it outlives this process, which is no oversight to be warned of
    return mark


def adopt() -> None:
    """Mark this process, so that whatever foreign code starts here ends with it; a child bears a mark already."""
    if not own_mark:
        os.environ[reaper.MARK] = f"{token()}-here-"
