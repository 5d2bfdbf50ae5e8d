"""Run jobs on a pool of workers and yield their records; a failure affects only one job."""

from __future__ import annotations

import os
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from math import ceil

from msgspec.structs import replace

from benchmark.errors import BenchmarkError
from benchmark.execution.claims import Claims
from benchmark.execution.job_specs import Job, Task, comparison_tasks, first_tasks
from benchmark.execution.plan import UNSAVED
from benchmark.execution.pools import LOST, UNWRITTEN, Pool, Running
from benchmark.execution.processes.process import BIRTH, BY_HAND, ending
from benchmark.execution.runner import failure, keep
from benchmark.pipeline.storage.records import Record
from benchmark.pipeline.storage.store import StorageError, Store

#: Number of kills from outside, or of lost machines, after which a job counts as failed.
_MAX_DEATHS, _MAX_LOSSES = 2, 5

#: Number of consecutive failed starts of processes after which the run ends.
_MAX_FAILED_STARTS = 6

#: Seconds to wait after the system refused to start a process.
_PATIENCE = 1.0

#: Progress callback: gets the running jobs with their current shapes, and the number of finished shapes.
Watch = Callable[[Sequence[str], int], None]

#: Gallery size from which comparing shapes takes longer than starting a task and reading the signatures.
LARGE = 200

#: Minimum number of shapes in a part of a task; with foreign code, each part starts a process.
SMALLEST_PART = 5


