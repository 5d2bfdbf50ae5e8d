"""Ways to get jobs done: one after the other here, or by processes of which each may hang or crash alone."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from benchmark.errors import BenchmarkError
from benchmark.jobs.execution.claims import Claims
from benchmark.jobs.execution.crews import INTERVAL, LOST, Crew, CrewWorker, LocalCrew
from benchmark.jobs.execution.runner import failure, keep, work
from benchmark.jobs.execution.worker import UNWRITTEN, Status
from benchmark.jobs.orders import Order, Ranking, Share, Task, shares
from benchmark.jobs.plan import UNSAVED
from benchmark.storage.records import Record
from benchmark.storage.store import StorageError, Store
from benchmark.system.workers import BY_HAND, ending

#: Deaths by somebody else's hand after which a job is not tried again.
_LIVES = 2

#: Machines that may be lost with a job before it is not tried again: it may be the job that brings them down.
_MACHINES = 5

#: Workers that may die one after the other before they begin, which is no fault of a job, and how often the system may
#: refuse to start one while none runs.
_BIRTHS = 6

#: Seconds before the system is asked again for a process that it refused.
_PATIENCE = 1.0

#: Told the names of the running jobs, and how many shapes are done in all.
Watch = Callable[[Sequence[str], int], None]


class Executor(Protocol):
    """Does jobs and hands back their records as they end."""

    def execute(self, orders: Sequence[Order], watch: Watch) -> Iterator[tuple[Order, Record]]:
        """Do the jobs; ``watch`` is told about progress."""
        ...


@dataclass(frozen=True)
class SerialExecutor:
    """Everything in this process: for debugging. There is no timeout, and a crash ends the run.

    What code of plugins makes a part of is done in processes, first: this one has imported the plugin.

    Parameters
    ----------
    claims
        The jobs that other runs are at.
    """

    claims: Claims

    def execute(self, orders: Sequence[Order], watch: Watch) -> Iterator[tuple[Order, Record]]:
        """Treat all shapes, then rank; the jobs of another run come last, if it has not done them by then."""
        left = [order for order in orders if not order.is_foreign]
        yield from ProcessExecutor(1, self.claims).execute([o for o in orders if o.is_foreign], watch)
        while left:
            taken = [order for order in left if self.claims.take(order.key)]
            left = [order for order in left if order not in taken]
            yield from self._done(taken, watch)
            if left:
                watch([], 0)
                time.sleep(INTERVAL)

    def _done(self, orders: list[Order], watch: Watch) -> Iterator[tuple[Order, Record]]:
        names = {order.key: order.name for order in orders}
        done = 0
        to_do = [order for order in orders if order.key not in Store.open(order.results).records]
        for share in shares(to_do, 1):
            work(share, lambda job, steps, shape="", done=done: watch([names[job]], done + steps))
            done += len(share.identifiers)
        for order in orders:
            store = Store.open(order.results)
            if order.key not in store.records:
                work(Ranking((order,)), lambda job, steps, shape="": watch([names[job]], done))
            yield order, _record_of(order, store)
            self.claims.release(order.key)


@dataclass(frozen=True)
class ProcessExecutor:
    """A few processes at a time, each for a share of the shapes or one ranking.

    A hang, a crash or a leak costs the job in which it happens; the rest of the share goes on in another process.

    Parameters
    ----------
    workers
        Processes at a time.
    claims
        The jobs that other runs are at.
    timeout
        Seconds of work after which a job is stopped; None for no limit.
    """

    workers: int
    claims: Claims
    timeout: float | None = None

    def execute(self, orders: Sequence[Order], watch: Watch) -> Iterator[tuple[Order, Record]]:
        """Do the jobs, handing back each record as soon as its job ends."""
        if orders:
            crew = LocalCrew(self.workers, Store.open(orders[0].results).progress)
            yield from Run(list(orders), crew, self.claims, self.timeout, watch).records()


@dataclass
class Run:
    """The jobs of one run, and the workers that are at them."""

    orders: list[Order]
    crew: Crew
    claims: Claims
    timeout: float | None
    watch: Watch
    running: list[CrewWorker] = field(default_factory=list)
    waiting: deque[Share] = field(default_factory=deque)
    to_rank: list[Order] = field(default_factory=list)
    claimed: set[str] = field(default_factory=set)
    elsewhere: dict[str, Order] = field(default_factory=dict)
    open_shares: dict[str, int] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    deaths: dict[str, int] = field(default_factory=dict)
    steps_done: int = 0
    stillborn: int = 0
    refused: int = 0
    not_before: float = 0.0

    def records(self) -> Iterator[tuple[Order, Record]]:
        """Work until every job has its record."""
        self.store = Store.open(self.orders[0].results)
        self._require_folder()
        self.pending = {order.key: order for order in self.orders}
        self._share_out(self.orders)
        try:
            while self.waiting or self.running or self.to_rank or self.elsewhere:
                self._start()
                self.crew.wait(self.running)
                for worker in list(self.running):
                    self._look_at(worker)
                self._look_elsewhere()
                self._tell()
                yield from self._ended()
        finally:
            for worker in self.running:
                worker.end()

    def _share_out(self, orders: Iterable[Order]) -> None:
        for share in shares(list(orders), max(self.crew.size, 1)):
            self.waiting.append(share)
            for order in share.orders:
                self.open_shares[order.key] = self.open_shares.get(order.key, 0) + 1

    def _start(self) -> None:
        while len(self.running) < self.crew.size and time.monotonic() >= self.not_before:
            task = self._due() or self._next_share()
            if task is None:
                return
            number = next(n for n in range(len(self.running) + 1) if n not in {w.number for w in self.running})
            try:
                self.running.append(self.crew.begin(task, number))
            except OSError as error:
                self._refused(task, error)
            else:
                self.refused = 0

    def _refused(self, task: Task, error: OSError) -> None:
        """The system starts no process now: ask again later, when others may have ended."""
        self._require_folder()
        if isinstance(task, Ranking):
            self.to_rank += task.orders
        else:
            self.waiting.appendleft(task)
        self.refused += not self.running
        self.not_before = time.monotonic() + _PATIENCE
        if self.refused >= _BIRTHS:
            raise BenchmarkError(
                f"the system starts no process: {error.strerror}",
                "end other programs or run with --executor serial; finished jobs are kept",
            ) from error

    def _require_folder(self) -> None:
        if not self.store.progress.is_dir():
            raise StorageError(
                f"{self.store.root} vanished during the run",
                "bring it back or choose another --results DIR, and run again",
            )
        if not os.access(self.store.progress, os.W_OK | os.X_OK):
            raise StorageError(
                f"cannot write to {self.store.progress}", "change its rights or choose another --results DIR"
            )

    def _next_share(self) -> Share | None:
        """The next share, without the jobs that another run is at."""
        while self.waiting:
            share = self.waiting[0]
            for order in share.orders:
                if order.key not in self.claimed:
                    self._claim(order)
            if self.waiting and self.waiting[0].orders == share.orders:
                return self.waiting.popleft()
        return None

    def _claim(self, order: Order) -> None:
        if not self.claims.take(order.key):
            self.elsewhere[order.key] = order
        elif order.key not in self.store.records:
            self.claimed.add(order.key)
            return
        self.open_shares[order.key] = 0
        shares_left = [(share, tuple(o for o in share.orders if o != order)) for share in self.waiting]
        self.steps_done += sum(len(share.identifiers) for share, left in shares_left if not left)
        self.waiting = deque(replace(share, orders=left) for share, left in shares_left if left)

    def _look_elsewhere(self) -> None:
        """Take over what another run has given up; what it has done is handed on like everything else."""
        free = [order for key, order in self.elsewhere.items() if self.claims.take(key)]
        for order in free:
            del self.elsewhere[order.key]
        to_do = [order for order in free if order.key not in self.store.records]
        self.claimed |= {order.key for order in to_do}
        self._share_out(to_do)

    def _due(self) -> Ranking | None:
        """Jobs that can be ranked, shared among the free workers: starting a process for each would take longer."""
        free = self.crew.size - len(self.running)
        count = -(-len(self.to_rank) // free)
        chosen, self.to_rank = self.to_rank[:count], self.to_rank[count:]
        return Ranking(tuple(chosen)) if chosen else None

    def _look_at(self, worker: CrewWorker) -> None:
        """Book the time of the job that a worker is at; end what takes too long; take note of what has ended."""
        now, status, ended = time.monotonic(), worker.status, worker.exit_code is not None
        if status.job and not status.is_done:
            self.stillborn = 0
            self.seconds[status.job] = self.seconds.get(status.job, 0.0) + now - worker.looked
        worker.looked = now
        if not ended:
            if self.timeout and self.seconds.get(status.job, 0.0) > self.timeout:
                worker.stop()
                said = f"stopped after {self.timeout:g} s; pass a longer --timeout, what is done is kept"
                self._blame(worker, status, "timeout", said)
            return
        worker.end()
        if worker.status_at_end.is_done:  # however it died after that
            self._finish(worker)
        else:
            self._died(worker)

    def _died(self, worker: CrewWorker) -> None:
        """A process ended in the middle of its task: blame the job that it was at, unless somebody killed it."""
        code, status = worker.exit_code or 0, worker.status_at_end
        self._require_folder()
        if code == UNWRITTEN:
            key = status.job or _keys(worker.task)[0]  # on a full disk it could not even say what it was at
            self._blame(worker, replace(status, job=key), UNSAVED, "the results folder could not be written; run again")
        elif not status.job:
            self.stillborn += 1
            if self.stillborn >= _BIRTHS:
                raise BenchmarkError(
                    f"{_BIRTHS} processes in turn ended before they began, the last with {ending(code)}",
                    "find out what ends them, or run with --executor serial; finished jobs are kept",
                )
            self._again(worker, without="")
        elif code == LOST:
            said = f"the machine that it ran on was lost, for the {_MACHINES}th time; --retry it"
            self._killed(worker, status, _MACHINES, said)
        elif -code in BY_HAND:
            said = "the process was killed twice, by somebody or for its memory; run it alone with -j 1, or --retry it"
            self._killed(worker, status, _LIVES, said)
        else:
            is_foreign = status.job in self.pending and self.pending[status.job].is_foreign
            more = "'check' shows more" if is_foreign else "run it with --executor serial to see more"
            said = f"the process ended with {ending(code)}; {more}"
            self._blame(worker, status, "crashed", said)

    def _killed(self, worker: CrewWorker, status: Status, lives: int, said: str) -> None:
        """Somebody else ended it: another try, if it has one left."""
        self.deaths[status.job] = self.deaths.get(status.job, 0) + 1
        if self.deaths[status.job] < lives:
            self._again(worker, without="")
        else:
            self._blame(worker, status, "killed", said)

    def _blame(self, worker: CrewWorker, status: Status, kind: str, said: str) -> None:
        """Write the record of the job that broke its worker, and let the rest of the share go on."""
        key = status.job
        if key in self.pending and key not in self.store.records:
            where = f"{status.shape}: " if status.shape else ""
            keep(self.pending[key], self.store, failure(kind, where + said, worker.trace))
        self._again(worker, without=key)

    def _again(self, worker: CrewWorker, without: str) -> None:
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

    def _finish(self, worker: CrewWorker) -> None:
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
                self.elsewhere.pop(key, None)
                yield order, _record_of(order, self.store)
                self.claims.release(key)
            elif self.open_shares[key] == 0 and key not in busy and key not in due and key not in self.elsewhere:
                del self.pending[key]  # its ranking ended without a word
                yield order, keep(order, self.store, failure("crashed", "ranking left no record; run it again"))
                self.claims.release(key)

    def _tell(self) -> None:
        at = [worker.status for worker in self.running]
        known = [(s, w) for s, w in zip(at, self.running, strict=True) if s.job in self.pending]
        names = [
            self.pending[s.job].name + (f", {s.shape}" if s.shape and isinstance(w.task, Ranking) else "")
            for s, w in known
        ]
        if not self.running and self.crew.waits_for:
            names = [self.crew.waits_for]
        elif not self.running and self.elsewhere:
            names = [f"another run is at {order.name}" for order in self.elsewhere.values()]
        shapes = sum(s.steps for s, w in zip(at, self.running, strict=True) if isinstance(w.task, Share))
        self.watch(names, self.steps_done + shapes)


def _keys(task: Task) -> list[str]:
    return [order.key for order in task.orders]


def _record_of(order: Order, store: Store) -> Record:
    record = store.records.read(order.key)
    return record if record is not None else keep(order, store, failure("crashed", "the job left no record"))
