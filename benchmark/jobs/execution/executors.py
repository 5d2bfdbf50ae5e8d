"""Ways to get jobs done: one after the other here, or by processes of which each may hang or crash alone."""

from __future__ import annotations

import os
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from benchmark.errors import BenchmarkError
from benchmark.jobs.execution.claims import Claims
from benchmark.jobs.execution.job_queue import JobQueue, record_of
from benchmark.jobs.execution.runner import failure, keep, work
from benchmark.jobs.execution.worker import Status
from benchmark.jobs.execution.worker_pool import INTERVAL, LOST, LocalWorkerPool, PoolWorker, WorkerPool
from benchmark.jobs.job_specs import Job, ScoringTask, ShapeBatch, Task, shape_batches
from benchmark.jobs.plan import UNSAVED
from benchmark.storage.records import Record
from benchmark.storage.store import StorageError, Store
from benchmark.system.workers import BY_HAND, UNWRITTEN, ending

#: Deaths by somebody else's hand after which a job is not tried again.
_MAX_RETRIES = 2

#: Machines that may be lost with a job before it is not tried again: it may be the job that brings them down.
_MACHINES = 5

#: Workers that may die one after the other before they begin, which is no fault of a job, and how often the system may
#: refuse to start one while none runs.
_MAX_FAILED_STARTS = 6

#: Seconds before the system is asked again for a process that it refused.
_PATIENCE = 1.0

#: Told what runs, jobs with the shapes that they are at, and how many shapes are done in all.
Watch = Callable[[Sequence[str], int], None]


class Executor(Protocol):
    """Does jobs and hands back their records as they end."""

    def execute(self, jobs: Sequence[Job], watch: Watch) -> Iterator[tuple[Job, Record]]:
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

    def execute(self, jobs: Sequence[Job], watch: Watch) -> Iterator[tuple[Job, Record]]:
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

    def _done(self, jobs: list[Job], watch: Watch) -> Iterator[tuple[Job, Record]]:
        names = {job.key: job.name for job in jobs}
        done = 0
        to_do = [job for job in jobs if job.key not in Store.open(job.results).records]
        for batch in shape_batches(to_do):
            work(batch, lambda job, steps, shape="", done=done: watch([_said(names[job], shape)], done + steps))
            done += len(batch.identifiers)
        for job in jobs:
            store = Store.open(job.results)
            if job.key not in store.records:
                work(ScoringTask((job,)), lambda job, steps, shape="": watch([_said(names[job], shape)], done))
            yield job, record_of(job, store)
            self.claims.release(job.key)


def _said(job: str, shape: str) -> str:
    """Name of a job, and of the shape or the part of a ranking that it is at."""
    return f"{job}, {shape}" if shape else job


