"""Costs of a stage: seconds, and memory beyond that of the idle process."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_MIB = 2**20


class Cost(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Cost of computing the arrays of one stage.

    Parameters
    ----------
    seconds
        Time of the stage itself, without the stages that it called.
    peak_mib
        Peak resident memory beyond that of the process before, in MiB; None if the system does not report it.
    first_use
        Whether this was the first such work in the process; the cost then includes compiling and loading, and is not
        representative of the method.
    resident_mib
        Memory of the result while several stages share it, in MiB.
    shared
        Costs of the called stages by name, even if their results were already computed.
    """

    seconds: float = 0.0
    peak_mib: float | None = None
    first_use: bool = False
    resident_mib: float = 0.0
    shared: dict[str, Cost] = {}

    def to_json(self) -> str:
        """Return the cost as text, to be stored with the arrays."""
        return msgspec.json.encode(self).decode()

    @classmethod
    def from_json(cls, text: str) -> Cost:
        """Parse the text of :meth:`to_json`; raise ``ValueError`` for anything else."""
        return msgspec.json.decode(text, type=cls)


@dataclass
class _Frame:
    """A stage in progress."""

    start: float
    at_rest: int | None
    peak: int = 0
    inner_seconds: float = 0.0
    shared: dict[str, Cost] = field(default_factory=dict)
    elsewhere: Cost | None = None


class Meter:
    """Meter for stages that may call each other.

    Memory is the peak of the process itself, reset when a stage begins. The system's peak for child processes is
    useless, since a new program inherits that of its parent. File pages are subtracted, because the system drops and
    reloads those of idle libraries at will.
    """

    def __init__(self) -> None:
        self._open: list[_Frame] = []
        self._used: set[str] = set()

    @contextlib.contextmanager
    def measured(self, work: str) -> Iterator[Callable[[], Cost]]:
        """Measure the ``with`` block; call the result afterwards to get the cost.

        Parameters
        ----------
        work
            Name of the work; its first use in this process is marked.
        """
        for outer in self._open:
            outer.peak = max(outer.peak, _high_water() or 0)
        if not self._open and (trim := _trim()):  # memory freed by earlier work must not hide the use of this work
            trim(0)
        with contextlib.suppress(OSError):
            _RESET.write_text("5")
        frame = _Frame(time.perf_counter(), _without_files("VmRSS"))
        self._open.append(frame)
        cost = Cost()
        try:
            yield lambda: cost
        finally:
            self._open.pop()
            elapsed = time.perf_counter() - frame.start
            peak = max(frame.peak, _high_water() or 0)
            if self._open:
                self._open[-1].inner_seconds += elapsed
            for outer in self._open:
                outer.peak = max(outer.peak, peak)
            above = None if frame.at_rest is None or not peak else max(0, peak - frame.at_rest) / _MIB
            if above is not None:
                parts = frame.shared.values()
                alone = (part.peak_mib for part in parts if part.peak_mib is not None)
                above = max([above + sum(part.resident_mib for part in parts), *alone])
            cost = Cost(elapsed - frame.inner_seconds, above, work not in self._used, 0.0, frame.shared)
            self._used.add(work)
            cost = frame.elsewhere or cost

    def replace(self, cost: Cost) -> None:
        """Set the cost of the current stage to that of the process that did the work."""
        if self._open:
            self._open[-1].elsewhere = cost

    def share(self, stage: str, cost: Cost) -> None:
        """Add the cost of a called stage to the shared costs of the current one."""
        if self._open:
            self._open[-1].shared[stage] = cost


def _high_water() -> int | None:
    return _without_files("VmHWM")


def _without_files(name: str) -> int | None:
    """Return a memory size of this process in bytes without pages of files; None if the system does not report it."""
    try:
        fields = dict(line.split(":", 1) for line in _STATUS.read_text().splitlines())
        size, files, shared = (int(fields[label].split()[0]) for label in (name, "RssFile", "RssShmem"))
    except (OSError, KeyError, ValueError, IndexError):
        return None
    return (size - files - shared) * 1024


@functools.cache
def _trim() -> Callable[[int], int] | None:
    try:
        return ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError):
        return None  # not every C library has it
