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
from benchmark.jobs.execution.runner import failure, keep, work
from benchmark.jobs.execution.worker import UNWRITTEN, Status
from benchmark.jobs.execution.worker_pool import INTERVAL, LOST, LocalWorkerPool, PoolWorker, WorkerPool
from benchmark.jobs.job_specs import JobSpec, ScoringTask, ShapeBatch, Task, shape_batches
from benchmark.jobs.plan import UNSAVED
from benchmark.storage.records import Record
from benchmark.storage.store import StorageError, Store
from benchmark.system.workers import BY_HAND, ending

#: Deaths by somebody else's hand after which a job is not tried again.
_MAX_RETRIES = 2

#: Machines that may be lost with a job before it is not tried again: it may be the job that brings them down.
_MACHINES = 5

#: Workers that may die one after the other before they begin, which is no fault of a job, and how often the system may
#: refuse to start one while none runs.
_MAX_FAILED_STARTS = 6

#: Seconds before the system is asked again for a process that it refused.
_PATIENCE = 1.0

#: Told the names of the running jobs, and how many shapes are done in all.
Watch = Callable[[Sequence[str], int], None]


class Executor(Protocol):
    """Does jobs and hands back their records as they end."""

    def execute(self, jobs: Sequence[JobSpec], watch: Watch) -> Iterator[tuple[JobSpec, Record]]:
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

    def execute(self, jobs: Sequence[JobSpec], watch: Watch) -> Iterator[tuple[JobSpec, Record]]:
        """Treat all shapes, then rank; the jobs of another run come last, if it has not done them by then."""
        left = [job for job in jobs if not job.is_foreign]
        yield from ProcessExecutor(1, self.claims).execute([o for o in jobs if o.is_foreign], watch)
        while left:
            taken = [job for job in left if self.claims.take(job.key)]
            left = [job for job in left if job not in taken]
            yield from self._done(taken, watch)
            if left:
                watch([], 0)
                time.sleep(INTERVAL)

    def _done(self, jobs: list[JobSpec], watch: Watch) -> Iterator[tuple[JobSpec, Record]]:
        names = {job.key: job.name for job in jobs}
        done = 0
        to_do = [job for job in jobs if job.key not in Store.open(job.results).records]
        for batch in shape_batches(to_do, 1):
            work(batch, lambda job, steps, shape="", done=done: watch([names[job]], done + steps))
            done += len(batch.identifiers)
        for job in jobs:
            store = Store.open(job.results)
            if job.key not in store.records:
                work(ScoringTask((job,)), lambda job, steps, shape="": watch([names[job]], done))
            yield job, _record_of(job, store)
            self.claims.release(job.key)


