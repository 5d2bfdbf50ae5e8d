"""Run tasks on a dask cluster.

Its workers see the results folder and the data under the same paths.
"""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from typing import Any

from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.kernel_cache import drop_stale_kernels
from benchmark.machine import memory_per_process
from benchmark.runs.tasks import Outcome, Queue, Step, Task
from benchmark.runs.workers import POLL_SECONDS, Pool

#: Tasks that wait for each thread of the cluster, so that none is idle between two polls.
_TASKS_PER_THREAD = 2

#: Seconds that the scheduler may take to answer.
_CONNECTION_TIMEOUT = 10

#: The worker process of each thread of a dask worker, and the run that it serves.
_of_thread = threading.local()


def run_in_worker(
    task: Task, run: str, timeout: float, threads: Mapping[str, int]
) -> list[tuple[Step, Outcome]]:
    """Run a task on a worker of a dask cluster, and return the outcome of each of its steps.

    The task runs in a process of its own, so that a crash does not end the dask worker. The process
    is kept for later tasks of the same run.

    Parameters
    ----------
    task
        Steps to run, in their order.
    run
        Identifier of the run.
    timeout
        Seconds that a method may take for a shape.
    threads
        Number of threads of the cluster on each of its machines, which share the memory of that.
    """
    is_first_of_run = getattr(_of_thread, "run", "") != run
    if is_first_of_run:
        if hasattr(_of_thread, "pool"):
            _of_thread.pool.close()  # the process of the run before
        drop_stale_kernels()
        _of_thread.run = run
        _of_thread.pool = Pool(1, memory_per_process(_threads_here(threads)), timeout)

    queue = Queue(lambda step: True)  # the outcome of every step is wanted
    queue.add(task)
    ended: list[tuple[Step, Outcome]] = []
    while len(ended) < len(task.steps):
        ended += _of_thread.pool.poll(queue)
    return ended


def _threads_here(threads: Mapping[str, int]) -> int:
    """Return the number of threads of the cluster on this machine, of a worker of which one asks.

    Parameters
    ----------
    threads
        Number of threads on each machine; see :func:`_threads_of_machines`.
    """
    from distributed import get_worker
    from distributed.comm import get_address_host

    worker = get_worker()
    of_worker = int(worker.state.nthreads)
    # A worker that has just joined may not be among them.
    return max(threads.get(get_address_host(worker.address), 0), of_worker)


def _threads_of_machines(threads: Mapping[str, int]) -> dict[str, int]:
    """Return the number of threads on each machine, from that of each worker by its address."""
    from distributed.comm import get_address_host

    of_machines: Counter[str] = Counter()
    for address, count in threads.items():
        of_machines[get_address_host(address)] += count
    return dict(of_machines)


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
        """Connect to the scheduler."""
        if find_spec("distributed") is None:
            problem = "--dask needs the package distributed"
            raise ConfigurationError(problem, "pip install 'dask[distributed]'")
        from distributed import Client

        # Errors are reported below, and by poll().
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            self._client = Client(url, timeout=_CONNECTION_TIMEOUT, set_as_default=False)
        except Exception as error:  # the type depends on the kind of address
            problem = f"no dask scheduler answers at {url}"
            raise ConfigurationError(problem, "start one or correct --dask") from error
        self._timeout = timeout
        self._run = secrets.token_hex(8)
        #: Tasks that were submitted and have not ended, by their future.
        self._tasks: dict[Any, Task] = {}
        #: Which code the task needs that was submitted last.
        self._last_process = ""

    @property
    def working(self) -> list[str]:
        """What the workers are doing."""
        return [str(task.steps[0]) for task in self._tasks.values()]

    def poll(self, queue: Queue) -> Iterator[tuple[Step, Outcome]]:
        """Submit tasks of a queue to the cluster, and yield the steps that have ended.

        Raises
        ------
        BenchmarkError
            If the cluster has lost a task.
        """
        self._submit_tasks(queue)
        done = [future for future in self._tasks if future.done()]
        if not done:
            time.sleep(POLL_SECONDS)
        for future in done:
            del self._tasks[future]
            if future.status != "finished":  # dask moves the tasks of a lost worker
                problem = f"the cluster lost a task: {future.exception()}"
                raise BenchmarkError(problem, "run again: what is done is kept")
            yield from future.result()

    def _submit_tasks(self, queue: Queue) -> None:
        """Submit tasks of a queue until each thread of the cluster has enough."""
        threads = _threads_of_machines(self._client.nthreads())
        n_threads = max(sum(threads.values()), 1)
        while len(self._tasks) < _TASKS_PER_THREAD * n_threads:
            # Prefer a task for the code of the last one: its process is running already.
            task = queue.take_any([self._last_process])
            if task is None:
                return
            self._last_process = task.process
            future = self._client.submit(
                run_in_worker, task, self._run, self._timeout, threads, pure=False, retries=0
            )
            self._tasks[future] = task

    def close(self) -> None:
        """Cancel what is under way."""
        self._client.cancel(list(self._tasks), force=True)
        self._client.close(timeout=2)
