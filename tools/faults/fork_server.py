"""A process that has imported the suite and is forked for each command: importing takes longer than most commands.

The forked process is the command: it runs ``benchmark.cli.main.main`` and ends as a program ends, with exit handlers
and threads. Its workers are started as always. Orphans become children of this process, so that none can hide.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import resource
import signal
import sys
from typing import Any

#: In place of a file to write to: a pipe whose reader has gone.
CLOSED = "closed"

#: What the verbs import.
PRELOADED = (
    "benchmark.cli.main",
    "benchmark.cli.listing",
    "benchmark.cli.run_plan",
    "benchmark.jobs.execution.runner",
    "benchmark.plugins.conformance",
    "benchmark.report.content",
    "benchmark.report.comparison",
    "benchmark.datasets.checking",
    "benchmark.geometry.io",
    "benchmark.plugins.inspection",
)

_DEATH_SIGNAL, _SUBREAPER, _DROP_CAPABILITY = 1, 36, 24

#: Rights by which root reads and writes what nobody may.
_OVERRIDING = (1, 2)


def serve() -> None:
    """Fork for each request, a line of JSON on stdin; answer with the process number, then with the exit code."""
    _control(_SUBREAPER, 1)
    _control(_DEATH_SIGNAL, signal.SIGKILL)
    for name in PRELOADED:
        importlib.import_module(name)
    print("ready", flush=True)
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            _become(json.loads(line))
            return
        print(child, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
        _bury()


def _become(request: dict[str, Any]) -> None:
    """Turn into the program that was asked for."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.setsid()
    _control(_DEATH_SIGNAL, signal.SIGKILL)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for number, name in ((1, "output"), (2, "error")):
        os.dup2(_opened(request[name]), number)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    for name, limit in request["limits"].items():
        number = getattr(resource, name)
        resource.setrlimit(number, (limit, resource.getrlimit(number)[1]))
    if request["ordinary_rights"]:
        for right in _OVERRIDING:
            _control(_DROP_CAPABILITY, right)
        _drop_rights()
    if request["patience"]:
        inspection = importlib.import_module("benchmark.plugins.inspection")
        inspection.LIMIT = request["patience"]  # type: ignore[attr-defined]
    module, _, function = request["target"].partition(":")
    sys.argv = [request["target"], *request["arguments"]]
    called = getattr(importlib.import_module(module), function)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    called()


def _opened(path: str) -> int:
    if path != CLOSED:
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    reading, writing = os.pipe()
    os.close(reading)
    return writing


def _bury() -> None:
    """Take note of the orphans that have ended."""
    try:
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    except ChildProcessError:
        return


def _control(option: int, value: int) -> None:
    ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def _drop_rights() -> None:
    """Give up the rights of root to pass over permissions; those of the owner remain."""
    library = ctypes.CDLL(None)
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # third version of the interface, this process
    rights = (ctypes.c_uint32 * 6)()
    library.capget(header, rights)
    mask = ~sum(1 << right for right in _OVERRIDING) & 0xFFFFFFFF
    for place in (0, 1, 2):  # effective, permitted, inheritable
        rights[place] &= mask
    library.capset(header, rights)
