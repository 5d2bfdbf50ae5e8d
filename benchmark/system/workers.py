"""A process for one task, in a session of its own, that dies with this one and takes along what it has started."""

from __future__ import annotations

import ctypes
import faulthandler
import itertools
import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from types import ModuleType
from typing import Any, NoReturn

from benchmark.errors import one_line
from benchmark.system import process_reaper
from benchmark.system.text import say

#: ``PR_SET_PDEATHSIG`` of Linux.
_PARENT_DEATH_SIGNAL = 1

#: Seconds that a process has to end once it was killed.
GRACE = 5.0

#: Share of the machine's memory that all workers together may take.
MEMORY_SHARE = 0.85

#: Exit code of a process that could not write what it had to: by custom, an error of input or output.
UNWRITTEN = 74

#: Signals by which somebody, or the system for want of memory, ends a process that has done nothing wrong.
BY_HAND = frozenset({signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT})

_numbers = itertools.count()


class Worker:
    """A running process.

    What it brings about is on the disk. Nothing is trusted to a pipe, which a process that is killed may hold locked or
    leave half written.

    Parameters
    ----------
    task
        A function of a module, called in the process; the process ends with it, whatever threads and exit handlers it
        leaves.
    *arguments
        What it is called with.
    memory
        Bytes that it may take; None for no limit.
    quiet
        Whether nothing that it prints is seen.

    Raises
    ------
    OSError
        If the system starts no further process.
    """

    def __init__(
        self, task: Callable[..., object], *arguments: Any, memory: int | None = None, quiet: bool = False
    ) -> None:
        self._mark = f"{process_reaper.mark_of_this()}{next(_numbers)}-"
        resource_tracker.ensure_running()  # it serves all workers, and must not bear the mark of the first
        context = multiprocessing.get_context("spawn")
        self._process = context.Process(target=_main, args=(task, arguments, memory, quiet, os.getpid()))
        before = os.environ.get(process_reaper.MARK)
        try:
            with _without_interrupts(), _without_main():
                os.environ[process_reaper.MARK] = self._mark
                try:
                    self._process.start()
                finally:
                    del os.environ[process_reaper.MARK]
                    if before is not None:
                        os.environ[process_reaper.MARK] = before
        except KeyboardInterrupt:  # heard once the process has started, which nobody would know of
            self.end()
            raise

    @property
    def sentinel(self) -> int:
        """Handle that becomes ready when the process ends."""
        return self._process.sentinel

    @property
    def exit_code(self) -> int | None:
        """Exit code, or minus the number of the signal; None while it runs."""
        return self._process.exitcode

    def send(self, number: int) -> None:
        """Send it a signal, if it still runs."""
        if self._process.pid is not None and self.exit_code is None:
            with suppress(OSError):
                os.kill(self._process.pid, number)

    def end(self) -> None:
        """Kill the process, if it still runs, and everything that it started."""
        identifier = self._process.pid
        if identifier is not None:
            with suppress(OSError):
                os.killpg(identifier, signal.SIGKILL)  # the session of the worker bears its number
            self.send(signal.SIGKILL)  # where it has not yet begun one
        process_reaper.kill_marked(self._mark)  # those that began sessions of their own
        if identifier is not None:
            self._process.join(GRACE)


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


def memory_per_worker(workers: int = 1) -> int:
    """Bytes that one of several workers may take: together, most of the machine's memory."""
    import psutil

    return int(psutil.virtual_memory().total * MEMORY_SHARE / workers)


def _main(
    task: Callable[..., object], arguments: tuple[Any, ...], memory: int | None, quiet: bool, parent: int
) -> None:
    """Entry point of the process."""
    with suppress(OSError):
        os.setsid()
    _die_with(parent)
    if memory is not None:
        _limit_memory(memory)
    if quiet:
        nothing = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):
            os.dup2(nothing, stream)
    threading.excepthook = _say_what_a_thread_raises
    sys.unraisablehook = _say_what_nobody_hears
    try:
        task(*arguments)
    except BaseException as error:
        try:
            place = traceback.extract_tb(error.__traceback__)[-1]
            _complain(f"a process ends: {one_line(error)} (at {place.filename}, line {place.lineno})")
        finally:  # what a method has done to this process may break anything, words first
            os._exit(1)
    for written in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            written.flush()
    # All that counts is on the disk. Exit handlers and threads of a method could only hang or complain.
    os._exit(0)


def _say_what_a_thread_raises(found: threading.ExceptHookArgs) -> None:
    if found.exc_value is not None and found.exc_type is not SystemExit:
        _complain(f"a thread raises {one_line(found.exc_value)}")


def _say_what_nobody_hears(found: Any) -> None:
    if found.exc_value is not None:
        _complain(f"{found.err_msg or 'an object that goes'} raises {one_line(found.exc_value)}")


def _complain(said: str) -> None:
    with suppress(OSError, ValueError, AttributeError):  # a method may have closed what it would be said to
        say(said, err=True)


def _die_with(parent: int) -> None:
    """Ask the system to kill this process when its parent ends, however it ends."""
    if sys.platform != "linux":
        return
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)  # it ended before the system was asked


def _limit_memory(limit: int) -> None:
    """Let a job that eats memory fail alone with a ``MemoryError`` rather than take the machine down."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (limit, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    except (ImportError, ValueError, OSError):
        return  # not every system has this limit; the job then runs without one


@contextmanager
def _without_main() -> Iterator[None]:
    """Let what is started in the body not run the main module again: a script needs no guard against that."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Let what is started in the body not hear of Ctrl-C, which is for this process; it hears of it afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
