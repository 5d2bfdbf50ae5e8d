"""Functions that run inside a dask worker: they have processes beside it do tasks or answer a question.

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

#: Seconds between two looks whether an answer is still wanted, for a process to end, and for the next task to come.
_INTERVAL, _ENDING, _PATIENCE = 1.0, 10.0, 30.0

#: Bytes of an answer, which holds records, at most.
_LONGEST = 2**30

_running: dict[str, Process] = {}

#: Processes that have done a task, by its run: the code of another one may differ.
_waiting: dict[str, list[Process]] = {}


async def ask(message: str, key: str = "") -> str:
    """Return the answer of a process beside this dask worker; see :mod:`benchmark.jobs.cluster.supervisor`.

    The process ends with its input: when this worker is killed, or the cluster has cancelled the task, because its run
    is gone or has given it to another worker.

    Parameters
    ----------
    message
        Task or question, a line of JSON.
    key
        Name of the task in the cluster, with a number behind that of its run; "" for a question, which is no task.

    Raises
    ------
    ChildProcessError
        If there is no answer.
    """
    run, said = key.rpartition("-")[0], b""
    process = await _process_of(run)
    assert process.stdin is not None  # noqa: S101
    assert process.stdout is not None  # noqa: S101
    _running[key] = process
    answer = asyncio.ensure_future(process.stdout.readline())
    try:
        process.stdin.write(message.encode() + b"\n")
        is_wanted = True
        while is_wanted and not answer.done():
            await asyncio.wait([answer], timeout=_INTERVAL)
            is_wanted = not key or _is_wanted(key)
        said = answer.result() if answer.done() else b""
    finally:
        del _running[key]
        if run and said:
            _waiting.setdefault(run, []).append(process)
            asyncio.get_running_loop().call_later(_PATIENCE, _dismiss, run, process)
        else:
            await _end(process)
    if said := said or await answer:
        return said.decode()
    raise ChildProcessError("the suite ended without an answer; the log of the worker says why")


async def _process_of(run: str) -> Process:
    """Return a process that has done a task of a run and waits, or a new one; "" for one that need not stay."""
    while waiting := _waiting.get(run):
        if (process := waiting.pop()).returncode is None:
            return process
    path = os.pathsep.join([str(Path(benchmark.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    words = [sys.executable, "-m", "benchmark.jobs.cluster.supervisor", *(["--stay"] if run else [])]
    environment = os.environ | {"PYTHONPATH": path.rstrip(os.pathsep)}
    return await asyncio.create_subprocess_exec(*words, stdin=PIPE, stdout=PIPE, limit=_LONGEST, env=environment)


def _dismiss(run: str, process: Process) -> None:
    """Let a process go that waits still; its input ends."""
    if process in _waiting.get(run, ()):
        _waiting[run].remove(process)
        assert process.stdin is not None  # noqa: S101
        process.stdin.close()
    if not _waiting.get(run):
        _waiting.pop(run, None)


async def _end(process: Process) -> None:
    """End a process by ending its input, and kill it where that is not enough."""
    assert process.stdin is not None  # noqa: S101
    process.stdin.close()
    with suppress(TimeoutError):
        await asyncio.wait_for(process.wait(), _ENDING)
    with suppress(ProcessLookupError):
        process.kill()


def stop(key: str) -> None:
    """Stop a task, after it has written down where it is; its answer says so."""
    if key in _running:
        _running[key].send_signal(signal.SIGUSR1)


def _is_wanted(key: str) -> bool:
    """Return whether the cluster has not cancelled a task."""
    from distributed import get_worker

    task = get_worker().state.tasks.get(key)
    return task is not None and task.state in ("executing", "long-running")
