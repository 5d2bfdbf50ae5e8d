"""Workers that are forked from a process which has imported the suite, in place of processes that start afresh.

They begin in a tenth of a second rather than two and know nothing of the process of the tests. Tests of processes
themselves start real ones.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from multiprocessing import forkserver
from multiprocessing.reduction import DupFd
from types import SimpleNamespace
from typing import Any

from benchmark.system import workers

_SERVER = forkserver._forkserver


class _Inherited:
    """Environment and streams of whoever sends it, at that time: a forked process has those of its server."""

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, ((dict(os.environ), DupFd(1), DupFd(2)),)


def _begin(address: str, inherited: tuple[Any, ...], begin: Callable[..., None], *arguments: Any) -> None:
    """Begin like a process that starts afresh; the last argument is its parent."""
    environment, *streams = inherited
    os.environ.clear()
    os.environ.update(environment)
    for number, stream in enumerate(streams, 1):
        os.dup2(given := stream.detach(), number)
        os.close(given)
    _SERVER._forkserver_address, _SERVER.ensure_running = address, lambda: None
    workers.multiprocessing = _forking()
    begin(*arguments[:-1], os.getppid())


def _process(context: Any, target: Callable[..., None], args: tuple[Any, ...]) -> Any:
    return context.Process(target=_begin, args=(_SERVER._forkserver_address, _Inherited(), target, *args))


def _forking() -> Any:
    """Stand-in for ``multiprocessing`` where workers are started."""
    context = multiprocessing.get_context("forkserver")
    return SimpleNamespace(
        get_context=lambda _: SimpleNamespace(Process=partial(_process, context)),
        parent_process=multiprocessing.parent_process,
    )


@contextmanager
def server() -> Iterator[Any]:
    """Start the process that others are forked from."""
    forkserver.set_forkserver_preload(["tests.forked_imports"])
    forkserver.ensure_running()  # before it could inherit the mark of a worker
    yield _forking()
    os.kill(_SERVER._forkserver_pid, signal.SIGTERM)  # it would wait for all that hold its pipe
    _SERVER._stop()
