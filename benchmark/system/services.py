"""A process that answers requests for as long as this one asks: a home for foreign code that is called often."""

from __future__ import annotations

import atexit
import faulthandler
import os
import signal
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from benchmark.errors import BenchmarkError, as_facts, from_facts, one_line
from benchmark.system.arrays import Arrays, packed, unpacked
from benchmark.system.opened_files import opened_files, watch_opened_files
from benchmark.system.process_state import ProcessState
from benchmark.system.text import DATA_VARIABLE
from benchmark.system.workers import GRACE, Worker, end_like

#: Answers one request, facts and arrays.
Serve = Callable[[Mapping[str, Any], Arrays], tuple[Mapping[str, Any], Arrays]]

#: Entries that stand in place of an answer: an error of ours, or line and traceback of any other.
_ERROR, _RAISED = "error", "raised"

#: Entry of an answer: whether its work has left threads or processes that are still there.
_LEFT = "left"

#: Entry of an answer: digests of the files that its process has read, by path.
_FILES = "files"

_running: list[Service] = []
_trace_file: Path | None = None


class ForeignError(Exception):
    """Foreign code raised what is none of our errors.

    Parameters
    ----------
    said
        Class and message, on one line.
    trace
        Where it was raised, as a traceback.
    """

    def __init__(self, said: str, trace: str) -> None:
        super().__init__(said)
        self.trace = trace


class Service:
    """A running process that answers requests, one after the other.

    A process that ends instead takes this one along: whoever watches over it finds the fault where it looks for it.

    Parameters
    ----------
    serve
        A function of a module, called in the process for each request.

    Raises
    ------
    OSError
        If the system starts no further process.
    """

    #: Whether the latest work has left threads or processes that are still there.
    is_occupied = False

    def __init__(self, serve: Serve) -> None:
        self._ours, theirs = Pipe()
        #: Digests of the files that its process has read, by path.
        self.files: dict[str, str] = {}
        with theirs:
            self._worker = Worker(_answer_all, serve, theirs, _trace_file)
        _running.append(self)

    def request(self, facts: Mapping[str, Any], arrays: Arrays) -> tuple[dict[str, Any], dict[str, Any]]:
        """Send a request and return facts and arrays of the answer.

        Parameters
        ----------
        facts, arrays
            The request.

        Raises
        ------
        BenchmarkError
            What the function raised of this kind, with its own class where that is one of :mod:`benchmark.errors`.
        MemoryError
            If the process has no more memory.
        ForeignError
            If the function raised anything else.
        """
        try:
            self._ours.send_bytes(packed(facts, arrays))
            told, found = unpacked(self._received())
        except Exception:  # whatever is at the other end
            end_like(self._ended())
        self.is_occupied = bool(told.pop(_LEFT, False))
        self.files = dict(told.pop(_FILES, {}))
        if _ERROR in told:
            raise from_facts(told[_ERROR])
        if _RAISED in told:
            said, trace = map(str, told[_RAISED])
            raise MemoryError if said.startswith("MemoryError") else ForeignError(said, trace)
        return told, found

    def send(self, number: int) -> None:
        """Send the process a signal."""
        self._worker.send(number)

    def end(self) -> None:
        """End the process."""
        self._worker.end()

    def _received(self) -> bytes:
        """Wait for bytes or for the end: a child of the process may hold the pipe open when it is gone."""
        if self._ours not in wait([self._ours, self._worker.sentinel]):
            raise EOFError
        return self._ours.recv_bytes()

    def _ended(self) -> int:
        """End the process, and return its exit code; 1 for one that still runs, but sends what is no message."""
        is_over = wait([self._worker.sentinel], timeout=GRACE)
        self._worker.end()
        return (self._worker.exit_code or 0) if is_over else 1


def trace_to(path: Path) -> None:
    """Let the services of this process write where they are into a file when they crash, or when a signal asks."""
    global _trace_file
    _trace_file = path
    signal.signal(signal.SIGUSR1, lambda number, frame: _pass_on(number))


@atexit.register
def _end_all() -> None:
    """End the services of a process that ends, which would wait for them."""
    for service in _running:
        service.end()


def _pass_on(number: int) -> None:
    for service in _running:
        service.send(number)


def _answer_all(serve: Serve, connection: Connection, trace_file: Path | None) -> None:
    """Answer requests until there are no more, in the process; no work has its timers and signals from another."""
    os.environ.pop(DATA_VARIABLE, None)  # where the data lies is none of its business
    watch_opened_files()
    if trace_file is not None:
        with suppress(OSError):
            trace = trace_file.open("ab")
            faulthandler.enable(trace, all_threads=False)
            faulthandler.register(signal.SIGUSR1, trace, all_threads=False)

    with suppress(EOFError):
        while True:
            facts, arrays = unpacked(connection.recv_bytes())
            before = ProcessState()
            told, found = _tried(serve, facts, arrays)
            connection.send_bytes(packed({**told, _LEFT: before.restore(), _FILES: opened_files()}, found))


def _tried(serve: Serve, facts: Mapping[str, Any], arrays: Arrays) -> tuple[Mapping[str, Any], Arrays]:
    """Facts and arrays of the answer, or what was raised."""
    try:
        return serve(facts, arrays)
    except BenchmarkError as error:
        return {_ERROR: as_facts(error)}, {}
    except BaseException as error:  # also what ends a program
        return {_RAISED: [one_line(error), traceback.format_exc()]}, {}
