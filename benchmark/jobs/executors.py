"""Ways to get jobs done: one after the other here, or by processes of which each may hang or crash alone."""

from __future__ import annotations

import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from multiprocessing.connection import wait
from typing import Protocol

from benchmark.errors import ConfigurationError
from benchmark.jobs.orders import Order, Ranking, Share, Task, shares
from benchmark.jobs.runner import failure, keep, work
from benchmark.jobs.worker import Worker, memory_per_worker
from benchmark.storage.records import Record
from benchmark.storage.store import Store

#: Share of the machine's memory that all workers together may take.
MEMORY_SHARE = 0.85

#: Seconds between two looks at the workers.
_INTERVAL = 0.1

#: Deaths by somebody else's hand, or at birth, after which a worker is not tried again.
_LIVES = 2

#: Told the names of the running jobs, and how many shapes are done in all.
Watch = Callable[[Sequence[str], int], None]


class Executor(Protocol):
    """Does jobs and hands back their records as they end."""

    def execute(self, orders: Sequence[Order], watch: Watch) -> Iterator[tuple[Order, Record]]:
        """Do the jobs; ``watch`` is told about progress."""
        ...


@dataclass(frozen=True)
class SerialExecutor:
    """Everything in this process: for debugging. There is no timeout, and a crash ends the run."""

    def execute(self, orders: Sequence[Order], watch: Watch) -> Iterator[tuple[Order, Record]]:
        """Treat all shapes, then rank."""
        names = {order.key: order.name for order in orders}
        done = 0
        for share in shares(list(orders), 1):
            work(share, lambda job, steps, done=done: watch([names[job]], done + steps))  # type: ignore[misc]
            done += len(share.identifiers)
        for order in orders:
            store = Store.open(order.results)
            if order.key not in store.records:
                work(Ranking((order,)), lambda job, _: watch([names[job]], done))
            yield order, _record_of(order, store)


@dataclass(frozen=True)
class ProcessExecutor:
    """A few processes at a time, each for a share of the shapes or one ranking.

    A hang, a crash or a leak costs the job in which it happens; the rest of the share goes on in another process.

    Parameters
    ----------
    workers
        Processes at a time.
    timeout
        Seconds of work after which a job is stopped; None for no limit.
    """

    workers: int
    timeout: float | None = None

    def execute(self, orders: Sequence[Order], watch: Watch) -> Iterator[tuple[Order, Record]]:
        """Do the jobs, handing back each record as soon as its job ends."""
        if orders:
            yield from _Run(list(orders), self.workers, self.timeout, watch).records()


