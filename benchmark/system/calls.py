"""A function of somebody else, called in a process of its own: whatever it does, the caller hears of it in one line."""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from benchmark.errors import BenchmarkError, as_facts, from_facts, one_line
from benchmark.system.files import write_text
from benchmark.system.workers import BY_HAND, UNWRITTEN, Worker, ending, memory_per_worker

#: Seconds between two looks at what is said.
_INTERVAL = 0.1

#: Seconds that a process may take to begin, on a machine that is busy with other work.
_BIRTH = 60.0

#: Names that no exit, however early, leaves behind.
_ANSWER, _LINES = "answer.json", "lines"


class BrokenCall(BenchmarkError):
    """Code that was called in a process of its own crashed, hung, ended its process, or raised what it should not."""


class KilledCall(BrokenCall):
    """Somebody else may have ended the process."""


@dataclass(frozen=True)
class Guard:
    """Terms of a call of somebody else's code.

    Parameters
    ----------
    what
        Whose code it is, to begin messages with.
    hint
        What to do if it breaks.
    limit
        Seconds that it may take, from one line that it says to the next; None for no limit.
    all_memory
        Whether it may take more than most of the machine's memory.
    quiet
        Whether nothing that it prints is seen.
    """

    what: str
    hint: str
    limit: float | None = None
    all_memory: bool = False
    quiet: bool = False


def call_apart(
    function: Callable[..., Any], *arguments: Any, guard: Guard, say: Callable[[str], None] | None = None
) -> Any:
    """Call a function in a process of its own.

    Parameters
    ----------
    function
        A function of a module. What it returns travels as JSON.
    *arguments
        What it is called with.
    guard
        On what terms.
    say
        Told what the function says while it is at work; with it, the function is given one more argument, to say a line
        to.

    Returns
    -------
    Any
        What the function returned.

    Raises
    ------
    BenchmarkError
        What the function raised of this kind, with its own class where that is one of :mod:`benchmark.errors`.
    BrokenCall
        If it raises anything else, ends the process, crashes it or takes too long.
    """
    with tempfile.TemporaryDirectory(prefix="canonical-forms-") as name:
        folder = Path(name)
        memory = None if guard.all_memory else memory_per_worker()
        try:
            worker = Worker(_answer, function, arguments, folder, say is not None, memory=memory, quiet=guard.quiet)
        except OSError as error:
            raise BrokenCall(
                f"{guard.what}: no process could be started ({error.strerror})", "end others, then try again"
            ) from error
        begun, heard, last = False, 0, time.monotonic()
        try:
            while worker.exit_code is None:
                wait([worker.sentinel], timeout=_INTERVAL)
                if not begun and (folder / _LINES).exists():
                    begun, last = True, time.monotonic()  # starting a process is no fault of the function
                if say and (now := _hear(folder / _LINES, heard, say)) > heard:
                    heard, last = now, time.monotonic()
                patience = guard.limit if guard.limit is None or begun else guard.limit + _BIRTH
                if worker.exit_code is None and patience is not None and time.monotonic() > last + patience:
                    raise BrokenCall(f"{guard.what} does not end: stopped after {guard.limit:g} s", guard.hint)
        finally:
            worker.end()
        if say:
            _hear(folder / _LINES, heard, say)
        return _told(folder / _ANSWER, worker.exit_code or 0, guard)


def _hear(path: Path, heard: int, say: Callable[[str], None]) -> int:
    """Pass on the whole lines after the first bytes of a file; returns how many bytes have been heard."""
    try:
        with path.open("rb") as file:
            file.seek(heard)
            new = file.read()
    except FileNotFoundError:
        return heard
    whole = new[: new.rfind(b"\n") + 1]
    for line in whole.decode("utf-8", "replace").splitlines():
        say(line)
    return heard + len(whole)


def _told(path: Path, code: int, guard: Guard) -> Any:
    """Return what the function left behind."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        if code == UNWRITTEN:
            raise BrokenCall(
                f"the answer of {guard.what} could not be written to {path.parent.parent}",
                "make room there, raise the limit on the size of files (ulimit -f), or name another folder by TMPDIR",
            ) from None
        kind = KilledCall if -code in BY_HAND else BrokenCall
        raise kind(f"{guard.what} ended its process ({ending(code)})", guard.hint) from None
    if "answer" in found:
        return found["answer"]
    if "raised" in found:
        raise BrokenCall(f"{guard.what} raises {found['raised']}", guard.hint)
    raise from_facts(found)


def _answer(function: Callable[..., Any], arguments: tuple[Any, ...], folder: Path, speaks: bool) -> None:
    """Call the function, in its process, and leave behind what came of it."""
    try:
        with (folder / _LINES).open("a", encoding="utf-8", buffering=1) as lines:
            say = (lambda text: _say(lines, text),) if speaks else ()
            answer = function(*arguments, *say)
        content = json.dumps({"answer": answer})
    except BenchmarkError as error:
        content = json.dumps(as_facts(error))
    except MemoryError:
        content = json.dumps({"raised": "MemoryError: out of memory"})
    except BaseException as error:  # also what ends a program: it is told like everything else
        content = json.dumps({"raised": one_line(error)})
    try:
        write_text(folder / _ANSWER, content)
    except OSError:  # a full disk, or a limit on the size of files
        os._exit(UNWRITTEN)


def _say(lines: Any, text: str) -> None:
    lines.write(f"{text}\n")