@dataclass
class JobQueue:
    """Queue of waiting tasks; true while work remains, here or in another run.

    A job processes its shapes, then its ranking; if workers would be idle, its distances are computed in blocks in
    between. A job is over once its record exists, even if another run wrote it.

    Parameters
    ----------
    pending
        Unfinished jobs, by key.
    store
        Store of their records.
    claims
        Locks on jobs, shared with other runs.
    elsewhere
        Jobs that another run is working on.
    shapes_done
        Number of finished shapes.
    """

    pending: dict[str, Job]
    store: Store
    claims: Claims
    elsewhere: dict[str, Job] = field(default_factory=dict)
    shapes_done: int = 0
    _shapes: deque[Task] = field(default_factory=deque)
    _rankings: deque[Task] = field(default_factory=deque)
    #: Number of waiting or running tasks of each job.
    _open: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._add(first_tasks(self.pending.values()))

    def __bool__(self) -> bool:
        return bool(self._shapes or self._rankings or self.elsewhere)

    def take(self, free: int, workers: int) -> Task | None:
        """Return a task for a free worker; None if none is ready."""
        for waiting in (self._rankings, self._shapes):
            while waiting:
                task = waiting.popleft()
                jobs = tuple(filter(self._claim, task.jobs))
                self._open.subtract({job.key for job in task.jobs} - {job.key for job in jobs})
                if jobs:
                    task = replace(task, jobs=jobs)
                    return self._part_of(task, workers) if task.identifiers else self._ranking(task, free, workers)
                self.shapes_done += 0 if task.is_part else len(task.identifiers)
        return None

    def finish(self, task: Task) -> None:
        """Mark a task as finished; after the last task of a job, queue its ranking."""
        self.shapes_done += 0 if task.is_part else len(task.identifiers)
        for job in task.jobs:
            self._open[job.key] -= 1
            if not self._open[job.key] and job.key not in self.store.records and (task.identifiers or task.block):
                self._add([Task((job,), is_part=bool(task.block))])

    def put_back(self, task: Task, done: int = 0) -> None:
        """Queue the rest of a task again, of which some shapes are done."""
        left = task.identifiers[done:]
        if task.identifiers and not left:
            self.finish(task)
            return
        self.shapes_done += 0 if task.is_part else len(task.identifiers) - len(left)
        waiting = self._shapes if left and not task.is_part else self._rankings
        waiting.appendleft(replace(task, identifiers=left))

    def put_apart(self, task: Task, done: int, key: str) -> None:
        """Queue the rest of a task again, with one of its jobs in a separate task."""
        alone = tuple(job for job in task.jobs if job.key == key)
        others = tuple(job for job in task.jobs if job.key != key)
        self._rankings.appendleft(Task(alone, task.identifiers[done:], task.block, is_part=True))
        self.put_back(replace(task, jobs=others), done)

    def take_over(self) -> None:
        """Take over jobs that other runs have released, finished or not."""
        free = [job for key, job in self.elsewhere.items() if self.claims.take(key)]
        for job in free:
            del self.elsewhere[job.key]
        self._add(first_tasks(job for job in free if job.key not in self.store.records))

    def ended(self) -> Iterator[tuple[Job, Record]]:
        """Yield the finished jobs with their records."""
        for key, job in list(self.pending.items()):
            record = self.store.records.read(key)
            if record is None and (self._open[key] or key in self.elsewhere):
                continue
            record = record or keep(job, self.store, failure("crashed", "the job left no record; run it again"))
            del self.pending[key]
            self.elsewhere.pop(key, None)
            yield job, record
            self.claims.release(key)

    def _add(self, tasks: Iterable[Task]) -> None:
        for task in tasks:
            (self._shapes if task.identifiers else self._rankings).append(task)
            self._open.update(job.key for job in task.jobs)

    def _claim(self, job: Job) -> bool:
        """Claim a job; return False if another run holds it or its record exists."""
        if self.claims.take(job.key):
            return job.key not in self.store.records
        self.elsewhere[job.key] = job
        return False

    def _part_of(self, task: Task, workers: int) -> Task:
        """Return a task of shapes, cut to one worker's share of the remaining work, so that all workers end together.

        This is guided self-scheduling (Polychronopoulos and Kuck, IEEE Transactions on Computers C-36, 1987).
        """
        left = sum(len(other.identifiers) * len(other.jobs) for other in (task, *self._shapes))
        most = max(SMALLEST_PART, ceil(left / (workers * len(task.jobs))))
        parts = ceil(len(task.identifiers) / most)
        if parts == 1 or task.is_part:
            return task
        end = ceil(len(task.identifiers) / parts)
        self._shapes.appendleft(replace(task, identifiers=task.identifiers[end:]))
        self._open.update(job.key for job in task.jobs)
        return replace(task, identifiers=task.identifiers[:end])

    def _ranking(self, task: Task, free: int, workers: int) -> Task:
        """Return a ranking: the first block of a large one if workers would be idle, or several small ones in one task.

        One process for each small ranking would take longer.
        """
        if task.is_part or task.block:
            return task
        if _is_large(task):
            is_end = workers > 1 and not self._shapes and len(self._rankings) < max(free, 2)
            first, *others = comparison_tasks(task.jobs[0]) if is_end else (task,)
            if not others:
                return task
            self._rankings.extendleft(reversed(others))
            self._open[task.jobs[0].key] += len(others)
            return first
        small = [
            other
            for other in self._rankings
            if not (other.identifiers or other.block or other.is_part or _is_large(other))
        ]
        for other in small[: ceil((len(small) + 1) / free) - 1]:
            if all(map(self._claim, other.jobs)):
                self._rankings.remove(other)
                task = replace(task, jobs=task.jobs + other.jobs)
        return task


def _is_large(task: Task) -> bool:
    return any(len(job.identifiers) >= LARGE and not job.ranks_again for job in task.jobs)


