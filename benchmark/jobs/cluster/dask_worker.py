"""Functions that run inside a dask worker: they have a process beside it do a task or answer a question.

They take and return texts, never objects: a dask worker that runs for weeks may have older code in its memory.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from asyncio.subprocess import PIPE, Process
from contextlib import suppress
from pathlib import Path

import benchmark

__all__ = ["SAME_SUITE", "ask", "stop"]

#: Hint where a worker would do other work.
SAME_SUITE = "install there the suite and the packages that are here"

#: Seconds between two looks whether an answer is still wanted, and for a process to end.
_INTERVAL, _ENDING = 1.0, 10.0

_running: dict[str, Process] = {}


async def ask(message: str, key: str = "") -> str:
    """Return the answer of a process beside this dask worker; see :mod:`benchmark.jobs.cluster.supervisor`.

    The process ends with its input: when this worker is killed, or the cluster has cancelled the task, because its run
    is gone or has given it to another worker.

    Parameters
    ----------
    message
        Task or question, a line of JSON.
    key
        Name of the task in the cluster; "" for a question, which is no task.

    Raises
    ------
    ChildProcessError
        If there is no answer.
    """
    path = os.pathsep.join([str(Path(benchmark.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "benchmark.jobs.cluster.supervisor", stdin=PIPE, stdout=PIPE,
        env=os.environ | {"PYTHONPATH": path.rstrip(os.pathsep)},
    )  # fmt: skip
    assert process.stdin is not None  # noqa: S101
    assert process.stdout is not None  # noqa: S101
    _running[key] = process
    answer = asyncio.ensure_future(process.stdout.read())
    try:
        process.stdin.write(message.encode() + b"\n")
        is_wanted = True
        while is_wanted and not answer.done():
            await asyncio.wait([answer], timeout=_INTERVAL)
            is_wanted = not key or _is_wanted(key)
    finally:
        del _running[key]
        process.stdin.close()
        with suppress(TimeoutError):
            await asyncio.wait_for(process.wait(), _ENDING)
        with suppress(ProcessLookupError):
            process.kill()
    if said := await answer:
        return said.decode()
    raise ChildProcessError("the suite ended without an answer; the log of the worker says why")


def stop(key: str) -> None:
    """Stop a task, after it has written down where it is; its answer says so."""
    if key in _running:
        _running[key].send_signal(signal.SIGUSR1)


def _is_wanted(key: str) -> bool:
    """Return whether the cluster has not cancelled a task."""
    from distributed import get_worker

    task = get_worker().state.tasks.get(key)
    return task is not None and task.state in ("executing", "long-running")