@dataclass(frozen=True)
class ProcessExecutor:
    """A few processes at a time, which do batches of shapes and rankings in turn; with code of plugins, one each.

    A hang, a crash or a leak costs the job in which it happens; the rest of the batch goes on in another process. A job
    in which a process crashed that did others, too, is first tried once more alone.

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

    def execute(self, jobs: Sequence[Job], watch: Watch) -> Iterator[tuple[Job, Record]]:
        """Do the jobs, handing back each record as soon as its job ends."""
        if jobs:
            pool = LocalWorkerPool(self.workers, Store.open(jobs[0].results).progress)
            try:
                yield from Run(jobs, pool, self.claims, self.timeout, watch).records()
            finally:
                pool.close()


@dataclass
class RunningTask:
    """A worker with its task; ``looked`` says when somebody looked at it last."""

    task: Task
    worker: PoolWorker
    looked: float = field(default_factory=time.monotonic)

    @property
    def keys(self) -> list[str]:
        """Keys of its jobs."""
        return [job.key for job in self.task.jobs]


class Workers:
    """The workers of a run, and what jobs have cost them.

    Parameters
    ----------
    pool
        Starts them.
    """

    def __init__(self, pool: WorkerPool) -> None:
        self.pool = pool
        self.running: list[RunningTask] = []
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.deaths: Counter[str] = Counter()
        self._failed_starts = 0
        self._refusals = 0
        self._not_before = 0.0

    @property
    def free(self) -> int:
        """Return how many more can be started now."""
        return self.pool.size - len(self.running) if time.monotonic() >= self._not_before else 0

    def begin(self, task: Task) -> None:
        """Start a worker; raises ``OSError`` if the system starts none now."""
        self.running.append(RunningTask(task, self.pool.begin(task)))
        self._refusals = 0

    def pause(self, error: OSError) -> None:
        """Start none for a moment, after which others may have ended; raises ``BenchmarkError`` if that never helps."""
        self._refusals += not self.running
        self._not_before = time.monotonic() + _PATIENCE
        if self._refusals >= _MAX_FAILED_STARTS:
            raise BenchmarkError(
                f"the system starts no process: {error.strerror}",
                "end other programs or run with --executor serial; finished jobs are kept",
            ) from error

    def look_at(self, running: RunningTask) -> Status:
        """Return how far a worker is, and book the time since the last look for the job that it is at."""
        now, status = time.monotonic(), running.worker.status
        if status.job and not status.is_done:
            self._failed_starts = 0
            self.seconds[status.job] += now - running.looked
        running.looked = now
        return status

    def failed_to_start(self, code: int) -> None:
        """Take note that a worker ended before it began; raises ``BenchmarkError`` if one after the other does."""
        self._failed_starts += 1
        if self._failed_starts >= _MAX_FAILED_STARTS:
            raise BenchmarkError(
                f"{_MAX_FAILED_STARTS} processes in turn ended before they began, the last with {ending(code)}",
                "find out what ends them, or run with --executor serial; finished jobs are kept",
            )


class Run:
    """A run of jobs: what waits goes to the workers, and what they leave is handed on.

    Parameters
    ----------
    jobs
        The jobs, at least one.
    pool
        Starts workers.
    claims
        The jobs that other runs are at.
    timeout
        Seconds of work after which a job is stopped; None for no limit.
    watch
        Told about progress.
    """

    def __init__(
        self, jobs: Sequence[Job], pool: WorkerPool, claims: Claims, timeout: float | None, watch: Watch
    ) -> None:
        self.store = Store.open(jobs[0].results)
        self.queue = JobQueue(jobs, self.store, claims)
        self.workers = Workers(pool)
        self.timeout = timeout
        self.watch = watch

    def records(self) -> Iterator[tuple[Job, Record]]:
        """Work until every job has its record."""
        self._require_folder()
        workers = self.workers
        try:
            while self.queue or workers.running:
                self._start()
                workers.pool.wait([running.worker for running in workers.running])
                for running in list(workers.running):
                    self._look_at(running)
                self.queue.take_over()
                self._tell()
                yield from self.queue.ended({key for running in workers.running for key in running.keys})
        finally:
            for running in workers.running:
                running.worker.end()

    def _start(self) -> None:
        while (free := self.workers.free) > 0 and (task := self.queue.take(free, self.workers.pool.size)):
            try:
                self.workers.begin(task)
            except OSError as error:
                self._require_folder()
                self.queue.put_back(task)
                self.workers.pause(error)

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

    def _look_at(self, running: RunningTask) -> None:
        """End what takes too long, and take note of what has ended."""
        worker, has_ended = running.worker, running.worker.exit_code is not None
        status = self.workers.look_at(running)
        if has_ended:
            worker.end()
            self.workers.running.remove(running)
            if worker.status_at_end.is_done:  # however it died after that
                self.queue.finish(running.task)
            else:
                self._died(running)
        elif self.timeout and self.workers.seconds[status.job] > self.timeout:
            worker.stop()
            self.workers.running.remove(running)
            said = f"stopped after {self.timeout:g} s; pass a longer --timeout, what is done is kept"
            self._blame(running, status, "timeout", said)

    def _died(self, running: RunningTask) -> None:
        """A worker ended in the middle of its task: blame the job that it was at, unless somebody killed it."""
        code, status = running.worker.exit_code or 0, running.worker.status_at_end
        self._require_folder()
        if code == UNWRITTEN:
            status = replace(status, job=status.job or running.keys[0])  # on a full disk it could not even say that
            self._blame(running, status, UNSAVED, "the results folder could not be written; run again")
        elif not status.job:
            self.workers.failed_to_start(code)
            self._again(running)
        elif code == LOST:
            said = f"the machine that it ran on was lost, for the {_MACHINES}th time; --retry it"
            self._killed(running, status, _MACHINES, said)
        elif -code in BY_HAND:
            said = "the process was killed twice, by somebody or for its memory; run it alone with -j 1, or --retry it"
            self._killed(running, status, _MAX_RETRIES, said)
        elif len(running.task.jobs) > 1 and status.job in self.queue.pending:  # what broke it may be another one
            self.queue.set_apart(running.task, status.steps, status.job)
        else:
            job = self.queue.pending.get(status.job)
            more = "'check' shows more" if job and job.is_foreign else "run it with --executor serial to see more"
            self._blame(running, status, "crashed", f"the process ended with {ending(code)}; {more}")

    def _killed(self, running: RunningTask, status: Status, retries: int, said: str) -> None:
        """Somebody else ended it: another try, if it has one left."""
        self.workers.deaths[status.job] += 1
        if self.workers.deaths[status.job] < retries:
            self._again(running)
        else:
            self._blame(running, status, "killed", said)

    def _blame(self, running: RunningTask, status: Status, kind: str, said: str) -> None:
        """Write the record of the job that broke its worker, and let the rest of the batch go on."""
        job = self.queue.pending.get(status.job)
        if job and job.key not in self.store.records:
            where = f"{status.shape}: " if status.shape else ""
            keep(job, self.store, failure(kind, where + said, running.worker.trace))
        self._again(running, without=status.job)

    def _again(self, running: RunningTask, without: str = "") -> None:
        self.queue.put_back(running.task, running.worker.status_at_end.steps, without)

    def _tell(self) -> None:
        """Tell which jobs are at work, or what is waited for, and how many shapes are done."""
        names, shapes = [], self.queue.shapes_done
        for running in self.workers.running:
            status, is_treating = running.worker.status, isinstance(running.task, ShapeBatch)
            if job := self.queue.pending.get(status.job):
                names.append(_said(job.name, status.shape))
            shapes += status.steps if is_treating else 0
        if not self.workers.running and self.workers.pool.waits_for:
            names = [self.workers.pool.waits_for]
        elif not self.workers.running:
            names = [f"another run is at {job.name}" for job in self.queue.elsewhere.values()]
        self.watch(names, shapes)
