"""A run of jobs: what waits goes to a pool, and what its tasks leave is handed on; a fault costs one job alone."""

from __future__ import annotations

import os
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from math import ceil

from msgspec.structs import replace

from benchmark.errors import BenchmarkError
from benchmark.execution.claims import Claims
from benchmark.execution.job_specs import (
    ComparisonTask,
    Job,
    ScoringTask,
    ShapeBatch,
    Task,
    comparison_tasks,
    shape_batches,
)
from benchmark.execution.plan import UNSAVED
from benchmark.execution.pools import LOST, UNWRITTEN, Pool, Running
from benchmark.execution.processes.process import BIRTH, BY_HAND, ending
from benchmark.execution.runner import failure, keep
from benchmark.pipeline.storage.records import Record
from benchmark.pipeline.storage.store import StorageError, Store

#: Deaths by somebody else's hand after which a job is not tried again.
_MAX_RETRIES = 2

#: Machines that may be lost with a job before it is not tried again: it may be the job that brings them down.
_MACHINES = 5

#: Processes that may die one after the other before they begin, which is no fault of a job, and how often the system
#: may refuse to start one while none runs.
_MAX_FAILED_STARTS = 6

#: Seconds before the system is asked again for a process that it refused.
_PATIENCE = 1.0

#: Told what runs, jobs with the shapes that they are at, and how many shapes are done in all.
Watch = Callable[[Sequence[str], int], None]


#: Shapes from which on it takes longer to compare a gallery than to hand out a task and read its signatures again.
LARGE = 200

#: Shapes in the smallest part of a batch: with code of a plugin, a process is started for each.
SMALLEST_PART = 5


