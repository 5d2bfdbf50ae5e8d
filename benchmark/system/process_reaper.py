"""Ends what the workers of a program have started, also when the program itself is killed and can end nothing.

Every worker bears a mark in its environment, which all that it starts inherits. The reaper is a process of its own
that reads from a pipe of the program; when the pipe ends, so has the program, and whatever still bears its marks is
killed. Run as a script, with the first part of the marks as its argument, this file is that process; so it imports
nothing of the project.
"""

from __future__ import annotations

import multiprocessing
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache

#: Environment variable by which the processes that a worker started are known as its own.
MARK = "CANONICAL_FORMS_WORKER"

#: How often processes are looked for: one may be born while the others are killed.
_ROUNDS = 20


@cache
def token() -> str:
    """First part of the marks of all workers of this program, for which a reaper is watching from now on."""
    made = secrets.token_hex(16)
    read, _write = os.pipe()  # which stays open for as long as this process lives
    reaper = subprocess.Popen(
        [sys.executable, "-P", __file__, made],
        stdin=read,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={name: value for name, value in os.environ.items() if name != MARK},  # nor may the reaper of another one
        start_new_session=True,  # what ends the program must not end its reaper
    )
    os.close(read)
    reaper.returncode = 0  # it outlives this process, which is no oversight to be warned of
    return made


def mark_of_this() -> str:
    """Return how the marks of all begin that this process starts: a worker's own mark, which ends with it."""
    inherited = "" if multiprocessing.parent_process() is None else os.environ.get(MARK, "")
    return inherited or f"{token()}-"


def adopt() -> None:
    """Mark this process, so that whatever foreign code starts here ends with it; a worker bears a mark already."""
    if multiprocessing.parent_process() is None:
        os.environ[MARK] = f"{token()}-here-"


def kill_marked(mark: str) -> None:
    """Kill every process whose mark begins like this, and those that they start meanwhile."""
    for _ in range(_ROUNDS):
        found = list(_marked(mark))
        for process in found:
            with suppress(OSError):
                os.kill(process, signal.SIGKILL)
        if not found:
            return
        time.sleep(0.01)


def _marked(mark: str) -> Iterator[int]:
    import psutil

    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if process.pid != os.getpid() and process.environ().get(MARK, "").startswith(mark):
                yield process.pid


if __name__ == "__main__":
    sys.stdin.buffer.read()
    kill_marked(sys.argv[1])