@dataclass
class _Run:
    """The jobs of one run, and the processes that are at them."""

    orders: list[Order]
    workers: int
    timeout: float | None
    watch: Watch
    running: list[Worker] = field(default_factory=list)
    waiting: deque[Share] = field(default_factory=deque)
    to_rank: list[Order] = field(default_factory=list)
    open_shares: dict[str, int] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    deaths: dict[str, int] = field(default_factory=dict)
    steps_done: int = 0

    def records(self) -> Iterator[tuple[Order, Record]]:
        """Work until every job has its record."""
        self.store = Store.open(self.orders[0].results)
        self.memory = memory_per_worker(self.workers, MEMORY_SHARE)
        self.pending = {order.key: order for order in self.orders}
        for share in shares(self.orders, self.workers):
            self.waiting.append(share)
            for order in share.orders:
                self.open_shares[order.key] = self.open_shares.get(order.key, 0) + 1
        try:
            while self.waiting or self.running or self.to_rank:
                self._start()
                wait([worker.sentinel for worker in self.running], timeout=_INTERVAL)
                for worker in list(self.running):
                    self._look_at(worker)
                self._tell()
                yield from self._ended()
        finally:
            for worker in self.running:
                worker.end()

    def _start(self) -> None:
        while (self.waiting or self.to_rank) and len(self.running) < self.workers:
            task = self._due() or self.waiting.popleft()
            number = next(n for n in range(self.workers) if n not in {w.number for w in self.running})
            self.running.append(Worker(task, number, self.store.progress, self.memory))

    def _due(self) -> Ranking | None:
        """Jobs that can be ranked, shared among the free workers: starting a process for each would take longer."""
        free = self.workers - len(self.running)
        count = -(-len(self.to_rank) // free)
        chosen, self.to_rank = self.to_rank[:count], self.to_rank[count:]
        return Ranking(tuple(chosen)) if chosen else None

    def _look_at(self, worker: Worker) -> None:
        """Book the time of the job that a worker is at; end what takes too long; take note of what has ended."""
        now, status = time.monotonic(), worker.status
        if status.job and not status.is_done:
            self.seconds[status.job] = self.seconds.get(status.job, 0.0) + now - worker.looked
        worker.looked = now
        if worker.exit_code is None:
            if self.timeout and self.seconds.get(status.job, 0.0) > self.timeout:
                worker.end()
                said = f"stopped after {self.timeout:g} s; pass a longer --timeout, what is done is kept"
                self._blame(worker, status.job, failure("timeout", said))
            return
        if worker.status.is_done:
            self._finish(worker)
            return
        worker.end()
        self._died(worker)

    def _died(self, worker: Worker) -> None:
        """A process ended in the middle of its task: blame the job that it was at, unless somebody killed it."""
        code, job = worker.exit_code or 0, worker.status_at_end.job
        whose = job or worker.task.orders[0].key
        if not job or code == -signal.SIGKILL:
            self.deaths[whose] = self.deaths.get(whose, 0) + 1
            if self.deaths[whose] < _LIVES:
                self._again(worker, without="")
                return
        self._blame(worker, whose, _crash(code, at_birth=not job))

    def _blame(self, worker: Worker, key: str, content: Record) -> None:
        """Write the record of the job that broke its worker, and let the rest of the share go on."""
        if key in self.pending and key not in self.store.records:
            keep(self.pending[key], self.store, content)
        self._again(worker, without=key)

    def _again(self, worker: Worker, without: str) -> None:
        self.running.remove(worker)
        task = worker.task
        if isinstance(task, Ranking):
            self.to_rank += [o for o in task.orders if o.key != without and o.key not in self.store.records]
            return
        behind = worker.status_at_end.steps
        left = tuple(order for order in task.orders if order.key != without)
        identifiers = task.identifiers[behind:]
        if without:
            self.open_shares[without] -= 1
        if left and identifiers:
            self.steps_done += behind
            self.waiting.appendleft(replace(task, orders=left, identifiers=identifiers))
        else:
            self.steps_done += len(task.identifiers)
            for order in left:
                self._close(order)

    def _finish(self, worker: Worker) -> None:
        worker.end()
        self.running.remove(worker)
        if isinstance(worker.task, Share):
            self.steps_done += len(worker.task.identifiers)
            for order in worker.task.orders:
                self._close(order)

    def _close(self, order: Order) -> None:
        """One share of a job is over; after the last one it is ranked, before further shapes are treated."""
        self.open_shares[order.key] -= 1
        if self.open_shares[order.key] == 0 and order.key not in self.store.records:
            self.to_rank.append(order)

    def _ended(self) -> Iterator[tuple[Order, Record]]:
        busy = {key for worker in self.running for key in _keys(worker.task)}
        due = {order.key for order in self.to_rank}
        for key, order in list(self.pending.items()):
            if key in self.store.records and (self.open_shares[key] == 0 or key not in busy):
                del self.pending[key]
                yield order, _record_of(order, self.store)
            elif self.open_shares[key] == 0 and key not in busy and key not in due:
                del self.pending[key]  # its ranking ended without a word
                yield order, keep(order, self.store, failure("crashed", "ranking left no record; run it again"))

    def _tell(self) -> None:
        at = [worker.status for worker in self.running]
        names = [self.pending[status.job].name for status in at if status.job in self.pending]
        shapes = sum(s.steps for s, w in zip(at, self.running, strict=True) if isinstance(w.task, Share))
        self.watch(names, self.steps_done + shapes)


def _keys(task: Task) -> list[str]:
    return [order.key for order in task.orders]


def _record_of(order: Order, store: Store) -> Record:
    record = store.records.read(order.key)
    return record if record is not None else keep(order, store, failure("crashed", "the job left no record"))


def _crash(code: int, *, at_birth: bool) -> Record:
    if code == -signal.SIGKILL:
        return failure(
            "killed",
            "the process was killed twice, by somebody or for its memory; run it alone with -j 1, or --retry it",
        )
    name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    when = " before it began" if at_birth else ""
    return failure("crashed", f"the process ended with {name}{when}; run it with --executor serial to see more")


def make_executor(name: str, workers: int, timeout: float | None) -> Executor:
    """Make an executor by the name it has on the command line.

    Raises
    ------
    ConfigurationError
        If the name is unknown.
    """
    if name == "serial":
        return SerialExecutor()
    if name == "processes":
        return ProcessExecutor(workers, timeout)
    raise ConfigurationError(f"unknown executor '{name}'", "choose serial or processes")
