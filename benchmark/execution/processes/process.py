"""A process beside this one that answers requests over a private pipe: it may crash, hang or run out of memory alone.

It runs in a session of its own, dies with this process, and takes along what it has started. No process serves two
lanes: one runs the suite alone, or the code of one plugin file. This is the only module that starts processes.
"""

from __future__ import annotations

import atexit
import ctypes
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
import threading
import time
import traceback
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any, NoReturn

import numpy as np

from benchmark.arrays import Arrays
from benchmark.cgroup import memory_limit
from benchmark.errors import BenchmarkError, as_facts, from_facts, one_line
from benchmark.execution.processes import reaper
from benchmark.execution.processes.channel import Channel, Facts, Message
from benchmark.execution.processes.opened_files import opened_files, watch_opened_files
from benchmark.text import DATA_VARIABLE, say

#: Answers a request, facts and arrays; the last argument is whoever sent it.
Serve = Callable[[Mapping[str, Any], Arrays, "Requester"], tuple[Facts, Arrays]]

#: ``PR_SET_PDEATHSIG`` of Linux.
_PARENT_DEATH_SIGNAL = 1

#: Seconds that a process has to end once it was killed, and to say where it is before that.
GRACE, _LAST_WORDS = 5.0, 0.3

#: Seconds that a process may take to begin on a machine that is busy with other work, or to take what is sent to it.
BIRTH = 60.0

#: Seconds between two looks whether a process has ended: a child that it left may hold its pipe open.
INTERVAL = 0.1

#: Share of the memory of the machine, or of the cgroup, that all processes together may take.
MEMORY_SHARE = 0.85

#: Bytes of a traceback that are read.
_LONGEST_TRACE = 2**16

#: Signals by which somebody, or the system for want of memory, ends a process that has done nothing wrong.
BY_HAND = frozenset({signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT})

#: Entry of the facts of each message that says what it is.
_KIND = "message"
_BEGUN, _PROGRESS, _ANSWER, _ERROR, _RAISED = "begun", "progress", "answer", "error", "raised"

#: What a new process runs.
_PROGRAM = (
    "import sys; sys.path[:] = sys.argv[4:]; from benchmark.execution.processes.process import run; run(*sys.argv[1:4])"
)

