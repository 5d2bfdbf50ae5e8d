"""Run tasks on a dask cluster whose workers see the results folder and the data under the same paths."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.machine import memory_per_process
from benchmark.runs.jobs import Outcome, Step, Task
from benchmark.runs.pool import INTERVAL, Ended, IsOpen, Pool

#: Losses of dask workers that a task survives.
_LOSSES = 5


def run_in_worker(task: Task, timeout: float, threads: int) -> list[tuple[Step, Outcome]]:
    """Run a task on a dask worker, in a process of its own, which may crash."""
    if not hasattr(_of_thread, "pool"):
        _of_thread.pool = Pool(1, memory_per_process(threads), timeout)
    outcomes = _of_thread.pool.run(deque([task]), lambda step, shape: True)
    return [(step, outcome) for of, step, outcome in outcomes if of.steps]


#: The worker process of each thread of a dask worker.
_of_thread = threading.local()


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
            raise ConfigurationError("--dask needs the package distributed", "pip install 'canonical-forms[dask]'")
        from distributed import Client

        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # this module reports errors itself
        try:
            self._client = Client(url, timeout=10, set_as_default=False)
        except Exception as error:  # the type depends on the kind of address
            raise ConfigurationError(f"no dask scheduler answers at {url}", "start one or correct --dask") from error
        self._timeout, self._losses = timeout, Counter[str]()
        self._tasks: dict[Any, Task] = {}

    @property
    def working(self) -> list[str]:
        """What the workers are doing."""
        return [f"{task.steps[0].job.method.name}, {task.shape or 'ranking'}" for task in self._tasks.values()]

    def run(self, queue: deque[Task], is_open: IsOpen) -> Ended:
        """Run the tasks of a queue; see :meth:`benchmark.runs.pool.Pool.run`."""
        while queue or self._tasks:
            self._submit(queue, is_open)
            yield from self._ended(queue)
            yield Task(()), Step(None), Outcome("")  # type: ignore[arg-type]

    def close(self) -> None:
        """Cancel what is under way."""
        self._client.cancel(list(self._tasks), force=True)
        self._client.close(timeout=2)

    def _submit(self, queue: deque[Task], is_open: IsOpen) -> None:
        threads = max(sum(self._client.nthreads().values()), 1)
        while queue and len(self._tasks) < 2 * threads:
            task = queue.popleft()
            if steps := tuple(step for step in task.steps if is_open(step, task.shape)):
                task = task._replace(steps=steps)
                future = self._client.submit(run_in_worker, task, self._timeout, threads, pure=False, retries=0)
                self._tasks[future] = task

    def _ended(self, queue: deque[Task]) -> Iterator[tuple[Task, Step, Outcome]]:
        """Yield what has ended; the tasks of a lost worker go back to the queue."""
        done = [future for future in self._tasks if future.done()]
        if not done:
            time.sleep(INTERVAL)
        for future in done:
            task = self._tasks.pop(future)
            if future.status == "finished":
                yield from ((task, *pair) for pair in future.result())
            elif self._losses[task.shape] < _LOSSES:
                self._losses[task.shape] += 1
                queue.append(task)
            else:
                raise BenchmarkError(
                    f"workers of the cluster were lost {_LOSSES} times", "run again: what is done is kept"
                )
