"""Ways to get jobs done: one after the other here, or each in a process of its own that may hang or crash alone."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from benchmark.errors import ConfigurationError
from benchmark.jobs.runner import Order, failure, keep, run
from benchmark.storage.store import Store

Record = dict[str, Any]

#: Share of the machine's memory that all jobs together may take.
MEMORY_SHARE = 0.85


class Executor(Protocol):
    """Does jobs and hands back their records as they end."""

    def execute(self, orders: Sequence[Order], started: Callable[[Order], None]) -> Iterator[tuple[Order, Record]]:
        """Do the jobs; ``started`` is called when one may have begun."""
        ...


@dataclass(frozen=True)
class SerialExecutor:
    """One job after the other in this process: for debugging. There is no timeout, and a crash ends the run."""

    def execute(self, orders: Sequence[Order], started: Callable[[Order], None]) -> Iterator[tuple[Order, Record]]:
        """Do the jobs in order."""
        for order in orders:
            started(order)
            yield order, run(order)


@dataclass(frozen=True)
class ProcessExecutor:
    """A fresh process per job, so that a hang, a crash or a leak costs one job and peak memory is the job's own.

    Parameters
    ----------
    jobs
        Processes at a time.
    timeout
        Seconds after which a job is stopped; None for no limit.
    """

    jobs: int
    timeout: float | None = None

    def execute(self, orders: Sequence[Order], started: Callable[[Order], None]) -> Iterator[tuple[Order, Record]]:
        """Do the jobs, handing back each record as soon as its job ends."""
        import multiprocessing
        from concurrent.futures import FIRST_COMPLETED, wait

        from pebble import ProcessPool

        context = multiprocessing.get_context("spawn")
        limit = _memory_per_job(self.jobs)
        with ProcessPool(max_workers=self.jobs, max_tasks=1, context=context) as pool:
            waiting = list(reversed(orders))
            running: dict[Any, tuple[Order, float]] = {}
            try:
                while waiting or running:
                    # Jobs are handed out one per free process, so that the clock of a job starts with the job.
                    while waiting and len(running) < self.jobs:
                        order = waiting.pop()
                        started(order)
                        future = pool.schedule(_work, args=(order, limit), timeout=self.timeout)
                        running[future] = (order, time.perf_counter())
                    done, _ = wait(running, return_when=FIRST_COMPLETED)
                    for future in done:
                        order, start = running.pop(future)
                        yield order, self._record(future, order, time.perf_counter() - start)
            except BaseException:
                pool.stop()
                pool.join()
                raise

    def _record(self, future: Any, order: Order, seconds: float) -> Record:
        """The record that the job wrote, or one that says how its process ended."""
        from pebble import ProcessExpired

        try:
            return future.result()  # type: ignore[no-any-return]
        except TimeoutError:
            content = failure(
                "timeout", f"stopped after {self.timeout:g} s; pass a longer --timeout, what is done is kept"
            )
        except ProcessExpired as error:
            content = _crash(error.exitcode)
        except Exception as error:  # the job could not even start: a plugin that vanished, say
            content = failure("failed", f"{type(error).__name__}: {error}")
        return keep(order, Store.open(order.results), content, seconds)


def _work(order: Order, memory: int) -> Record:
    """Entry point of a worker process."""
    _limit_memory(memory)
    return run(order)


def _limit_memory(limit: int) -> None:
    """Let a job that eats memory fail alone with a ``MemoryError`` rather than take the machine down."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (limit, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    except (ImportError, ValueError, OSError):
        return  # not every system has this limit; the job then runs without one


def _memory_per_job(jobs: int) -> int:
    import psutil

    return int(psutil.virtual_memory().total * MEMORY_SHARE / jobs)


def _crash(exit_code: int | None) -> Record:
    code = exit_code or 0
    if code == -signal.SIGKILL:
        return failure("memory", "the process was killed, most likely for its memory; run with fewer jobs (-j 1)")
    name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    return failure("crashed", f"the process ended with {name}; run the job alone with --executor serial to see more")


def make_executor(name: str, jobs: int, timeout: float | None) -> Executor:
    """Make an executor by the name it has on the command line.

    Raises
    ------
    ConfigurationError
        If the name is unknown.
    """
    if name == "serial":
        return SerialExecutor()
    if name == "processes":
        return ProcessExecutor(jobs, timeout)
    raise ConfigurationError(f"unknown executor '{name}'", "choose serial or processes")