@dataclass(frozen=True)
class ProcessExecutor:
    """A few processes at a time, each for a batch of the shapes or one ranking.

    A hang, a crash or a leak costs the job in which it happens; the rest of the batch goes on in another process.

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

    def execute(self, jobs: Sequence[JobSpec], watch: Watch) -> Iterator[tuple[JobSpec, Record]]:
        """Do the jobs, handing back each record as soon as its job ends."""
        if jobs:
            pool = LocalWorkerPool(self.workers, Store.open(jobs[0].results).progress)
            yield from Run(list(jobs), pool, self.claims, self.timeout, watch).records()


@dataclass
class Run:
    """The jobs of one run, and the workers that are at them."""

    jobs: list[JobSpec]
    pool: WorkerPool
    claims: Claims
    timeout: float | None
    watch: Watch
    running: list[PoolWorker] = field(default_factory=list)
    waiting: deque[ShapeBatch] = field(default_factory=deque)
    to_rank: list[JobSpec] = field(default_factory=list)
    claimed: set[str] = field(default_factory=set)
    elsewhere: dict[str, JobSpec] = field(default_factory=dict)
    open_batches: dict[str, int] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    deaths: dict[str, int] = field(default_factory=dict)
    steps_done: int = 0
    failed_starts: int = 0
    refused: int = 0
    not_before: float = 0.0

    def records(self) -> Iterator[tuple[JobSpec, Record]]:
        """Work until every job has its record."""
        self.store = Store.open(self.jobs[0].results)
        self._require_folder()
        self.pending = {job.key: job for job in self.jobs}
        self._split_into_batches(self.jobs)
        try:
            while self.waiting or self.running or self.to_rank or self.elsewhere:
                self._start()
                self.pool.wait(self.running)
                for worker in list(self.running):
                    self._look_at(worker)
                self._look_elsewhere()
                self._tell()
                yield from self._ended()
        finally:
            for worker in self.running:
                worker.end()

    def _split_into_batches(self, jobs: Iterable[JobSpec]) -> None:
        for batch in shape_batches(list(jobs), max(self.pool.size, 1)):
            self.waiting.append(batch)
            for job in batch.jobs:
                self.open_batches[job.key] = self.open_batches.get(job.key, 0) + 1

    def _start(self) -> None:
        while len(self.running) < self.pool.size and time.monotonic() >= self.not_before:
            task = self._due() or self._next_batch()
            if task is None:
                return
            try:
                self.running.append(self.pool.begin(task))
            except OSError as error:
                self._refused(task, error)
            else:
                self.refused = 0

    def _refused(self, task: Task, error: OSError) -> None:
        """The system starts no process now: ask again later, when others may have ended."""
        self._require_folder()
        if isinstance(task, ScoringTask):
            self.to_rank += task.jobs
        else:
            self.waiting.appendleft(task)
        self.refused += not self.running
        self.not_before = time.monotonic() + _PATIENCE
        if self.refused >= _MAX_FAILED_STARTS:
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

    def _next_batch(self) -> ShapeBatch | None:
        """The next batch, without the jobs that another run is at."""
        while self.waiting:
            batch = self.waiting[0]
            for job in batch.jobs:
                if job.key not in self.claimed:
                    self._claim(job)
            if self.waiting and self.waiting[0].jobs == batch.jobs:
                return self.waiting.popleft()
        return None

    def _claim(self, job: JobSpec) -> None:
        if not self.claims.take(job.key):
            self.elsewhere[job.key] = job
        elif job.key not in self.store.records:
            self.claimed.add(job.key)
            return
        self.open_batches[job.key] = 0
        batches_left = [(batch, tuple(o for o in batch.jobs if o != job)) for batch in self.waiting]
        self.steps_done += sum(len(batch.identifiers) for batch, left in batches_left if not left)
        self.waiting = deque(replace(batch, jobs=left) for batch, left in batches_left if left)

    def _look_elsewhere(self) -> None:
        """Take over what another run has given up; what it has done is handed on like everything else."""
        free = [job for key, job in self.elsewhere.items() if self.claims.take(key)]
        for job in free:
            del self.elsewhere[job.key]
        to_do = [job for job in free if job.key not in self.store.records]
        self.claimed |= {job.key for job in to_do}
        self._split_into_batches(to_do)

    def _due(self) -> ScoringTask | None:
        """Jobs that can be ranked, shared among the free workers: starting a process for each would take longer."""
        free = self.pool.size - len(self.running)
        count = -(-len(self.to_rank) // free)
        chosen, self.to_rank = self.to_rank[:count], self.to_rank[count:]
        return ScoringTask(tuple(chosen)) if chosen else None

    def _look_at(self, worker: PoolWorker) -> None:
        """Book the time of the job that a worker is at; end what takes too long; take note of what has ended."""
        now, status, ended = time.monotonic(), worker.status, worker.exit_code is not None
        if status.job and not status.is_done:
            self.failed_starts = 0
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

    def _died(self, worker: PoolWorker) -> None:
        """A process ended in the middle of its task: blame the job that it was at, unless somebody killed it."""
        code, status = worker.exit_code or 0, worker.status_at_end
        self._require_folder()
        if code == UNWRITTEN:
            key = status.job or _keys(worker.task)[0]  # on a full disk it could not even say what it was at
            self._blame(worker, replace(status, job=key), UNSAVED, "the results folder could not be written; run again")
        elif not status.job:
            self.failed_starts += 1
            if self.failed_starts >= _MAX_FAILED_STARTS:
                raise BenchmarkError(
                    f"{_MAX_FAILED_STARTS} processes in turn ended before they began, the last with {ending(code)}",
                    "find out what ends them, or run with --executor serial; finished jobs are kept",
                )
            self._again(worker, without="")
        elif code == LOST:
            said = f"the machine that it ran on was lost, for the {_MACHINES}th time; --retry it"
            self._killed(worker, status, _MACHINES, said)
        elif -code in BY_HAND:
            said = "the process was killed twice, by somebody or for its memory; run it alone with -j 1, or --retry it"
            self._killed(worker, status, _MAX_RETRIES, said)
        else:
            is_foreign = status.job in self.pending and self.pending[status.job].is_foreign
            more = "'check' shows more" if is_foreign else "run it with --executor serial to see more"
            said = f"the process ended with {ending(code)}; {more}"
            self._blame(worker, status, "crashed", said)

    def _killed(self, worker: PoolWorker, status: Status, retries: int, said: str) -> None:
        """Somebody else ended it: another try, if it has one left."""
        self.deaths[status.job] = self.deaths.get(status.job, 0) + 1
        if self.deaths[status.job] < retries:
            self._again(worker, without="")
        else:
            self._blame(worker, status, "killed", said)

    def _blame(self, worker: PoolWorker, status: Status, kind: str, said: str) -> None:
        """Write the record of the job that broke its worker, and let the rest of the batch go on."""
        key = status.job
        if key in self.pending and key not in self.store.records:
            where = f"{status.shape}: " if status.shape else ""
            keep(self.pending[key], self.store, failure(kind, where + said, worker.trace))
        self._again(worker, without=key)

    def _again(self, worker: PoolWorker, without: str) -> None:
        self.running.remove(worker)
        task = worker.task
        if isinstance(task, ScoringTask):
            self.to_rank += [o for o in task.jobs if o.key != without and o.key not in self.store.records]
            return
        behind = worker.status_at_end.steps
        left = tuple(job for job in task.jobs if job.key != without)
        identifiers = task.identifiers[behind:]
        if without:
            self.open_batches[without] -= 1
        if left and identifiers:
            self.steps_done += behind
            self.waiting.appendleft(replace(task, jobs=left, identifiers=identifiers))
        else:
            self.steps_done += len(task.identifiers)
            for job in left:
                self._close(job)

    def _finish(self, worker: PoolWorker) -> None:
        worker.end()
        self.running.remove(worker)
        if isinstance(worker.task, ShapeBatch):
            self.steps_done += len(worker.task.identifiers)
            for job in worker.task.jobs:
                self._close(job)

    def _close(self, job: JobSpec) -> None:
        """One batch of a job is over; after the last one it is ranked, before further shapes."""
        self.open_batches[job.key] -= 1
        if self.open_batches[job.key] == 0 and job.key not in self.store.records:
            self.to_rank.append(job)

    def _ended(self) -> Iterator[tuple[JobSpec, Record]]:
        busy = {key for worker in self.running for key in _keys(worker.task)}
        due = {job.key for job in self.to_rank}
        for key, job in list(self.pending.items()):
            if key in self.store.records and (self.open_batches[key] == 0 or key not in busy):
                del self.pending[key]
                self.elsewhere.pop(key, None)
                yield job, _record_of(job, self.store)
                self.claims.release(key)
            elif self.open_batches[key] == 0 and key not in busy and key not in due and key not in self.elsewhere:
                del self.pending[key]  # its ranking ended without a word
                yield job, keep(job, self.store, failure("crashed", "ranking left no record; run it again"))
                self.claims.release(key)

    def _tell(self) -> None:
        at = [worker.status for worker in self.running]
        known = [(s, w) for s, w in zip(at, self.running, strict=True) if s.job in self.pending]
        names = [
            self.pending[s.job].name + (f", {s.shape}" if s.shape and isinstance(w.task, ScoringTask) else "")
            for s, w in known
        ]
        if not self.running and self.pool.waits_for:
            names = [self.pool.waits_for]
        elif not self.running and self.elsewhere:
            names = [f"another run is at {job.name}" for job in self.elsewhere.values()]
        shapes = sum(s.steps for s, w in zip(at, self.running, strict=True) if isinstance(w.task, ShapeBatch))
        self.watch(names, self.steps_done + shapes)


def _keys(task: Task) -> list[str]:
    return [job.key for job in task.jobs]


def _record_of(job: JobSpec, store: Store) -> Record:
    record = store.records.read(job.key)
    return record if record is not None else keep(job, store, failure("crashed", "the job left no record"))
