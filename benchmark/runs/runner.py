"""Run the jobs of a plan, and write a record for each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import msgspec

from benchmark.errors import FILE, BenchmarkError
from benchmark.kernel_cache import drop_stale_kernels
from benchmark.machine import memory_per_process
from benchmark.pipeline.cache import Cache, writing
from benchmark.pipeline.code_store import keep_definitions
from benchmark.pipeline.environment import commit, packages
from benchmark.pipeline.records import Record, record_of, write_record
from benchmark.runs.planning import Planned
from benchmark.runs.tasks import File, Outcome, Queue, Step, Task
from benchmark.runs.workers import Pool, Workers
from benchmark.text import say

#: Bytes of memory of the smallest process.
_SMALLEST = 2**29


class Progress(NamedTuple):
    """How far a run is: numbers of steps, and what the workers are doing."""

    done: int
    total: int
    working: Sequence[str] = ()


def run_jobs(
    planned: Sequence[Planned],
    results: Path,
    *,
    size: int = 1,
    timeout: float = 7200.0,
    dask: str = "",
    workers: Workers | None = None,
    anew: bool = False,
    watch: Callable[[Progress], object] = lambda _: None,
) -> Iterator[Record]:
    """Run the jobs of a plan that need it, and yield the record of each as it ends.

    Parameters
    ----------
    planned
        The plan.
    results
        The results folder, which no other run may be writing to.
    size
        Number of worker processes. Objects of a Python program run in this process.
    timeout
        Seconds that a method may take for a shape.
    dask
        Address of the scheduler of a dask cluster that does the work instead.
    workers
        Where the work is done, in place of ``size`` processes or a cluster. They are closed at the
        end.
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
        for of_shape in chain.from_iterable(job.steps() for job in pending.values() if anew):
            for step in of_shape:
                Cache(results).remove(*step.file)
        keep_definitions(results, [job.record.parts for job in pending.values()])
        drop_stale_kernels()
        workers = workers or start_workers(size, timeout, dask)
        try:
            yield from _Run(pending, results).records(workers, watch)
        finally:
            workers.close()


def result_of(job: Planned, ended: Mapping[str, Record]) -> Record | None:
    """Return the record of a job after a run, with those that ended in it by key; None for one that is unsupported."""
    if job.state == "unavailable":
        return msgspec.structs.replace(job.record, reason=job.reason)
    return None if job.state == "unsupported" else ended.get(job.record.key, job.before)


def with_results(
    records: Sequence[Record], planned: Iterable[Planned], ended: Mapping[str, Record]
) -> list[Record]:
    """Return records of before a run with those of its jobs in their place; a job that cannot run replaces none."""
    merged = {record.row: record for record in records}
    for job in planned:
        result = result_of(job, ended)
        if result is not None and (job.state != "unavailable" or result.row not in merged):
            merged.pop(result.row, None)
            merged[result.row] = result
    return [*merged.values()]


