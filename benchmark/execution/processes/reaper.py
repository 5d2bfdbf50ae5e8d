"""Ends what the processes of a program have started, also when the program itself is killed and can end nothing.

Every process that the suite starts bears a mark in its environment, which all that it starts inherits. The reaper is a
process of its own that reads from a pipe of the program; when the pipe ends, so has the program, and whatever still
bears its marks is killed. Run as a script, with the first part of the marks as its argument, this file is that process;
so it imports nothing of the project.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress

#: Environment variable by which the processes that a process of the suite started are known as its own.
MARK = "CANONICAL_FORMS_WORKER"

#: How often processes are looked for: one may be born while the others are killed.
_ROUNDS = 20


def kill_marked(mark: str, pipe: str = "") -> None:
    """Kill every process whose mark begins like this, or that holds a pipe, and those that they start meanwhile."""
    for _ in range(_ROUNDS):
        marked = list(_marked(mark, pipe))
        for process in marked:
            with suppress(OSError):
                os.kill(process, signal.SIGKILL)
        if not marked:
            return
        time.sleep(0.01)


def _marked(mark: str, pipe: str) -> Iterator[int]:
    import psutil

    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if process.pid == os.getpid():
                continue
            if process.environ().get(MARK, "").startswith(mark) or (pipe and _holds(process.pid, pipe)):
                yield process.pid


def _holds(process: int, pipe: str) -> bool:
    """Return whether a process holds a pipe: a copy of the program does, whose environment the system does not tell."""
    folder = f"/proc/{process}/fd"
    return any(os.readlink(f"{folder}/{name}") == pipe for name in os.listdir(folder))  # noqa: PTH115, PTH208


def _watch(mark: str, program: int) -> None:
    """Wait for the end of the program; a copy of it that foreign code made may hold the pipe open."""
    while os.getppid() == program and not select.select([0], [], [], 1.0)[0]:
        pass
    kill_marked(mark, os.readlink("/proc/self/fd/0") if sys.platform == "linux" else "")  # noqa: PTH115


if __name__ == "__main__":
    _watch(sys.argv[1], int(sys.argv[2]))
