"""A task on its way to a worker of a dask cluster and back."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Protocol

from distributed import Future

from benchmark.jobs.cluster.worker_node import WorkerNode
from benchmark.jobs.execution.worker import Status
from benchmark.jobs.execution.worker_pool import INTERVAL, LOST
from benchmark.jobs.job_specs import Task

#: Seconds without a sign of life after which a worker that was at work counts as lost; it gives one every two seconds.
SILENCE = 60.0

#: Seconds for a worker that was stopped to write down where it was.
LAST_WORDS = 10.0


class Home(Protocol):
    """Sender of remote tasks."""

    def heard(self, token: str) -> tuple[float, Status] | None:
        """Return when a task was heard of last, and how far it was."""
        ...

    def is_here(self, node: WorkerNode) -> bool:
        """Return whether a worker is still there, as far as the scheduler knows."""
        ...

    def tell_to_stop(self, node: WorkerNode, token: str) -> None:
        """Let a task write down where it is, and end."""
        ...

    def dismissed(self, remote: RemoteTask) -> None:
        """Nobody waits for this task any more."""
        ...

    def keep(self, files: Mapping[str, bytes]) -> None:
        """Take what a task has sent into the results folder; raises ``OSError`` if it cannot be written."""
        ...


class RemoteTask:
    """A task that a dask worker is at.

    Parameters
    ----------
    task, number
        What is done, and its number in the run.
    node
        Who does it.
    future
        What dask will have in the end.
    home
        The pool that sent it.
    """

    def __init__(self, task: Task, number: int, node: WorkerNode, future: Future, home: Home) -> None:
        self.task = task
        self.number = number
        self.node = node
        self.token = str(future.key)
        self.looked = time.monotonic()
        self.status_at_end = Status()
        self.trace = ""
        self._future = future
        self._home = home
        self._code: int | None = None
        self._is_over = False

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process that did it, or minus the number of its signal; ``LOST`` if nobody answers."""
        if self._code is None:
            if self._future.done():
                self._take()
            elif not self._home.is_here(self.node) or self._is_silent():
                self.node.given_up = self.node.seen
                self._lose()
        return self._code

    @property
    def status(self) -> Status:
        """Return how far it is."""
        if self._code is not None:
            return self.status_at_end
        heard = self._home.heard(self.token)
        return heard[1] if heard else Status()

    def stop(self) -> None:
        """End it, after it has written down where it is."""
        self._home.tell_to_stop(self.node, self.token)
        until = time.monotonic() + LAST_WORDS
        while self.exit_code is None and time.monotonic() < until:
            time.sleep(INTERVAL)
        self.end()

    def end(self) -> None:
        """End it, if it still runs; its worker hears of it from the scheduler."""
        if self._is_over:
            return
        self._is_over = True
        if self._code is None:
            self._lose()
        aside(lambda: self._future.cancel(force=True))
        self._home.dismissed(self)

    def _is_silent(self) -> bool:
        heard = self._home.heard(self.token)
        return heard is not None and time.monotonic() - heard[0] > SILENCE

    def _lose(self) -> None:
        """Nothing will come back: without a common folder, all that was made is gone with the worker."""
        status = self.status
        self.status_at_end = status if self.node.shares_folder else Status(status.job, 0, status.shape)
        self._code = LOST

    def _take(self) -> None:
        """Take what the task has left."""
        try:
            result = self._future.result(timeout=SILENCE)
            files, said = dict(result["files"]), json.loads(result["answer"])
            status, trace, code = Status(**said["status"]), str(said["trace"]), int(said["exit_code"])
        except Exception:  # cancelled, killed, or without last words
            self._lose()
            return
        self._home.keep(files)
        self.status_at_end, self.trace, self._code = status, trace, code


def aside(call: Callable[[], object]) -> threading.Thread:
    """Call something that may never return, without waiting for it."""

    def quietly() -> None:
        with suppress(Exception):
            call()

    thread = threading.Thread(target=quietly, daemon=True)
    thread.start()
    return thread


def wait_for(call: Callable[[], object], seconds: float) -> None:
    """Call something that may never return, and wait for it so long."""
    aside(call).join(seconds)