class JobQueue:
    """The jobs of a run, cut into tasks; true while anything waits.

    A job is treated, batch by batch, then ranked; where workers would be idle, its draws are compared apart before.

    Parameters
    ----------
    jobs
        The jobs.
    store
        Where their records are.
    claims
        The jobs that other runs are at.
    """

    def __init__(self, jobs: Iterable[Job], store: Store, claims: Claims) -> None:
        self.pending = {job.key: job for job in jobs}
        self.elsewhere: dict[str, Job] = {}
        self.shapes_done = 0
        self._store = store
        self._claims = claims
        self._batches: deque[ShapeBatch] = deque()
        self._to_rank: list[Job] = []
        #: Tasks that come before all others: draws to compare, and jobs that are tried once more alone.
        self._first: deque[Task] = deque()
        #: Batches, or draws, of a job that wait or are at work; when there are none, it is ranked.
        self._open: Counter[str] = Counter()
        self._cut(self.pending.values())

    def __bool__(self) -> bool:
        return any(map(bool, (self._batches, self._first, self._to_rank, self.elsewhere)))

    def take(self, free: int, workers: int) -> Task | None:
        """Return a task for one of the free workers: jobs to rank, else shapes to treat; None if nothing is ready.

        Where fewer jobs are to be ranked than could be, and all shapes are given out, draws are compared apart.
        """
        if workers > 1 and not self._batches and len(self._to_rank) < max(free, 2):
            self._share_out()
        while self._first:
            task = self._first.popleft()
            if task.jobs[0].key not in self._store.records:
                return task
        if self._to_rank:  # small ones are shared among them: starting a process for each would take longer
            count = 1 if _is_large(self._to_rank[0]) else ceil(len(self._to_rank) / free)
            chosen, self._to_rank = self._to_rank[:count], self._to_rank[count:]
            return ScoringTask(tuple(chosen))
        while self._batches:
            batch = self._batches[0]
            for job in batch.jobs:
                self._claim(job)
            if self._batches and self._batches[0] is batch:
                return self._part_of_first(workers)
        return None

    def put_back(self, task: Task, shapes_done: int = 0, without: str = "") -> None:
        """Let a task wait again that no worker has finished.

        Parameters
        ----------
        task
            The task.
        shapes_done
            Shapes of a batch that are behind it.
        without
            Key of the job of it that is over; "" if none is.
        """
        left = tuple(job for job in task.jobs if job.key != without)
        if isinstance(task, ComparisonTask):
            self._first.append(task)  # passed over where its job has a record by now
            return
        if isinstance(task, ScoringTask):
            self._to_rank += [job for job in left if job.key not in self._store.records]
            return
        if without:
            self._open[without] -= 1
        rest = task.identifiers[shapes_done:] if left else ()
        self.shapes_done += 0 if task.is_repeat else len(task.identifiers) - len(rest)
        if rest:
            self._batches.appendleft(replace(task, jobs=left, identifiers=rest))
            return
        for job in left:  # after its last batch a job is ranked, before further shapes
            self._open[job.key] -= 1
            if not self._open[job.key] and job.key not in self._store.records:
                self._to_rank.append(job)

    def set_apart(self, task: Task, shapes_done: int, key: str) -> None:
        """Let a task wait again that no worker has finished, and one of its jobs for a process of its own."""
        apart = replace(task, jobs=tuple(job for job in task.jobs if job.key == key))
        if isinstance(apart, ShapeBatch):
            apart = replace(apart, identifiers=apart.identifiers[shapes_done:], is_repeat=True)
            self._open[key] += 1
        self._first.append(apart)
        self.put_back(task, shapes_done, without=key)

    def finish(self, task: Task) -> None:
        """Take note that a worker has finished a task."""
        if isinstance(task, ShapeBatch):
            self.put_back(task, len(task.identifiers))
        elif isinstance(task, ComparisonTask):
            (job,) = task.jobs
            self._open[job.key] -= 1
            if not self._open[job.key] and job.key not in self._store.records:
                self._first.append(ScoringTask(task.jobs))

    def take_over(self) -> None:
        """Take over what another run has given up; what it has done is handed on like everything else."""
        free = [job for key, job in self.elsewhere.items() if self._claims.take(key)]
        for job in free:
            del self.elsewhere[job.key]
        self._cut(job for job in free if job.key not in self._store.records)

    def ended(self, busy: Collection[str]) -> Iterator[tuple[Job, Record]]:
        """Hand on the records of the jobs that have ended, without those whose keys a worker is busy with."""
        waiting = {*busy, *self.elsewhere, *(job.key for job in self._to_rank)}
        waiting |= {job.key for task in self._first for job in task.jobs}
        for key, job in list(self.pending.items()):
            if key in self._store.records and (not self._open[key] or key not in busy):
                reason = "the job left no record"
                record = self._store.records.read(key) or keep(job, self._store, failure("crashed", reason))
            elif not self._open[key] and key not in waiting:
                record = keep(job, self._store, failure("crashed", "ranking left no record; run it again"))
            else:
                continue
            del self.pending[key]
            self.elsewhere.pop(key, None)
            yield job, record
            self._claims.release(key)

    def _cut(self, jobs: Iterable[Job]) -> None:
        for batch in shape_batches(list(jobs)):
            self._batches.append(batch)
            self._open.update(job.key for job in batch.jobs)

    def _part_of_first(self, workers: int) -> ShapeBatch:
        """Take the first batch, or where little is left a part of it, so that no worker ends long before the others.

        A share of what is left for each worker: guided self-scheduling (Polychronopoulos and Kuck, IEEE Transactions on
        Computers C-36, 1987).
        """
        batch = self._batches.popleft()
        left = sum(len(each.identifiers) * len(each.jobs) for each in (batch, *self._batches))
        most = max(SMALLEST_PART, ceil(left / (workers * len(batch.jobs))))
        parts = ceil(len(batch.identifiers) / most)
        if parts > 1:
            end = ceil(len(batch.identifiers) / parts)
            self._batches.appendleft(replace(batch, identifiers=batch.identifiers[end:]))
            self._open.update(job.key for job in batch.jobs)
            batch = replace(batch, identifiers=batch.identifiers[:end])
        return batch

    def _share_out(self) -> None:
        """Let the large jobs that wait be compared block by block; they are ranked when all blocks are."""
        for job in [job for job in self._to_rank if _is_large(job)]:
            if len(tasks := comparison_tasks(job)) > 1:
                self._to_rank.remove(job)
                self._first += tasks
                self._open[job.key] = len(tasks)

    def _claim(self, job: Job) -> None:
        """Claim a job, or leave it out of all batches where another run is at it or has done it."""
        if self._claims.has(job.key):
            return
        if not self._claims.take(job.key):
            self.elsewhere[job.key] = job
        elif job.key not in self._store.records:
            return
        self._open[job.key] = 0
        batches_left = [(batch, tuple(o for o in batch.jobs if o.key != job.key)) for batch in self._batches]
        self.shapes_done += sum(len(batch.identifiers) for batch, left in batches_left if not left)
        self._batches = deque(replace(batch, jobs=left) for batch, left in batches_left if left)