class Scheduler:
    """Scheduler that runs jobs and yields their records as they finish.

    A hang, a crash or a memory leak fails only the job in which it occurs; the rest of its task continues in another
    process. If the process also ran other jobs, the job is first retried in its own process.

    Parameters
    ----------
    jobs
        The jobs, at least one.
    pool
        Workers.
    claims
        Locks on jobs, shared with other runs.
    timeout
        Seconds of work after which a job is stopped; None for no limit.
    watch
        Progress callback.
    """

    def __init__(self, jobs: Sequence[Job], pool: Pool, claims: Claims, timeout: float | None, watch: Watch) -> None:
        self._store = Store.open(jobs[0].results)
        self._queue = JobQueue({job.key: job for job in jobs}, self._store, claims)
        self._pool = pool
        self._timeout = timeout
        self._watch = watch
        self._running: list[Running] = []
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._deaths: Counter[str] = Counter()
        self._failed_starts = 0
        self._not_before = 0.0

    def records(self) -> Iterator[tuple[Job, Record]]:
        """Run all jobs, and yield each with its record.

        Raises
        ------
        BenchmarkError
            If no process can be started, or the results folder has vanished.
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
                yield from self._queue.ended()
        finally:
            for running in self._running:
                self._pool.end(running)

    def _start(self) -> None:
        while (free := self._pool.size - len(self._running)) > 0 and time.monotonic() >= self._not_before:
            if not (task := self._queue.take(free, self._pool.size)):
                return
            try:
                self._running.append(self._pool.begin(task))
            except OSError as error:
                self._require_folder()
                self._queue.put_back(task)
                self._not_before = time.monotonic() + _PATIENCE
                if not self._running:  # otherwise one of them may free resources
                    self._failed_start(str(error.strerror))

    def _failed_start(self, reason: str) -> None:
        self._failed_starts += 1
        if self._failed_starts >= _MAX_FAILED_STARTS:
            raise BenchmarkError(
                f"{_MAX_FAILED_STARTS} consecutive processes did not start, the last because of {reason}",
                "end other programs, or run with -j 0; finished jobs are kept",
            )

    def _require_folder(self) -> None:
        if not self._store.progress.is_dir():
            raise StorageError(
                f"{self._store.root} vanished during the run",
                "restore it or choose another --results DIR, and run again",
            )
        if not os.access(self._store.progress, os.W_OK | os.X_OK):
            raise StorageError(
                f"cannot write to {self._store.progress}", "change its permissions or choose another --results DIR"
            )

    def _look_at(self, running: Running) -> None:
        """Charge the time since the last check to the current job, and handle a task that has ended or timed out."""
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
        """Handle a task that ended early: blame its current job, unless the process was killed from outside."""
        code, job = running.exit_code or 0, running.status.job
        self._require_folder()
        if code == UNWRITTEN:
            self._blame(running, UNSAVED, "the results folder could not be written; run again")
        elif not job:
            self._failed_start(ending(code))
            self._queue.put_back(running.task)
        elif code == LOST:
            reason = f"its machine was lost for the {_MAX_LOSSES}th time; --retry it"
            self._killed(running, _MAX_LOSSES, reason)
        elif -code in BY_HAND:
            reason = "the process was killed twice, by a user or for its memory"
            self._killed(running, _MAX_DEATHS, f"{reason}; run it alone with -j 1, or --retry it")
        elif len(running.task.jobs) > 1 and job in self._queue.pending:  # another job may be the cause
            self._queue.put_apart(running.task, running.status.steps, job)
        else:
            blamed = self._queue.pending.get(job)
            more = "'check' shows more" if blamed and blamed.is_foreign else "run it with -j 0 to see more"
            self._blame(running, "crashed", f"the process ended with {ending(code)}; {more}")

    def _killed(self, running: Running, most: int, reason: str) -> None:
        """Handle a task killed from outside: retry it until the limit is reached."""
        self._deaths[running.status.job] += 1
        if self._deaths[running.status.job] < most:
            self._queue.put_back(running.task, running.status.steps)
        else:
            self._blame(running, "killed", reason)

    def _blame(self, running: Running, kind: str, reason: str) -> None:
        """Write the record of the job that broke a task (the first one if none was reported); the others continue."""
        key = running.status.job or running.task.jobs[0].key
        job = self._queue.pending.get(key)
        if job and key not in self._store.records:
            where = f"{running.status.shape}: " if running.status.shape else ""
            keep(job, self._store, failure(kind, where + reason, running.trace))
        self._queue.put_back(running.task, running.status.steps)  # without this job, which has a record

    def _tell(self) -> None:
        """Report the running jobs, or what the run waits for, and the number of finished shapes."""
        names, shapes = [], self._queue.shapes_done
        for running in self._running:
            task, status = running.task, running.status
            if job := self._queue.pending.get(status.job):
                names.append(f"{job.name}, {status.shape}" if status.shape else job.name)
            shapes += status.steps if task.identifiers and not task.is_part else 0
        if not self._running and self._pool.waits_for:
            names = [self._pool.waits_for]
        elif not self._running:
            names = [f"another run is working on {job.name}" for job in self._queue.elsewhere.values()]
        self._watch(names, shapes)


def _why_stopped(running: Running, timeout: float) -> str:
    if running.status.is_starting:
        return f"importing the plugin does not end: stopped after {BIRTH + timeout:g} s; 'check' shows more"
    return f"stopped after {timeout:g} s; pass a longer --timeout (finished work is kept)"
