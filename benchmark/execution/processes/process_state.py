"""Remains of foreign code in a process that others use after it: timers and handlers go, threads and children tell."""

from __future__ import annotations

import faulthandler
import os
import signal
import threading
from contextlib import suppress

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
