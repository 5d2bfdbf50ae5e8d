"""The queue of a run: shapes to treat, jobs to compare and rank, and jobs that another run is at."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Collection, Iterable, Iterator
from math import ceil

from msgspec.structs import replace

from benchmark.execution.claims import Claims
from benchmark.execution.job_specs import ComparisonTask, Job, ScoringTask, ShapeBatch, Task, shape_batches
from benchmark.execution.runner import failure, keep
from benchmark.pipeline.recipes import draws_of
from benchmark.pipeline.storage.records import Record
from benchmark.pipeline.storage.store import Store

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
                record = record_of(job, self._store)
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
        """Let each draw of the large jobs that wait be compared by itself; they are ranked when all draws are."""
        for job in [job for job in self._to_rank if _is_large(job)]:
            draws = draws_of(job.method, job.scorer)
            if len(draws) > 1:
                self._to_rank.remove(job)
                self._first += [ComparisonTask((job,), draw) for draw in draws]
                self._open[job.key] = len(draws)

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


def record_of(job: Job, store: Store) -> Record:
    """Return the record of a job that has ended; one that says so where it left none."""
    record = store.records.read(job.key)
    return record if record is not None else keep(job, store, failure("crashed", "the job left no record"))
