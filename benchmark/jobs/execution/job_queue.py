"""The queue of a run: shapes to treat, jobs to rank, and jobs that another run is at."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace

from benchmark.jobs.execution.claims import Claims
from benchmark.jobs.execution.runner import failure, keep
from benchmark.jobs.job_specs import JobSpec, ScoringTask, ShapeBatch, Task, shape_batches
from benchmark.storage.records import Record
from benchmark.storage.store import Store


class JobQueue:
    """The jobs of a run, cut into tasks; true while anything waits.

    Parameters
    ----------
    jobs
        The jobs.
    store
        Where their records are.
    claims
        The jobs that other runs are at.
    workers
        Tasks at a time.
    """

    def __init__(self, jobs: Iterable[JobSpec], store: Store, claims: Claims, workers: int) -> None:
        self.pending = {job.key: job for job in jobs}
        self.elsewhere: dict[str, JobSpec] = {}
        self.shapes_done = 0
        self._store = store
        self._claims = claims
        self._claimed: set[str] = set()
        self._batches: deque[ShapeBatch] = deque()
        self._open_batches: Counter[str] = Counter()
        self._to_rank: list[JobSpec] = []
        self._alone: deque[Task] = deque()
        self._cut(self.pending.values(), workers)

    def __bool__(self) -> bool:
        return bool(self._batches or self._to_rank or self._alone or self.elsewhere)

    def take(self, free: int) -> Task | None:
        """Return a task for one of the free workers: jobs to rank, else a batch of shapes; None if nothing is ready."""
        if self._alone:
            return self._alone.popleft()
        count = -(-len(self._to_rank) // free)  # shared among them: starting a process for each would take longer
        if count:
            chosen, self._to_rank = self._to_rank[:count], self._to_rank[count:]
            return ScoringTask(tuple(chosen))
        while self._batches:
            batch = self._batches[0]
            for job in batch.jobs:
                if job.key not in self._claimed:
                    self._claim(job)
            if all(job.key in self._claimed for job in batch.jobs):
                return self._batches.popleft()
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
        if isinstance(task, ScoringTask):
            self._to_rank += [job for job in left if job.key not in self._store.records]
            return
        if without:
            self._open_batches[without] -= 1
        if left and task.identifiers[shapes_done:]:
            self.shapes_done += shapes_done
            self._batches.appendleft(replace(task, jobs=left, identifiers=task.identifiers[shapes_done:]))
            return
        self.shapes_done += len(task.identifiers)
        for job in left:  # after its last batch a job is ranked, before further shapes
            self._open_batches[job.key] -= 1
            if self._open_batches[job.key] == 0 and job.key not in self._store.records:
                self._to_rank.append(job)

    def set_apart(self, task: Task, shapes_done: int, key: str) -> None:
        """Let a task wait again that no worker has finished, and one of its jobs for a process of its own."""
        alone = tuple(job for job in task.jobs if job.key == key)
        if isinstance(task, ScoringTask):
            self._alone.append(replace(task, jobs=alone))
        else:
            left = task.identifiers[shapes_done:]
            self._alone.append(replace(task, jobs=alone, identifiers=left))
            self._open_batches[key] += 1
            self.shapes_done -= len(left)  # they are counted with the others of the task
        self.put_back(task, shapes_done, without=key)

    def finish(self, task: Task) -> None:
        """Take note that a worker has finished a task."""
        if isinstance(task, ShapeBatch):
            self.put_back(task, len(task.identifiers))

    def take_over(self, workers: int) -> None:
        """Take over what another run has given up; what it has done is handed on like everything else."""
        free = [job for key, job in self.elsewhere.items() if self._claims.take(key)]
        for job in free:
            del self.elsewhere[job.key]
        to_do = [job for job in free if job.key not in self._store.records]
        self._claimed |= {job.key for job in to_do}
        self._cut(to_do, workers)

    def ended(self, busy: Collection[str]) -> Iterator[tuple[JobSpec, Record]]:
        """Hand on the records of the jobs that have ended, without those whose keys a worker is busy with."""
        waiting = {*busy, *self.elsewhere, *(job.key for job in self._to_rank)}
        waiting |= {job.key for task in self._alone for job in task.jobs}
        for key, job in list(self.pending.items()):
            is_treated = self._open_batches[key] == 0
            if key in self._store.records and (is_treated or key not in busy):
                record = record_of(job, self._store)
            elif is_treated and key not in waiting:
                record = keep(job, self._store, failure("crashed", "ranking left no record; run it again"))
            else:
                continue
            del self.pending[key]
            self.elsewhere.pop(key, None)
            yield job, record
            self._claims.release(key)

    def _cut(self, jobs: Iterable[JobSpec], workers: int) -> None:
        for batch in shape_batches(list(jobs), max(workers, 1)):
            self._batches.append(batch)
            self._open_batches.update(job.key for job in batch.jobs)

    def _claim(self, job: JobSpec) -> None:
        """Claim a job, or leave it out of all batches where another run is at it or has done it."""
        if not self._claims.take(job.key):
            self.elsewhere[job.key] = job
        elif job.key not in self._store.records:
            self._claimed.add(job.key)
            return
        self._open_batches[job.key] = 0
        batches_left = [(batch, tuple(o for o in batch.jobs if o.key != job.key)) for batch in self._batches]
        self.shapes_done += sum(len(batch.identifiers) for batch, left in batches_left if not left)
        self._batches = deque(replace(batch, jobs=left) for batch, left in batches_left if left)


def record_of(job: JobSpec, store: Store) -> Record:
    """Return the record of a job that has ended; one that says so where it left none."""
    record = store.records.read(job.key)
    return record if record is not None else keep(job, store, failure("crashed", "the job left no record"))