def start_workers(size: int, timeout: float, dask: str) -> Workers:
    """Return workers on this machine, as many as its memory allows, or those of a dask cluster."""
    if dask:
        from benchmark.runs.dask import DaskPool

        return DaskPool(dask, timeout)
    possible = max(1, min(size, memory_per_process() // _SMALLEST))
    if possible < size:
        say(
            f"only {possible} of {size} processes run at a time: there is no memory for more",
            err=True,
        )
    return Pool(possible, memory_per_process(possible), timeout)


class _Run:
    """Jobs under way, by key."""

    def __init__(self, jobs: dict[str, Planned], results: Path) -> None:
        self.jobs, self.results = jobs, results
        self.queue = Queue(self._is_open)
        #: Files that a job still lacks, by its key, and the keys of the jobs that lack a file.
        self.left = {key: set[File]() for key in jobs}
        self.lacking = defaultdict[File, list[str]](list)
        #: Files that are made from a file, and tasks that wait for it.
        self.following = defaultdict[File, dict[File, None]](dict)
        self.waiting = defaultdict[File, list[Task]](list)
        #: Why shapes remain without a result, by the key of the job.
        self.incomplete = defaultdict[str, list[str]](list)
        #: Files whose step is tried for the second time.
        self.retried = set[File]()
        #: Messages about shapes, by data set.
        self.announced = set[tuple[str, str]]()

    def records(self, workers: Workers, watch: Callable[[Progress], object]) -> Iterator[Record]:
        """Run the jobs."""
        yield from self._begin([*self.jobs])
        total = self._n_left
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
        return any(key in self.jobs for key in self._jobs_of(step))

    def _jobs_of(self, step: Step) -> list[str]:
        """Return the keys of the jobs that a step is done for."""
        return [step.job.key] if step.stage == "records" else self.lacking.get(step.file, [])

    def _begin(self, keys: Sequence[str], of: File | None = None) -> Iterator[Record]:
        """Queue the steps that make the missing files of jobs, or one file that is tried again, and those they need.

        Jobs that lack no file go on at once; see :meth:`_finish`.
        """
        exists, steps, needs = (
            cache(Cache(self.results).has),
            dict[File, Step](),
            dict[File, File | None](),
        )
        for key in keys:
            for of_shape in self.jobs[key].steps():
                made = [step.file for step in of_shape]
                n_steps = made.index(of) + 1 if of in made else 0 if of else len(made)
                for before, step in zip((None, *of_shape), of_shape[:n_steps], strict=False):
                    if step.file == of or not exists(*step.file):
                        self._need(step.file, key)
                        needs[step.file] = before.file if before and before.file in steps else None
                        steps[step.file] = step
                    if before:
                        self.following[before.file][step.file] = None
        tasks = defaultdict[tuple[object, ...], list[Step]](list)
        for file, step in steps.items():
            tasks[self._task_of(step, needs[file], steps)].append(step)
        for group in tasks.values():
            files = {step.file for step in group}
            needed = [need for step in group if (need := needs[step.file]) and need not in files]
            task = Task(tuple(group))
            if needed:
                self.waiting[needed[0]].append(task)
            else:
                self.queue.add(task)
        for key in keys:
            yield from self._finish(key)

    @staticmethod
    def _task_of(step: Step, need: File | None, steps: Mapping[File, Step]) -> tuple[object, ...]:
        """Return what tells apart the task of a step: a shape is loaded once, and methods share its geodesics."""
        if step.stage == "prepared":
            return step.job.source, step.job.data_root, step.source_shape or step.key
        if need and need[0] == "forms" and steps[need].process != step.process:
            return step.file
        return step.process, step.job.row.seed, step.keys["prepared"]

    def _need(self, file: File, key: str) -> None:
        """Note that a job lacks a file."""
        if file not in self.left[key]:
            self.left[key].add(file)
            self.lacking[file].append(key)

    def _take(self, step: Step, outcome: Outcome) -> Iterator[Record]:
        """Note an outcome; yield the records of the jobs that have ended."""
        if outcome.status == "stopped":
            raise BenchmarkError(outcome.reason)
        if outcome.status in ("incomplete", "crashed") and step.file not in self.retried:
            self.retried.add(step.file)
            keys = [key for key in self._jobs_of(step) if key in self.jobs]
            # A damaged file is no longer there.
            yield from self._begin(keys, None if step.stage == "records" else step.file)
        elif outcome.status == "incomplete":
            yield from self._leave(step, outcome)
        elif step.stage != "records" and outcome.status in ("ok", "refused"):
            if step.stage == "prepared" and outcome.status == "refused":
                self._announce(step, outcome.reason)
            yield from self._settle(step.file, is_made=outcome.status == "ok")
        else:
            for planned in [self.jobs[key] for key in self._jobs_of(step) if key in self.jobs]:
                yield self._end(planned, step.shape, outcome)

    def _settle(self, file: File, *, is_made: bool, reason: str = "") -> Iterator[Record]:
        """Note that a file is made, or will not be, nor those that are made from it; end jobs that lack no more."""
        files, ended = [file], dict[str, None]()
        for of_file in files:
            files += [] if is_made else self.following.pop(of_file, ())
            for key in filter(self.jobs.__contains__, self.lacking.pop(of_file, ())):
                self.left[key].discard(of_file)
                self.incomplete[key] += [reason] * bool(reason)
                ended[key] = None
        for task in self.waiting.pop(file, ()):  # which may have steps that need other files
            self.queue.add(task)
        for key in ended:
            yield from self._finish(key)

    def _finish(self, key: str) -> Iterator[Record]:
        """Rank the gallery of a job that lacks no file, or say what it lacks."""
        if self.left[key]:
            return
        planned = self.jobs[key]
        reason, *others = dict.fromkeys(self.incomplete[key]) or [""]
        if reason:
            more = f" (and {len(others)} more)" if others else ""
            yield self._end(planned, "", Outcome("incomplete", reason + more))
        else:
            self.queue.add(Task((planned.ranking(),), planned.record))

    def _leave(self, step: Step, outcome: Outcome) -> Iterator[Record]:
        """Leave jobs incomplete for a file, or for all files of its shape."""
        if step.stage == "prepared" or outcome.of_shape:
            self._announce(step, outcome.reason)
        if step.stage == "records":
            self.incomplete[step.job.key].append(outcome.reason)
            yield from self._finish(step.job.key)
            return
        file: File = ("prepared", step.keys["prepared"]) if outcome.of_shape else step.file
        yield from self._settle(file, is_made=False, reason=outcome.reason)

    def _announce(self, step: Step, reason: str) -> None:
        """Say once why a shape has no result."""
        file = self._file_of(step)
        text = f"{reason.replace(FILE, file.name)} ({file})" if file else reason
        message = step.job.source, text if text.startswith(step.shape) else f"{step.shape}: {text}"
        if message not in self.announced:
            self.announced.add(message)
            say(message[1], err=True)

    def _file_of(self, step: Step) -> Path | None:
        """Return the file of the shape of a step in its data set: another one may have the same content."""
        of_jobs = (self.jobs[key] for key in self._jobs_of(step) if key in self.jobs)
        name = step.source_shape or step.shape
        for planned in of_jobs:
            gallery = planned.galleries[0]
            shown = (gallery, gallery.gallery_of_queries or gallery)
            for job, side in zip(planned.sides, shown, strict=False):
                if job.source == step.job.source:
                    paths = (entry.path for entry in side.seen.entries if entry.identifier == name)
                    return next(paths, None)
        return None

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
        says_less = record.status == "incomplete" or (
            before is not None and before.key == record.key
        )
        if record.status == "ok" or before is None or before.status != "ok" or not says_less:
            write_record(self.results, record, before.key if before else "")
        del self.jobs[record.key], self.left[record.key]
        return record
