"""Run the jobs of a plan, and write a record for each."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmark.errors import BenchmarkError
from benchmark.kernels import drop_stale_kernels
from benchmark.machine import memory_per_process
from benchmark.pipeline.cache import Cache, StorageError, writing
from benchmark.pipeline.environment import commit, packages
from benchmark.pipeline.records import Record, write_record
from benchmark.runs.jobs import Gallery, Job, Outcome, Step, Task
from benchmark.runs.planning import Planned
from benchmark.runs.pool import Pool, run_here
from benchmark.text import say

#: A method that refuses as many shapes for one reason before it has treated any fails.
_ALIKE = 3


@dataclass(frozen=True)
class Progress:
    """How far a run is.

    Parameters
    ----------
    done, total
        Numbers of forms.
    working
        What the workers are doing.
    """

    done: int
    total: int
    working: Sequence[str] = ()


def run(
    planned: Sequence[Planned],
    results: Path,
    *,
    size: int = 1,
    timeout: float = 7200.0,
    dask: str = "",
    watch: Callable[[Progress], object] = lambda _: None,
) -> Iterator[tuple[Planned, Record]]:
    """Run the jobs of a plan that need it, and yield each with its record as it ends.

    Parameters
    ----------
    planned
        The plan.
    results
        The results folder, which no other run may be writing to.
    size
        Number of worker processes; 0 runs in this process, so that ``breakpoint()`` works.
    timeout
        Seconds that a method may take for a shape.
    dask
        Address of the scheduler of a dask cluster that does the work instead.
    watch
        Called several times a second.

    Raises
    ------
    StorageError
        If the results folder cannot be written, or another run is writing to it.
    KeyboardInterrupt
        If the run is interrupted; finished jobs and forms are kept.
    """
    with writing(results):
        for job in planned:
            if job.state == "unavailable":
                write_record(results, job.record(status="unavailable", reason=job.reason), job.replaces)
        to_run = {job.job.key: job for job in planned if job.to_run}
        if to_run:
            drop_stale_kernels()
            yield from _Run(to_run, results, watch).records(size, timeout, dask)


@dataclass
class _Run:
    """Jobs under way, by key."""

    jobs: dict[str, Planned]
    results: Path
    watch: Callable[[Progress], object]
    #: Shapes without a result, by the key of the job.
    left: dict[str, set[str]] = field(default_factory=dict)
    lost: dict[tuple[str, str], dict[str, str]] = field(default_factory=dict)
    refusals: dict[str, list[str]] = field(default_factory=dict)
    total: int = 0

    def records(self, size: int, timeout: float, dask: str) -> Iterator[tuple[Planned, Record]]:
        """Run the jobs."""
        queue = deque(self._tasks())
        self.total = self._n_left
        queue.extend(self._ranking(job) for key, job in self.jobs.items() if not self.left[key])
        pool = self._pool(size, timeout, dask)
        ended = run_here(queue, self._is_open) if pool is None else pool.run(queue, self._is_open)
        try:
            for task, step, outcome in ended:
                if task.steps and self._is_open(step, task.shape):
                    yield from self._take(task, step, outcome, queue)
                self.watch(Progress(self.total - self._n_left, self.total, pool.working if pool else ()))
        finally:
            if pool:
                pool.close()

    @property
    def _n_left(self) -> int:
        return sum(map(len, self.left.values()))

    def _is_open(self, step: Step, shape: str) -> bool:
        """Return whether the outcome of a step is still wanted."""
        return step.job.key in self.jobs and (not shape or shape in self.left[step.job.key])

    def _pool(self, size: int, timeout: float, dask: str) -> Any:
        if dask:
            from benchmark.runs.dask import DaskPool

            return DaskPool(dask, timeout)
        if not size:
            return None
        possible = max(1, min(size, memory_per_process() // _SMALLEST))
        if possible < size:
            say(f"only {possible} of {size} processes run at a time: there is no memory for more", err=True)
        return Pool(possible, memory_per_process(possible), timeout)

    def _tasks(self) -> Iterator[Task]:
        """Yield a task for each shape, plugin and seed, large files first; it has the steps of all jobs."""
        steps: dict[tuple[str, str, int, str], list[Step]] = {}
        sizes: dict[str, int] = {}
        for key, planned in self.jobs.items():
            cache = Cache(self.results)
            self.left[key] = set()
            for step, shape, path in planned.steps():
                keys = step.keys
                if not cache.has(*(("signatures", keys.signature) if keys.signature else ("forms", keys.form))):
                    place = (planned.job.source, planned.job.plugin, planned.job.seed, shape)
                    steps.setdefault(place, []).append(step)
                    sizes[shape] = path.stat().st_size if path and path.is_file() else 0
                    self.left[key].add(shape)
        for place in sorted(steps, key=lambda place: -(sizes[place[-1]] if sizes[place[-1]] > _LARGE else 0)):
            yield Task(tuple(steps[place]), place[-1])

    def _ranking(self, planned: Planned) -> Task:
        lost = self.lost.get((planned.job.source, planned.job.input), {})
        models = tuple(planned.model_of(shape) for shape in planned.shapes)
        gallery = Gallery(planned.shapes, planned.labels, planned.keys, models, lost)
        return Task((Step(planned.job),), gallery=gallery)

    def _take(self, task: Task, step: Step, outcome: Outcome, queue: deque[Task]) -> Iterator[tuple[Planned, Record]]:
        """Note an outcome; yield the job with its record if it has ended."""
        job, planned = step.job, self.jobs[step.job.key]
        if outcome.status == "storage":
            raise StorageError(outcome.reason, outcome.traceback)
        if outcome.status == "changed":
            raise BenchmarkError(f"{job.name}: {outcome.reason}", "finished jobs are kept")
        if outcome.status == "lost" and task.shape:
            self._lose(task.shape, job, outcome.reason, queue)
        elif task.gallery or outcome.status not in ("ok", "refused", "unprepared"):
            yield self._end(planned, task, outcome)
        elif reason := self._refused_alike(job, outcome):
            alike = Outcome("failed", f"the first {_ALIKE} shapes are refused alike: {reason}")
            yield self._end(planned, task, alike)
        else:
            self._finish(job.key, task.shape, queue)

    def _finish(self, key: str, shape: str, queue: deque[Task]) -> None:
        """Note that a job is done with a shape; rank its gallery after the last one."""
        self.left[key].discard(shape)
        if not self.left[key]:
            queue.append(self._ranking(self.jobs[key]))

    def _lose(self, shape: str, job: Job, reason: str, queue: deque[Task]) -> None:
        """Refuse a shape for all jobs with its data and input."""
        say(f"{shape}: {reason}", err=True)
        self.lost.setdefault((job.source, job.input), {})[shape] = reason
        for key, other in self.jobs.items():
            if (other.job.source, other.job.input) == (job.source, job.input) and shape in self.left[key]:
                self._finish(key, shape, queue)

    def _refused_alike(self, job: Job, outcome: Outcome) -> str:
        if outcome.status == "unprepared":
            return ""
        reasons = self.refusals.setdefault(job.key, [])
        if len(reasons) < _ALIKE:
            reasons.append(outcome.reason)
            if len(reasons) == _ALIKE and len(set(reasons)) == 1:
                return reasons[0]
        return ""

    def _end(self, planned: Planned, task: Task, outcome: Outcome) -> tuple[Planned, Record]:
        where = f"{task.shape}: " if task.shape else ""
        facts = dict(outcome.content) or {"reason": f"{where}{outcome.reason}", "traceback": outcome.traceback}
        record = planned.record(
            status=outcome.status,
            finished=datetime.now(UTC).isoformat(timespec="milliseconds"),
            commit=commit(),
            packages=packages(),
            **facts,
        )
        write_record(self.results, record, planned.replaces)
        del self.jobs[planned.job.key]
        del self.left[planned.job.key]
        return planned, record


#: Bytes of memory of the smallest process, and of a file whose preparation outlasts the rest of its task.
_SMALLEST, _LARGE = 2**29, 2**23
