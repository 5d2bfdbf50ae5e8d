"""Kill the descendants of a program, even after the program itself was killed.

Every process of the suite has a mark in its environment; its descendants inherit it. The reaper is a separate process
that reads from a pipe of the program. The pipe closes when the program ends; the reaper then kills all processes with
its mark. This file is the script of the reaper, so it imports nothing from the project. Its arguments are the prefix of
the marks and the process ID of the program.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress

#: Environment variable that marks the processes of the suite.
MARK = "CANONICAL_FORMS_WORKER"

#: Maximum number of passes over all processes: new ones may start while others are killed.
_ROUNDS = 20


def kill_marked(mark: str, pipe: str = "") -> None:
    """Kill all processes whose mark has this prefix or that hold a pipe, including those started meanwhile."""
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
    """Return whether a process holds a pipe, as forks of the program do (their mark is not in /proc)."""
    folder = f"/proc/{process}/fd"
    return any(os.readlink(f"{folder}/{name}") == pipe for name in os.listdir(folder))  # noqa: PTH115, PTH208


def _watch(mark: str, program: int) -> None:
    """Wait until the program ends, even if a fork by foreign code holds the pipe open, then kill its processes."""
    while os.getppid() == program and not select.select([0], [], [], 1.0)[0]:
        pass
    kill_marked(mark, os.readlink("/proc/self/fd/0") if sys.platform == "linux" else "")  # noqa: PTH115


if __name__ == "__main__":
    _watch(sys.argv[1], int(sys.argv[2]))
