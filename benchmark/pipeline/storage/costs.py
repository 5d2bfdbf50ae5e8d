"""Costs of a stage: seconds, and memory above that of the process at rest."""

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
    """Cost of the arrays of one stage.

    Parameters
    ----------
    seconds
        Time of the stage itself, without the stages that it called.
    peak_mib
        Largest resident memory above that of the process before, in MiB; None where the system does not tell.
    first_use
        Whether this process did such work for the first time: compiling and loading are in the figures then, and
        they say nothing about the method.
    resident_mib
        Memory that the result keeps occupied while others share it.
    shared
        Costs of the stages that were called, by name, also where another one had paid for them.
    """

    seconds: float = 0.0
    peak_mib: float | None = None
    first_use: bool = False
    resident_mib: float = 0.0
    shared: dict[str, Cost] = {}

    def to_json(self) -> str:
        """As text that travels with the arrays."""
        return msgspec.json.encode(self).decode()

    @classmethod
    def from_json(cls, text: str) -> Cost:
        """Read :meth:`to_json`; raises ``ValueError`` for anything else."""
        return msgspec.json.decode(text, type=cls)


@dataclass
class _Frame:
    """A stage that is being computed."""

    start: float
    at_rest: int | None
    peak: int = 0
    inner_seconds: float = 0.0
    shared: dict[str, Cost] = field(default_factory=dict)
    elsewhere: Cost | None = None


class Meter:
    """Measures stages that may call each other.

    Memory is the high-water mark of the process itself, set back when a stage begins: the mark that the system keeps
    for child processes survives the start of a new program and tells of the parent. Pages of files are taken off, for
    the system drops those of idle libraries and reads them again as it likes: only what the work itself took counts.
    """

    def __init__(self) -> None:
        self._open: list[_Frame] = []
        self._used: set[str] = set()

    @contextlib.contextmanager
    def measured(self, work: str) -> Iterator[Callable[[], Cost]]:
        """Measure the body; the cost can be asked for when it is over.

        Parameters
        ----------
        work
            What is done; the first time in this process is marked.
        """
        for outer in self._open:
            outer.peak = max(outer.peak, _high_water() or 0)
        if not self._open and (trim := _trim()):  # what earlier work freed must not hide what this work takes
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
        """Let the stage that is being computed cost what it cost in another process, which did its work."""
        if self._open:
            self._open[-1].elsewhere = cost

    def share(self, stage: str, cost: Cost) -> None:
        """Book a stage that was called under the one that is being computed."""
        if self._open:
            self._open[-1].shared[stage] = cost


def _high_water() -> int | None:
    return _without_files("VmHWM")


def _without_files(name: str) -> int | None:
    """A size of this process in bytes, less the pages of files; None where the system does not tell."""
    try:
        fields = dict(line.split(":", 1) for line in _STATUS.read_text().splitlines())
        size, files, shared = (int(fields[each].split()[0]) for each in (name, "RssFile", "RssShmem"))
    except (OSError, KeyError, ValueError, IndexError):
        return None
    return (size - files - shared) * 1024


@functools.cache
def _trim() -> Callable[[int], int] | None:
    try:
        return ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError):
        return None  # not every C library has it
