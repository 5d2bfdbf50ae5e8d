"""A run of jobs: what waits goes to a pool, and what its tasks leave is handed on; a fault costs one job alone."""

from __future__ import annotations

import os
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence

from benchmark.errors import BenchmarkError
from benchmark.execution.claims import Claims
from benchmark.execution.job_specs import Job, ShapeBatch
from benchmark.execution.plan import UNSAVED
from benchmark.execution.pools import LOST, UNWRITTEN, Pool, Running
from benchmark.execution.processes.process import BIRTH, BY_HAND, ending
from benchmark.execution.queue import JobQueue
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
                running.end()

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
        elif self._timeout and self._time_of(running, now) > self._timeout:
            running.stop()
            self._running.remove(running)
            self._blame(running, "timeout", _why_stopped(running, self._timeout))

    def _time_of(self, running: Running, now: float) -> float:
        """Seconds of work of the job that a task is at; beginning a process is none, if it does not take for ever."""
        return self._seconds[running.status.job] if running.status.job else now - running.begun - BIRTH

    def _died(self, running: Running) -> None:
        """A task ended in the middle: blame the job that it was at, unless somebody killed its process."""
        code, job = running.exit_code or 0, running.status.job
        self._require_folder()
        if code == UNWRITTEN:
            self._blame(running, UNSAVED, "the results folder could not be written; run again")
        elif not job:
            self._failed_to_start(code)
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

    def _failed_to_start(self, code: int) -> None:
        """Take note that a process ended before it began."""
        self._failed_starts += 1
        if self._failed_starts >= _MAX_FAILED_STARTS:
            raise BenchmarkError(
                f"{_MAX_FAILED_STARTS} processes in turn ended before they began, the last with {ending(code)}",
                "find out what ends them, or run with --executor serial; finished jobs are kept",
            )

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