_numbers = itertools.count()
_running: weakref.WeakSet[Process] = weakref.WeakSet()
_own_mark = ""
_trace = -1


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
    """A process ended instead of answering.

    Parameters
    ----------
    code
        Its exit code, or minus the number of the signal.
    """

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
        #: Where it was when it crashed or was stopped, as a traceback.
        self.trace = ""
        self.has_begun = False
        self.parent = os.getpid()
        # All that this process starts bears its mark, too.
        self._mark = f"{_own_mark or token() + '-'}{next(_numbers)}-"
        self._trace = tempfile.TemporaryFile() if _trace < 0 else None  # noqa: SIM115
        trace = self._trace.fileno() if self._trace else _trace
        ours, theirs = socket.socketpair()
        self._channel = Channel(ours, BIRTH)
        try:
            with theirs, _without_interrupts():
                self._process = _start(theirs.fileno(), trace, self._mark, quiet)
        except BaseException:
            if hasattr(self, "_process"):  # an interrupt, of one that nobody would know of
                _running.add(self)
            self.end()
            raise
        _running.add(self)
        # Only what this process says is pickled, never what it is told.
        function = np.frombuffer(pickle.dumps(serve), np.uint8)
        self.send({"memory": memory, "is_plugin": is_plugin, "idle": idle}, {"function": function})

    @property
    def exit_code(self) -> int | None:
        """Exit code, or minus the number of the signal; None while it runs."""
        return self._process.poll()

    def fileno(self) -> int:
        """Handle that becomes ready when it says something or ends."""
        return self._channel.fileno()

    def send(self, facts: Facts, arrays: Arrays | None = None) -> None:
        """Send a request; its answer is to be received before the next one."""
        try:
            self._channel.send(facts, arrays)
        except OSError:  # it has ended, or takes nothing: whoever waits for the answer hears of its end
            self.signal(signal.SIGKILL)

    def receive(self, timeout: float | None = None) -> Message | None:
        """Return the next message, progress or an answer; None if none has come in time.

        Raises
        ------
        ProcessEnded
            If there is none to come: the process has ended, or sends what is no message.
        """
        until = None if timeout is None else time.monotonic() + timeout
        while True:
            is_over = self.exit_code is not None
            left = INTERVAL if until is None else min(INTERVAL, max(0.0, until - time.monotonic()))
            try:
                message = self._channel.receive(0.0 if is_over else left)
            except Exception as error:  # the pipe has ended, or whatever is at the other end
                raise self._ended() from error
            if message is not None:
                if message[0].get(_KIND) != _BEGUN:
                    return message
                self.has_begun = True
            elif is_over:
                raise self._ended()
            elif until is not None and time.monotonic() >= until:
                return None

    def request(
        self,
        facts: Facts,
        arrays: Arrays | None = None,
        *,
        progress: Callable[[Any], object] = lambda told: None,
        limit: float | None = None,
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Send a request and return facts and arrays of its answer.

        Parameters
        ----------
        facts, arrays
            The request.
        progress
            Told what it says meanwhile.
        limit
            Seconds from one thing that it says to the next; None for no limit. To begin, it has a minute more.

        Raises
        ------
        BenchmarkError
            What the function raised of this kind, with its own class where that is one of :mod:`benchmark.errors`.
        MemoryError
            If the process has no more memory.
        ForeignError
            If the function raised anything else.
        ProcessEnded
            If it ended instead.
        TimeoutError
            If it said nothing for too long.
        """
        self.send(facts, arrays)
        while True:
            if (message := self._within(limit)) is None:
                raise TimeoutError
            kind = message[0].get(_KIND)
            if kind == _PROGRESS:
                progress(message[0].get(_PROGRESS))
            else:
                return self.result(message)

    def request_or_end_alike(self, facts: Facts, arrays: Arrays | None = None) -> tuple[dict[str, Any], dict[str, Any]]:
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

    def _within(self, limit: float | None) -> Message | None:
        """Return the next message, if it comes in time: starting a process is no fault of the function."""
        if limit is None or self.has_begun:
            return self.receive(limit)
        until = time.monotonic() + BIRTH
        while not self.has_begun and time.monotonic() < until:
            if (message := self.receive(INTERVAL)) is not None:
                return message
        return self.receive(limit)

    def result(self, message: Message) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return facts and arrays of an answer, or raise what it tells; see :meth:`request`."""
        facts, arrays = message
        try:
            self.is_occupied = bool(facts.pop("is_occupied", False))
            self.files = {str(path): str(digest) for path, digest in facts.pop("files", {}).items()}
            if (kind := facts.pop(_KIND)) == _ANSWER:
                return facts, arrays
            found = from_facts(facts) if kind == _ERROR else None
            reason, trace = str(facts.get("reason")), str(facts.get("trace"))
        except Exception as error:  # it is no answer at all
            raise self._ended() from error
        if found is not None:
            raise found
        raise MemoryError if reason.startswith("MemoryError") else ForeignError(reason, trace)

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
        if self in _running:
            with suppress(OSError):
                os.killpg(self._process.pid, signal.SIGKILL)  # the session of the process bears its number
            self.signal(signal.SIGKILL)
            reaper.kill_marked(self._mark)  # those that began sessions of their own
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(GRACE)
            _running.discard(self)
        self._channel.close()
        if self._trace is not None and not self._trace.closed:
            self._trace.seek(0)
            self.trace = self._trace.read(_LONGEST_TRACE).decode("utf-8", "replace")
            self._trace.close()

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
    """End this process as another one ended.

    Parameters
    ----------
    code
        Exit code of the other, or minus the number of the signal.
    """
    faulthandler.disable()  # the other one has told where it was
    if code < 0:
        with suppress(OSError):  # there is no handler for some signals
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    os._exit(abs(code))


def is_child() -> bool:
    """Return whether this process was started by :class:`Process`."""
    return bool(_own_mark)


_TIMERS = (signal.ITIMER_REAL, signal.ITIMER_VIRTUAL, signal.ITIMER_PROF)


class ProcessState:
    """Signals, timers, threads and children of this process before foreign code is at work in it."""

    def __init__(self) -> None:
        self._handlers = {number: signal.getsignal(number) for number in signal.valid_signals()}
        self._mask = signal.pthread_sigmask(signal.SIG_BLOCK, ())
        self._others = _others()

    def restore(self) -> bool:
        """Stop all timers and bring back the handlers of signals; returns whether threads or children have come."""
        for timer in _TIMERS:
            signal.setitimer(timer, 0)
        faulthandler.cancel_dump_traceback_later()
        for number, handler in self._handlers.items():
            if signal.getsignal(number) != handler:
                signal.signal(number, handler or signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, self._mask)
        return not _others() <= self._others


def _others() -> set[object]:
    """Return the threads of this process, and a word for its children."""
    found: set[object] = set(threading.enumerate())
    with suppress(ChildProcessError, AttributeError):  # there is none, or the system cannot be asked
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        found.add("children")
    return found


@contextmanager
def one_of_us() -> Iterator[None]:
    """End a copy of this process that comes out of the body: both would go on, and copy again."""
    before = os.getpid()
    try:
        yield
    finally:
        if os.getpid() != before:
            os._exit(0)


# Starting a process --------------------------------------------------------------------------------------------------


def _start(pipe: int, trace: int, mark: str, quiet: bool) -> subprocess.Popen[bytes]:
    """Start a process with one end of a pipe, a file for its traceback, and a mark."""
    output = subprocess.DEVNULL if quiet else None
    words = [sys.executable, "-c", _PROGRAM, str(pipe), str(trace), str(os.getpid()), *sys.path]
    return subprocess.Popen(
        words, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=os.environ | {reaper.MARK: mark},
        pass_fds=(pipe, trace), start_new_session=True,
    )  # fmt: skip


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Let what is started in the body not hear of Ctrl-C, which is for this process; it hears of it afterwards."""
    mask, heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}), list[int]()
    is_main = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, lambda number, _: heard.append(number)) if is_main else None
    try:
        yield
    finally:
        if is_main:
            signal.signal(signal.SIGINT, handler or signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if heard:  # by another thread
            signal.raise_signal(signal.SIGINT)


@cache
def token() -> str:
    """First part of the marks of all processes of this program, for which a reaper is watching from now on."""
    made = secrets.token_hex(16)
    read, _write = os.pipe()  # which stays open for as long as this process lives
    watching = subprocess.Popen(
        [sys.executable, "-P", reaper.__file__, made, str(os.getpid())],
        stdin=read,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={name: value for name, value in os.environ.items() if name != reaper.MARK},
        start_new_session=True,  # what ends the program must not end its reaper
    )
    os.close(read)
    watching.returncode = 0  # it outlives this process, which is no oversight to be warned of
    return made


def adopt() -> None:
    """Mark this process, so that whatever foreign code starts here ends with it; a child bears a mark already."""
    if not _own_mark:
        os.environ[reaper.MARK] = f"{token()}-here-"


@atexit.register
def _end_all() -> None:
    """End the processes of one that ends."""
    for process in list(_running):
        if process.parent == os.getpid():  # not in a copy of the process that started it
            process.end()


# Inside a process ----------------------------------------------------------------------------------------------------


class Requester:
    """Whoever sent the request that this process is at."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel

    def tell(self, progress: Any) -> None:
        """Say how far the work is, as JSON."""
        self._channel.send({_KIND: _PROGRESS, _PROGRESS: progress})


def run(pipe: str, trace: str, parent: str) -> None:
    """Answer requests until there are no more; whatever threads and exit handlers they leave, this process ends."""
    global _own_mark, _trace
    _own_mark, _trace = os.environ[reaper.MARK], int(trace)
    for handle in (int(pipe), int(trace)):
        os.set_inheritable(handle, False)
    _die_with(int(parent))
    sys.argv[:] = [""]
    threading.excepthook = _say_what_a_thread_raises
    sys.unraisablehook = _say_what_nobody_hears
    with suppress(OSError):
        signal.signal(signal.SIGUSR1, _pass_on)
        faulthandler.enable(_trace, all_threads=False)
        faulthandler.register(signal.SIGUSR1, _trace, all_threads=False, chain=True)
    code = 1
    try:
        _answer_all(Channel(socket.socket(fileno=int(pipe))))
        code = 0
        for written in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                written.flush()
    finally:  # what foreign code has done to this process may break anything, words first
        os._exit(code)


def _answer_all(channel: Channel) -> None:
    with suppress(EOFError):
        start = channel.receive()
        assert start is not None  # noqa: S101
        terms = start[0]
        if terms["memory"] is not None:
            _limit_memory(terms["memory"])
        if terms["is_plugin"]:
            os.environ.pop(DATA_VARIABLE, None)
            watch_opened_files()
        serve: Serve = pickle.loads(start[1]["function"].tobytes())  # noqa: S301  # of whoever started this process
        channel.send({_KIND: _BEGUN})
        while (request := channel.receive(terms["idle"])) is not None:
            before = ProcessState()
            facts, arrays = _answer(serve, *request, Requester(channel))
            facts = {**facts, "is_occupied": before.restore(), "files": opened_files()}
            try:
                channel.send(facts, arrays)
            except (TypeError, ValueError) as error:
                channel.send({_KIND: _RAISED, "reason": one_line(error), "trace": ""})


def _answer(serve: Serve, facts: Facts, arrays: Arrays, requester: Requester) -> tuple[Facts, Arrays]:
    """Facts and arrays of the answer, or what was raised."""
    try:
        told, found = serve(facts, arrays, requester)
        return {**told, _KIND: _ANSWER}, found
    except BenchmarkError as error:
        return {**as_facts(error), _KIND: _ERROR}, {}
    except MemoryError:
        return {_KIND: _RAISED, "reason": "MemoryError: out of memory", "trace": ""}, {}
    except BaseException as error:  # also what ends a program
        return {_KIND: _RAISED, "reason": one_line(error), "trace": traceback.format_exc()}, {}


def _pass_on(number: int, frame: object) -> None:
    """Let the processes that this one has started hear of a signal, too."""
    for process in list(_running):
        process.signal(number)


def _say_what_a_thread_raises(found: threading.ExceptHookArgs) -> None:
    if found.exc_value is not None and found.exc_type is not SystemExit:
        complain(f"a thread raises {one_line(found.exc_value)}")


def _say_what_nobody_hears(found: Any) -> None:
    if found.exc_value is not None:
        complain(f"{found.err_msg or 'an object that goes'} raises {one_line(found.exc_value)}")


def complain(problem: str) -> None:
    """Print one line to stderr, if it is there."""
    with suppress(OSError, ValueError, AttributeError):  # a method may have closed what it would be said to
        say(problem, err=True)


def _die_with(parent: int) -> None:
    """Ask the system to kill this process when its parent ends, however it ends."""
    if sys.platform != "linux":
        return
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)  # it ended before the system was asked


def memory_per_process(processes: int = 1) -> int:
    """Bytes that one of several processes may take: together, most of the memory of the machine or the container."""
    import psutil

    return int(min(psutil.virtual_memory().total, memory_limit()) * MEMORY_SHARE / processes)


def _limit_memory(limit: int) -> None:
    """Let a job that eats memory fail alone with a ``MemoryError`` rather than take the machine down."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (limit, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    except (ImportError, ValueError, OSError):
        return  # not every system has this limit; the job then runs without one
