"""Run tasks on a dask cluster whose workers see the results folder and the data under the same paths."""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.kernel_cache import drop_stale_kernels
from benchmark.machine import memory_per_process
from benchmark.runs.tasks import Outcome, Queue, Step, Task
from benchmark.runs.workers import POLL_SECONDS, Pool

#: The worker process of each thread of a dask worker, and the run that it serves.
_of_thread = threading.local()


def run_in_worker(task: Task, run: str, timeout: float, threads: int) -> list[tuple[Step, Outcome]]:
    """Run a task on a dask worker, in a process of its own, which may crash and serves one run."""
    if getattr(_of_thread, "run", "") != run:
        if hasattr(_of_thread, "pool"):
            _of_thread.pool.close()
        drop_stale_kernels()
        _of_thread.run, _of_thread.pool = run, Pool(1, memory_per_process(threads), timeout)
    queue, ended = Queue(lambda step: True), list[tuple[Step, Outcome]]()
    queue.add(task)
    while len(ended) < len(task.steps):
        ended += _of_thread.pool.poll(queue)
    return ended


class DaskPool:
    """Workers of a dask cluster.

    Parameters
    ----------
    url
        Address of the scheduler.
    timeout
        Seconds that a method may take for a shape.

    Raises
    ------
    ConfigurationError
        If dask is not installed, or no scheduler answers.
    """

    def __init__(self, url: str, timeout: float) -> None:
        if find_spec("distributed") is None:
            raise ConfigurationError(
                "--dask needs the package distributed", "pip install 'dask[distributed]'"
            )
        from distributed import Client

        logging.getLogger("distributed").setLevel(
            logging.CRITICAL
        )  # this module reports errors itself
        try:
            self._client = Client(url, timeout=10, set_as_default=False)
        except Exception as error:  # the type depends on the kind of address
            raise ConfigurationError(
                f"no dask scheduler answers at {url}", "start one or correct --dask"
            ) from error
        self._timeout, self._run = timeout, secrets.token_hex(8)
        self._tasks: dict[Any, Task] = {}
        self._process = ""

    @property
    def working(self) -> list[str]:
        """What the workers are doing."""
        return [str(task.steps[0]) for task in self._tasks.values()]

    def poll(self, queue: Queue) -> Iterator[tuple[Step, Outcome]]:
        """Submit tasks of a queue, and yield the steps that have ended; dask moves those of a lost worker."""
        threads = max(sum(self._client.nthreads().values()), 1)
        while len(self._tasks) < 2 * threads and (task := queue.take_any([self._process])):
            self._process = task.process  # the next one of the same may find its process at work
            future = self._client.submit(
                run_in_worker, task, self._run, self._timeout, threads, pure=False, retries=0
            )
            self._tasks[future] = task
        done = [future for future in self._tasks if future.done()]
        if not done:
            time.sleep(POLL_SECONDS)
        for future in done:
            del self._tasks[future]
            if future.status != "finished":
                problem = f"the cluster lost a task: {future.exception()}"
                raise BenchmarkError(problem, "run again: what is done is kept")
            yield from future.result()

    def close(self) -> None:
        """Cancel what is under way."""
        self._client.cancel(list(self._tasks), force=True)
        self._client.close(timeout=2)
