"""Main program of a :class:`~benchmark.execution.processes.process.Process`: answer requests."""

from __future__ import annotations

import ctypes
import faulthandler
import os
import pickle
import resource
import signal
import socket
import sys
import threading
import traceback
from contextlib import suppress
from functools import partial
from typing import Any

from benchmark.arrays import Arrays
from benchmark.errors import BenchmarkError, as_facts, one_line
from benchmark.execution.processes import process, reaper
from benchmark.execution.processes.channel import Channel, Facts
from benchmark.execution.processes.opened_files import opened_files, watch_opened_files
from benchmark.execution.processes.process import ANSWER, BEGUN, ENDED, ERROR, KIND, PROGRESS, RAISED, Serve, Tell
from benchmark.text import DATA_VARIABLE, say

#: ``PR_SET_PDEATHSIG`` of Linux.
_PARENT_DEATH_SIGNAL = 1

_TIMERS = (signal.ITIMER_REAL, signal.ITIMER_VIRTUAL, signal.ITIMER_PROF)


def run(pipe: str, trace: str, parent: str) -> None:
    """Answer requests until the pipe closes, then exit without waiting for threads or exit handlers."""
    process.own_mark, process.own_trace = os.environ[reaper.MARK], int(trace)
    for handle in (int(pipe), int(trace)):
        os.set_inheritable(handle, False)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # the main process handles Ctrl-C
    _die_with(int(parent))
    sys.argv[:] = [""]
    threading.excepthook = _report
    sys.unraisablehook = _report
    with suppress(OSError):
        signal.signal(signal.SIGUSR1, _pass_on)
        faulthandler.enable(int(trace), all_threads=False)
        faulthandler.register(signal.SIGUSR1, int(trace), all_threads=False, chain=True)
    code = 1
    try:
        _answer_all(Channel(socket.socket(fileno=int(pipe))))
        code = 0
        for output in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                output.flush()
    finally:  # foreign code may have broken anything here, printing included
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
        serve: Serve = pickle.loads(start[1]["function"].tobytes())  # noqa: S301  # sent by the parent
        channel.send({KIND: BEGUN})
        while (request := channel.receive(terms["idle"])) is not None:
            before = _State()
            facts, arrays = _answer(serve, *request, partial(_tell, channel))
            facts = {**facts, "is_occupied": before.restore(), "files": opened_files()}
            try:
                channel.send(facts, arrays)
            except (TypeError, ValueError) as error:
                channel.send({KIND: RAISED, "reason": one_line(error), "trace": ""})


def _tell(channel: Channel, progress: Any) -> None:
    channel.send({KIND: PROGRESS, PROGRESS: progress})


def _answer(serve: Serve, facts: Facts, arrays: Arrays, tell: Tell) -> tuple[Facts, Arrays]:
    """Return the facts and arrays of the answer, or of the error that was raised."""
    try:
        answer, results = serve(facts, arrays, tell)
        return {**answer, KIND: ANSWER}, results
    except BenchmarkError as error:
        return {**as_facts(error), KIND: ERROR}, {}
    except process.ProcessEnded as error:  # the parent must see the cause
        return {KIND: ENDED, "code": error.code}, {}
    except MemoryError:
        return {KIND: RAISED, "reason": "MemoryError: out of memory", "trace": ""}, {}
    except BaseException as error:  # SystemExit included
        return {KIND: RAISED, "reason": one_line(error), "trace": traceback.format_exc()}, {}


class _State:
    """Signal handlers, threads and children of this process before foreign code runs in it."""

    def __init__(self) -> None:
        self._handlers = {number: signal.getsignal(number) for number in signal.valid_signals()}
        self._mask = signal.pthread_sigmask(signal.SIG_BLOCK, ())
        self._others = _others()

    def restore(self) -> bool:
        """Stop all timers and restore the signal handlers; return whether threads or children were left behind."""
        for timer in _TIMERS:
            signal.setitimer(timer, 0)
        faulthandler.cancel_dump_traceback_later()
        for number, handler in self._handlers.items():
            if signal.getsignal(number) != handler:
                signal.signal(number, handler or signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, self._mask)
        return not _others() <= self._others


def _others() -> set[object]:
    """Return the threads of this process, and ``"children"`` if it has any."""
    others: set[object] = set(threading.enumerate())
    with suppress(ChildProcessError, AttributeError):  # no children, or not supported by the system
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        others.add("children")
    return others


def _pass_on(number: int, frame: object) -> None:
    """Forward a signal to the children of this process."""
    for other in list(process.running):
        other.signal(number)


def _report(raised: Any) -> None:
    """Print an error raised in a thread or a destructor on one line."""
    if raised.exc_value is not None and raised.exc_type is not SystemExit:
        where = getattr(raised, "err_msg", "a thread") or "an object that goes"
        with suppress(OSError, ValueError, AttributeError):  # foreign code may have closed the output
            say(f"{where} raises {one_line(raised.exc_value)}", err=True)


def _die_with(parent: int) -> None:
    """Ask the system to kill this process when its parent ends."""
    with suppress(OSError, AttributeError):  # Linux alone can do so
        ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)  # the parent ended before the call


def _limit_memory(limit: int) -> None:
    """Limit the memory of this process, so that a job fails with ``MemoryError`` before the machine does."""
    with suppress(ValueError, OSError):  # not supported by every system
        resource.setrlimit(resource.RLIMIT_DATA, (limit, resource.getrlimit(resource.RLIMIT_DATA)[1]))
