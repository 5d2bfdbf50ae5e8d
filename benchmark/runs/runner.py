"""Run the jobs of a plan, and write a record for each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from benchmark.depth.reading import EXTENSIONS
from benchmark.errors import BenchmarkError
from benchmark.geometry.io import READABLE, mesh_suffix
from benchmark.kernels import drop_stale_kernels
from benchmark.machine import memory_per_process
from benchmark.pipeline.cache import Cache, writing
from benchmark.pipeline.environment import commit, packages
from benchmark.pipeline.records import Record, write_record
from benchmark.runs.planning import Planned
from benchmark.runs.tasks import Outcome, Queue, Step, Task
from benchmark.runs.workers import Pool
from benchmark.text import say

#: A method that refuses as many shapes for one reason, before any other outcome, fails.
_ALIKE = 3

#: Bytes of memory of the smallest process.
_SMALLEST = 2**29


class Progress(NamedTuple):
    """How far a run is: numbers of forms, and what the workers are doing."""

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
                write_record(results, msgspec.structs.replace(job.record, reason=job.reason), job.replaces)
        if to_run := {job.record.key: job for job in planned if job.to_run}:
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
    possible = min(size, max(1, memory_per_process() // _SMALLEST))
    if possible < size:
        say(f"only {possible} of {size} processes run at a time: there is no memory for more", err=True)
    return Pool(possible, memory_per_process(possible or 1), timeout)


class _Run:
    """Jobs under way, by key."""

    def __init__(self, jobs: dict[str, Planned], results: Path) -> None:
        self.jobs, self.results = jobs, results
        self.queue = Queue(self._is_open)
        #: Shapes without a result, by the key of the job.
        self.left: dict[str, set[str]] = {}
        #: Reasons why the first shapes are refused, "" for one that is not, by the key of the job.
        self.first: dict[str, list[str]] = {}
        #: Shapes that are refused for all methods, with the reason, by data set and input.
        self.lost = defaultdict[tuple[str, str], dict[str, str]](dict)
        #: Messages about them, by data set.
        self.announced = set[tuple[str, str]]()

    def records(self, workers: Any, watch: Callable[[Progress], object]) -> Iterator[tuple[Planned, Record]]:
        """Run the jobs."""
        self.queue.extend(self._tasks())
        total = self._n_left
        for planned in self.jobs.values():
            self._finish(planned)
        while self.jobs:
            for step, outcome in workers.poll(self.queue):
                if self._is_open(step):
                    yield from self._take(step, outcome)
            watch(Progress(total - self._n_left, total, workers.working))

    @property
    def _n_left(self) -> int:
        return sum(map(len, self.left.values()))

    def _is_open(self, step: Step) -> bool:
        """Return whether the outcome of a step is still wanted."""
        return step.job.key in self.jobs and (not step.shape or step.shape in self.left[step.job.key])

    def _tasks(self) -> list[Task]:
        """Return a task for each shape, plugin and seed, with the steps of all jobs that lack its files."""
        tasks = defaultdict[tuple[str, str, int, str], list[Step]](list)
        cache = Cache(self.results)
        for key, planned in self.jobs.items():
            job, steps = planned.job, planned.steps()
            missing = [step for step in steps if not cache.has(*[*step.keys.items()][-1])]
            self.left[key] = {step.shape for step in missing}
            self.first[key] = [] if missing == steps else [""]
            for step in missing:
                tasks[job.source, job.plugin, job.row.seed, step.shape].append(step)
        return [Task(tuple(steps)) for steps in tasks.values()]

    def _take(self, step: Step, outcome: Outcome) -> Iterator[tuple[Planned, Record]]:
        """Note an outcome; yield the job with its record if it has ended."""
        planned, first = self.jobs[step.job.key], self.first[step.job.key]
        if outcome.status == "stopped":
            raise BenchmarkError(outcome.reason)
        if outcome.status == "lost":
            self._lose(step, outcome.reason)
        elif not step.shape or outcome.status not in ("ok", "refused"):
            yield planned, self._end(planned, step.shape, outcome)
        else:
            first.append(outcome.reason)
            if len(first) == _ALIKE and set(first) == {outcome.reason} != {""}:
                alike = Outcome("failed", f"the first {_ALIKE} shapes are refused alike: {outcome.reason}")
                yield planned, self._end(planned, step.shape, alike)
            else:
                self._finish(planned, step.shape)

    def _finish(self, planned: Planned, shape: str = "") -> None:
        """Note that a job is done with a shape; rank its gallery after the last one."""
        left = self.left[planned.job.key]
        left.discard(shape)
        if not left:
            lost = self.lost[planned.job.source, planned.record.input]
            self.queue.append(Task((Step(planned.job),), planned.record, planned.steps(), lost))

    def _lose(self, step: Step, reason: str) -> None:
        """Refuse a shape for all jobs with its data and input."""
        file, _, problem = reason.partition(": ")
        is_file = mesh_suffix(Path(file)) in READABLE + EXTENSIONS  # its name when this content was first read
        message = step.job.source, f"{step.shape}: {problem if is_file else reason}"
        if message not in self.announced:
            self.announced.add(message)
            say(message[1], err=True)
        prepared_as = step.job.source, step.job.row.input
        self.lost[prepared_as][step.shape] = reason
        for key, other in self.jobs.items():
            if (other.job.source, other.record.input) == prepared_as and step.shape in self.left[key]:
                self._finish(other, step.shape)

    def _end(self, planned: Planned, shape: str, outcome: Outcome) -> Record:
        reason = f"{shape}: {outcome.reason}" if shape else outcome.reason
        content = msgspec.to_builtins(planned.record) | {
            "status": outcome.status,
            "finished": datetime.now(UTC).isoformat(timespec="milliseconds"),
            "commit": commit(),
            "packages": packages(),
            **(outcome.content or {"reason": reason, "traceback": outcome.traceback}),
        }
        record = msgspec.convert(content, Record)
        write_record(self.results, record, planned.replaces)
        del self.jobs[planned.job.key], self.left[planned.job.key]
        return record