def _is_large(job: Job) -> bool:
    return len(job.identifiers) >= LARGE and not job.ranks_again


class Scheduler:
    """Does jobs and hands back their records as they end.

    A hang, a crash or a leak costs the job in which it happens; the rest of the batch goes on in another process. A job
    in which a process crashed that did others, too, is first tried once more alone.

    Parameters
    ----------
    jobs
        The jobs, at least one.
    pool
        Does tasks.
    claims
        The jobs that other runs are at.
    timeout
        Seconds of work after which a job is stopped; None for no limit.
    watch
        Told about progress.
    """

    def __init__(self, jobs: Sequence[Job], pool: Pool, claims: Claims, timeout: float | None, watch: Watch) -> None:
        self._store = Store.open(jobs[0].results)
        self._queue = JobQueue(jobs, self._store, claims)
        self._pool = pool
        self._timeout = timeout
        self._watch = watch
        self._running: list[Running] = []
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._deaths: Counter[str] = Counter()
        self._failed_starts = self._refusals = 0
        self._not_before = 0.0

    def records(self) -> Iterator[tuple[Job, Record]]:
        """Work until every job has its record.

        Raises
        ------
        BenchmarkError
            If nothing can be started for long, or the results folder is gone.
        """
        self._require_folder()
        try:
            while self._queue or self._running:
                self._start()
                self._pool.wait(self._running, self._tell)
                for running in list(self._running):
                    self._look_at(running)
                self._queue.take_over()
                self._tell()
                yield from self._queue.ended({key for running in self._running for key in running.keys})
        finally:
            for running in self._running:
                self._pool.end(running)

    def _start(self) -> None:
        while (free := self._pool.size - len(self._running)) > 0 and time.monotonic() >= self._not_before:
            if not (task := self._queue.take(free, self._pool.size)):
                return
            try:
                self._running.append(self._pool.begin(task))
                self._refusals = 0
            except OSError as error:
                self._require_folder()
                self._queue.put_back(task)
                self._pause(error)

    def _pause(self, error: OSError) -> None:
        """Start nothing for a moment, after which others may have ended."""
        self._refusals += not self._running
        self._not_before = time.monotonic() + _PATIENCE
        if self._refusals >= _MAX_FAILED_STARTS:
            raise BenchmarkError(
                f"the system starts no process: {error.strerror}",
                "end other programs or run with --executor serial; finished jobs are kept",
            ) from error

    def _require_folder(self) -> None:
        if not self._store.progress.is_dir():
            raise StorageError(
                f"{self._store.root} vanished during the run",
                "bring it back or choose another --results DIR, and run again",
            )
        if not os.access(self._store.progress, os.W_OK | os.X_OK):
            raise StorageError(
                f"cannot write to {self._store.progress}", "change its rights or choose another --results DIR"
            )

    def _look_at(self, running: Running) -> None:
        """End what takes too long, and take note of what has ended; the time since the last look is its job's."""
        now, job = time.monotonic(), running.status.job
        running.starting = running.starting + now - running.looked if running.status.is_starting else 0.0
        if job:
            self._failed_starts = 0
            if not 0 < running.starting <= BIRTH:
                self._seconds[job] += now - running.looked
        running.looked = now
        if running.has_ended:
            self._running.remove(running)
            if running.is_finished:
                self._queue.finish(running.task)
            else:
                self._died(running)
        elif self._timeout and (self._seconds[job] if job else now - running.begun - BIRTH) > self._timeout:
            self._pool.stop(running)
            self._running.remove(running)
            self._blame(running, "timeout", _why_stopped(running, self._timeout))

    def _died(self, running: Running) -> None:
        """A task ended in the middle: blame the job that it was at, unless somebody killed its process."""
        code, job = running.exit_code or 0, running.status.job
        self._require_folder()
        if code == UNWRITTEN:
            self._blame(running, UNSAVED, "the results folder could not be written; run again")
        elif not job:
            self._failed_starts += 1
            if self._failed_starts >= _MAX_FAILED_STARTS:
                raise BenchmarkError(
                    f"{_MAX_FAILED_STARTS} processes in turn ended before they began, the last with {ending(code)}",
                    "find out what ends them, or run with --executor serial; finished jobs are kept",
                )
            self._again(running)
        elif code == LOST:
            reason = f"the machine that it ran on was lost, for the {_MACHINES}th time; --retry it"
            self._killed(running, _MACHINES, reason)
        elif -code in BY_HAND:
            reason = "the process was killed twice, by somebody or for its memory"
            self._killed(running, _MAX_RETRIES, f"{reason}; run it alone with -j 1, or --retry it")
        elif len(running.task.jobs) > 1 and job in self._queue.pending:  # what broke it may be another one
            self._queue.set_apart(running.task, running.status.steps, job)
        else:
            blamed = self._queue.pending.get(job)
            more = "'check' shows more" if blamed and blamed.is_foreign else "run it with --executor serial to see more"
            self._blame(running, "crashed", f"the process ended with {ending(code)}; {more}")

    def _killed(self, running: Running, retries: int, reason: str) -> None:
        """Somebody else ended it: another try, if it has one left."""
        self._deaths[running.status.job] += 1
        if self._deaths[running.status.job] < retries:
            self._again(running)
        else:
            self._blame(running, "killed", reason)

    def _blame(self, running: Running, kind: str, reason: str) -> None:
        """Write the record of the job that broke a task, the first where it named none; the others go on."""
        key = running.status.job or running.keys[0]
        job = self._queue.pending.get(key)
        if job and key not in self._store.records:
            where = f"{running.status.shape}: " if running.status.shape else ""
            keep(job, self._store, failure(kind, where + reason, running.trace))
        self._again(running, without=key)

    def _again(self, running: Running, without: str = "") -> None:
        self._queue.put_back(running.task, running.status.steps, without)

    def _tell(self) -> None:
        """Tell which jobs are at work, or what is waited for, and how many shapes are done."""
        names, shapes = [], self._queue.shapes_done
        for running in self._running:
            task, status = running.task, running.status
            if job := self._queue.pending.get(status.job):
                names.append(f"{job.name}, {status.shape}" if status.shape else job.name)
            shapes += status.steps if isinstance(task, ShapeBatch) and not task.is_repeat else 0
        if not self._running and self._pool.waits_for:
            names = [self._pool.waits_for]
        elif not self._running:
            names = [f"another run is at {job.name}" for job in self._queue.elsewhere.values()]
        self._watch(names, shapes)


def _why_stopped(running: Running, timeout: float) -> str:
    if running.status.is_starting:
        return f"importing the plugin does not end: stopped after {BIRTH + timeout:g} s; 'check' shows more"
    return f"stopped after {timeout:g} s; pass a longer --timeout, what is done is kept"
