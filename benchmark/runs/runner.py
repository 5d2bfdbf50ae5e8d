"""Run the jobs of a plan, and write a record for each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import chain
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
from benchmark.pipeline.records import Record, record_of, write_record
from benchmark.runs.planning import Planned
from benchmark.runs.tasks import Outcome, Queue, Step, Task
from benchmark.runs.workers import Pool
from benchmark.text import say

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
    anew: bool = False,
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
    anew
        Whether to compute everything although it is in the cache.
    watch
        Called several times a second.

    Raises
    ------
    StorageError
        If the results folder cannot be written, or another run is writing to it.
    KeyboardInterrupt
        If the run is interrupted; finished jobs and forms are kept.
    """
    pending = {job.record.key: job for job in planned if job.is_pending}
    if not pending:
        return
    with writing(results):
        for step in chain.from_iterable(job.steps() for job in pending.values() if anew):
            for kind, key in step.keys.items():
                Cache(results).remove(kind, key)
        drop_stale_kernels()
        workers = _workers(size, timeout, dask)
        try:
            yield from _Run(pending, results).records(workers, watch)
        finally:
            workers.close()


def result_of(job: Planned, ended: Mapping[str, Record]) -> Record | None:
    """Return the record of a job after a run, with those that ended in it by key; None for one that is unsupported."""
    if job.state == "unavailable":
        return msgspec.structs.replace(job.record, reason=job.reason)
    return None if job.state == "unsupported" else ended.get(job.record.key, job.before)


def with_results(records: Sequence[Record], planned: Iterable[Planned], ended: Mapping[str, Record]) -> list[Record]:
    """Return records of before a run with those of its jobs in their place; a job that cannot run replaces none."""
    merged = [*records]
    for job in planned:
        result = result_of(job, ended)
        if result is not None:
            others = [other for other in merged if other.row != result.row]
            if len(others) == len(merged) or job.state != "unavailable":
                merged = [*others, result]
    return merged


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
        #: Places of steps without a result yet, by the key of the job.
        self.left: dict[str, set[tuple[object, ...]]] = {}
        #: Why shapes remain without one, by the key of the job.
        self.incomplete = defaultdict[str, list[str]](list)
        #: Steps, and shapes of a data set, that are tried for the second time.
        self.retried = set[tuple[str, str, str]]()
        #: Messages about shapes, by data set.
        self.announced = set[tuple[str, str]]()

    def records(self, workers: Any, watch: Callable[[Progress], object]) -> Iterator[tuple[Planned, Record]]:
        """Run the jobs."""
        self.queue.extend(self._tasks())
        total = self._n_left
        for planned in [*self.jobs.values()]:
            yield from self._finish(planned)
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
        return step.job.key in self.jobs and (not step.shape or step.place in self.left[step.job.key])

    def _tasks(self) -> list[Task]:
        """Return a task for each shape, plugin and seed, with the steps of all jobs that lack its files."""
        tasks = defaultdict[tuple[str, str, int, str], list[Step]](list)
        cache = Cache(self.results)
        for key, planned in self.jobs.items():
            job = planned.job
            missing = [step for step in planned.steps() if not cache.has(*[*step.keys.items()][-1])]
            self.left[key] = {step.place for step in missing}
            for step in missing:
                tasks[step.job.source, job.plugin, job.row.seed, step.shape].append(step)
        return [Task(tuple(steps)) for steps in tasks.values()]

    def _take(self, step: Step, outcome: Outcome) -> Iterator[tuple[Planned, Record]]:
        """Note an outcome; yield the jobs with their records that have ended."""
        planned = self.jobs[step.job.key]
        if outcome.status == "stopped":
            raise BenchmarkError(outcome.reason)
        if outcome.status in ("incomplete", "crashed") and outcome.scope != "job" and self._is_first_try(step, outcome):
            self.queue.appendleft(Task((step,)) if step.shape else self._ranking(planned))
        elif outcome.status == "incomplete":
            yield from self._leave(step, outcome)
        elif step.shape and outcome.status in ("ok", "refused"):
            if outcome.scope == "shape":
                self._announce(step, outcome.reason)
            yield from self._finish(planned, step)
        else:
            yield planned, self._end(planned, step.shape, outcome)

    def _is_first_try(self, step: Step, outcome: Outcome) -> bool:
        """Return whether a step, or its shape if that has no result for any job, has not been tried again before."""
        job, is_for_all = step.job, outcome.scope == "shape"
        tried = (job.source if is_for_all else job.key, job.row.input, step.shape)
        is_first = tried not in self.retried
        self.retried.add(tried)
        return is_first

    def _finish(self, planned: Planned, step: Step | None = None) -> Iterator[tuple[Planned, Record]]:
        """Note that a job is done with a step; after the last one, rank its gallery or say what it lacks."""
        left = self.left[planned.job.key]
        left -= {step.place} if step else set()
        if left:
            return
        reason, *others = dict.fromkeys(self.incomplete[planned.job.key]) or [""]
        if reason:
            more = f" (and {len(others)} more)" if others else ""
            yield planned, self._end(planned, "", Outcome("incomplete", reason + more))
        else:
            self.queue.append(self._ranking(planned))

    def _ranking(self, planned: Planned) -> Task:
        return Task((Step(planned.job),), planned.record, planned.steps())

    def _leave(self, step: Step, outcome: Outcome) -> Iterator[tuple[Planned, Record]]:
        """Leave a job incomplete at a shape, or all jobs at a shape of a data set, or the whole job."""
        if outcome.scope == "shape":
            self._announce(step, outcome.reason)
        if outcome.scope == "job" or not step.shape:
            self.left[step.job.key].clear()
        for key, planned in [*self.jobs.items()]:
            if key == step.job.key or (outcome.scope == "shape" and step.place in self.left[key]):
                self.incomplete[key].append(outcome.reason)
                yield from self._finish(planned, step)

    def _announce(self, step: Step, reason: str) -> None:
        """Say once why a shape has no result."""
        file, _, problem = reason.partition(": ")
        is_file = mesh_suffix(Path(file)) in READABLE + EXTENSIONS  # its name when this content was first read
        text = problem if is_file else reason
        message = step.job.source, text if text.startswith(step.shape) else f"{step.shape}: {text}"
        if message not in self.announced:
            self.announced.add(message)
            say(message[1], err=True)

    def _end(self, planned: Planned, shape: str, outcome: Outcome) -> Record:
        """Return the record of a job; write it unless it says less than the one that it would replace."""
        reason = f"{shape}: {outcome.reason}" if shape else outcome.reason
        content = msgspec.to_builtins(planned.record) | {
            "status": outcome.status,
            "finished": datetime.now(UTC).isoformat(timespec="milliseconds"),
            "commit": commit(),
            "packages": packages(),
            **(outcome.content or {"reason": reason, "traceback": outcome.traceback}),
        }
        record, before = record_of(content), planned.before
        says_less = record.status == "incomplete" or (before is not None and before.key == record.key)
        if record.status == "ok" or before is None or before.status != "ok" or not says_less:
            write_record(self.results, record, before.key if before else "")
        del self.jobs[planned.job.key], self.left[planned.job.key]
        return record
