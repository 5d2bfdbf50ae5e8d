"""Run the jobs of a plan, and write a record for each."""

from __future__ import annotations

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
from benchmark.pipeline.ranking import Ranked
from benchmark.pipeline.records import Record, write_record
from benchmark.runs.planning import Planned
from benchmark.runs.tasks import Job, Outcome, Queue, Step, Task
from benchmark.runs.workers import Here, Pool
from benchmark.text import say

#: A method that refuses as many shapes for one reason, before any other outcome, fails.
_ALIKE = 3

#: Bytes of memory of the smallest process.
_SMALLEST = 2**29


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
    if not any(job.to_run or job.state == "unavailable" for job in planned):
        return
    with writing(results):
        for job in planned:
            if job.state == "unavailable":
                write_record(results, job.record(status="unavailable", reason=job.reason), job.replaces)
        if to_run := {job.job.key: job for job in planned if job.to_run}:
            drop_stale_kernels()
            workers = _workers(size, timeout, dask)
            try:
                yield from _Run(to_run, results).records(workers, watch)
            finally:
                workers.close()


def _workers(size: int, timeout: float, dask: str) -> Any:
    if dask:
        from benchmark.runs.dask import DaskPool

        return DaskPool(dask, timeout)
    if not size:
        return Here()
    possible = max(1, min(size, memory_per_process() // _SMALLEST))
    if possible < size:
        say(f"only {possible} of {size} processes run at a time: there is no memory for more", err=True)
    return Pool(possible, memory_per_process(possible), timeout)


@dataclass
class _Run:
    """Jobs under way, by key."""

    jobs: dict[str, Planned]
    results: Path
    #: Shapes without a result, by the key of the job.
    left: dict[str, set[str]] = field(default_factory=dict)
    lost: dict[tuple[str, str], dict[str, str]] = field(default_factory=dict)
    #: Outcomes of the first shapes, by the key of the job.
    first: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.queue = Queue(self._is_open)

    def records(self, workers: Any, watch: Callable[[Progress], object]) -> Iterator[tuple[Planned, Record]]:
        """Run the jobs."""
        self.queue.extend(self._tasks())
        total = self._n_left
        self.queue.extend(self._ranking(job) for key, job in self.jobs.items() if not self.left[key])
        while self.jobs:
            for task, step, outcome in workers.poll(self.queue):
                if self._is_open(step, task.shape):
                    yield from self._take(task, step, outcome)
            watch(Progress(total - self._n_left, total, workers.working))

    @property
    def _n_left(self) -> int:
        return sum(map(len, self.left.values()))

    def _is_open(self, step: Step, shape: str) -> bool:
        """Return whether the outcome of a step is still wanted."""
        return step.job.key in self.jobs and (not shape or shape in self.left[step.job.key])

    def _tasks(self) -> list[Task]:
        """Return a task for each shape, plugin and seed, with the steps of all jobs."""
        steps: dict[tuple[str, str, int, str], list[Step]] = {}
        cache = Cache(self.results)
        for key, planned in self.jobs.items():
            self.left[key] = set()
            for entry, step in planned.steps():
                if not cache.has(*step.keys.files()[-1]):
                    group = (planned.job.source, planned.job.plugin, planned.job.seed, entry.identifier)
                    steps.setdefault(group, []).append(step)
                    self.left[key].add(entry.identifier)
        return [Task(tuple(of_group), group[-1]) for group, of_group in steps.items()]

    def _ranking(self, planned: Planned) -> Task:
        lost = self.lost.get((planned.job.source, planned.job.input), {})
        gallery = Ranked(planned.shapes, planned.facts["labels"], planned.keys, lost)
        models = tuple(step.model for _, step in planned.steps())
        return Task((Step(planned.job),), gallery=gallery, models=models)

    def _take(self, task: Task, step: Step, outcome: Outcome) -> Iterator[tuple[Planned, Record]]:
        """Note an outcome; yield the job with its record if it has ended."""
        job, planned = step.job, self.jobs[step.job.key]
        if outcome.status == "storage":
            raise StorageError(outcome.reason)
        if outcome.status == "changed":
            raise BenchmarkError(f"{job.name}: {outcome.reason}", "finished jobs are kept")
        if outcome.status == "lost" and task.shape:
            self._lose(task.shape, job, outcome.reason)
        elif task.gallery or outcome.status not in ("ok", "refused", "unprepared"):
            yield planned, self._end(planned, task.shape, outcome)
        elif self._is_refused_alike(job, outcome):
            alike = Outcome("failed", f"the first {_ALIKE} shapes are refused alike: {outcome.reason}")
            yield planned, self._end(planned, task.shape, alike)
        else:
            self._finish(job.key, task.shape)

    def _finish(self, key: str, shape: str) -> None:
        """Note that a job is done with a shape; rank its gallery after the last one."""
        self.left[key].discard(shape)
        if not self.left[key]:
            self.queue.append(self._ranking(self.jobs[key]))

    def _lose(self, shape: str, job: Job, reason: str) -> None:
        """Refuse a shape for all jobs with its data and input."""
        say(f"{shape}: {reason}", err=True)
        self.lost.setdefault((job.source, job.input), {})[shape] = reason
        for key, other in self.jobs.items():
            if (other.job.source, other.job.input) == (job.source, job.input) and shape in self.left[key]:
                self._finish(key, shape)

    def _is_refused_alike(self, job: Job, outcome: Outcome) -> bool:
        """Return whether this is the last of the first outcomes of a job, and all of them are one refusal."""
        first = self.first.setdefault(job.key, [])
        if outcome.status == "unprepared" or len(first) == _ALIKE:
            return False
        first.append(outcome.reason)
        return len(first) == _ALIKE and set(first) == {outcome.reason} and outcome.status == "refused"

    def _end(self, planned: Planned, shape: str, outcome: Outcome) -> Record:
        reason = f"{shape}: {outcome.reason}" if shape else outcome.reason
        facts = outcome.content or {"reason": reason, "traceback": outcome.traceback}
        finished = datetime.now(UTC).isoformat(timespec="milliseconds")
        record = planned.record(
            status=outcome.status, finished=finished, commit=commit(), packages=packages(), **facts
        )  # fmt: skip
        write_record(self.results, record, planned.replaces)
        del self.jobs[planned.job.key], self.left[planned.job.key]
        return record
