"""Run the jobs of a plan, and write a record for each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import NamedTuple

import msgspec

from benchmark.errors import FILE, BenchmarkError, ConfigurationError
from benchmark.kernel_cache import drop_stale_kernels
from benchmark.machine import memory_per_process
from benchmark.pipeline.cache import Cache, CachedFile, writing
from benchmark.pipeline.code_store import keep_definitions
from benchmark.pipeline.environment import commit, packages
from benchmark.pipeline.record_files import write_record
from benchmark.pipeline.records import Record, record_of
from benchmark.runs.open_jobs import OpenJobs
from benchmark.runs.planning import Planned
from benchmark.runs.tasks import Outcome, Queue, Step, Task
from benchmark.runs.unchanged import CodeChanged, SuiteFiles
from benchmark.runs.workers import Pool, Workers
from benchmark.text import say

#: Bytes of memory of the smallest worker process.
_SMALLEST_PROCESS = 2**29


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
        Whether to compute everything again, also what is in the cache.
    watch
        Called with the progress several times a second.

    Raises
    ------
    StorageError
        If the results folder cannot be written, or another run is writing to it.
    ConfigurationError
        If objects of a program should run on a cluster.
    KeyboardInterrupt
        If the run is interrupted; finished jobs and forms are kept.
    """
    pending = {job.record.key: job for job in planned if job.is_pending}
    if not pending:
        return
    if dask:
        _check_for_cluster(pending.values())
    with writing(results):
        if anew:
            _remove_files(pending.values(), results)
        keep_definitions(results, [job.record.parts for job in pending.values()])
        drop_stale_kernels()
        workers = workers or start_workers(size, timeout, dask)
        try:
            yield from _Run(pending, results).records(workers, watch)
        finally:
            workers.close()


def _check_for_cluster(jobs: Iterable[Planned]) -> None:
    """Raise ``ConfigurationError`` if a job can run in this process alone."""
    for job in jobs:
        for component in (job.job.method, job.job.scorer):
            if component.is_unknown:
                problem = f"'{component.name}' is an object of this program, not of a cluster"
                raise ConfigurationError(problem, "leave out dask, or pass it as a plugin file")


def _remove_files(jobs: Iterable[Planned], results: Path) -> None:
    """Remove the files of jobs from the cache."""
    cache_of_run = Cache(results)
    for job in jobs:
        for steps in job.steps():
            for step in steps:
                cache_of_run.remove(*step.file)


def result_of(job: Planned, ended: Mapping[str, Record]) -> Record | None:
    """Return the record of a job after a run; None for one that is unsupported.

    Parameters
    ----------
    job
        The job.
    ended
        Records of the jobs that ended in the run, by their keys.
    """
    if job.state == "unavailable":
        return msgspec.structs.replace(job.record, reason=job.reason)
    if job.state == "unsupported":
        return None
    return ended.get(job.record.key, job.before)


def with_results(
    records: Sequence[Record], planned: Iterable[Planned], ended: Mapping[str, Record]
) -> list[Record]:
    """Return records of before a run with those of its jobs in their place.

    A job that cannot run replaces no record. For ``ended``, see :func:`result_of`.
    """
    merged = {record.row: record for record in records}
    for job in planned:
        result = result_of(job, ended)
        if result is None or (job.state == "unavailable" and result.row in merged):
            continue
        merged.pop(result.row, None)  # new results stand last
        merged[result.row] = result
    return [*merged.values()]


def start_workers(size: int, timeout: float, dask: str) -> Workers:
    """Return workers on this machine, as many as its memory allows, or those of a dask cluster."""
    if dask:
        from benchmark.runs.dask import DaskPool

        return DaskPool(dask, timeout)
    possible = max(1, min(size, memory_per_process() // _SMALLEST_PROCESS))
    if possible < size:
        text = f"only {possible} of {size} processes run at a time: there is no memory for more"
        say(text, err=True)
    return Pool(possible, memory_per_process(possible), timeout)


class _MissingFile(NamedTuple):
    """A file that is to be made, and the last missing file that it is made from, if there is one.

    That may be a file of an earlier stage than the one before: a signature takes its form, and the
    surface of the prepared shape.
    """

    step: Step
    source: CachedFile | None


class _Run:
    """A run of jobs.

    Parameters
    ----------
    jobs
        The jobs by their keys.
    results
        The results folder.
    """

    def __init__(self, jobs: Mapping[str, Planned], results: Path) -> None:
        """Note the jobs; none of their steps is queued yet."""
        self._results = results
        self._open_jobs = OpenJobs(jobs)
        self._queue = Queue(self._open_jobs.is_wanted)
        self._suite = SuiteFiles()
        #: Tasks that wait for a file.
        self._blocked: defaultdict[CachedFile, list[Task]] = defaultdict(list)
        #: Files whose step is tried for the second time.
        self._retried: set[CachedFile] = set()
        #: Messages about shapes that were printed, with the data set.
        self._announced: set[tuple[str, str]] = set()

    def records(self, workers: Workers, watch: Callable[[Progress], object]) -> Iterator[Record]:
        """Run the jobs, and yield the record of each as it ends."""
        yield from self._begin([*self._open_jobs])
        total = self._open_jobs.n_missing
        while self._open_jobs:
            for step, outcome in workers.poll(self._queue):
                if self._open_jobs.is_wanted(step):
                    yield from self._take(step, outcome)
            n_missing = self._open_jobs.n_missing
            total = max(total, n_missing)  # a file that was there may be damaged
            watch(Progress(total - n_missing, total, workers.working))

    def _begin(
        self,
        jobs: Sequence[Planned],
        again: Collection[CachedFile] = (),
        only: CachedFile | None = None,
    ) -> Iterator[Record]:
        """Queue the steps that make the missing files of some jobs.

        Parameters
        ----------
        jobs
            The jobs.
        again
            Files that are made again although they are there, because they are damaged.
        only
            The only file that is to be made, with those that it is made from; None for all.

        Yields
        ------
        Record
            Records of the jobs that end at once.
        """
        has = cache(Cache(self._results).has)

        def exists(file: CachedFile) -> bool:
            """Return whether a file need not be made."""
            return file not in again and has(*file)

        missing: dict[CachedFile, _MissingFile] = {}
        for job in jobs:
            for steps in job.steps():  # of one view: prepared shape, form, signature
                self._note_missing(job, _steps_to_make(steps, only), exists, missing)
        self._add_tasks(missing)
        for job in jobs:
            yield from self._finish(job)

    def _note_missing(
        self,
        job: Planned,
        steps: Iterable[Step],
        exists: Callable[[CachedFile], bool],
        missing: dict[CachedFile, _MissingFile],
    ) -> None:
        """Find the missing files of one view of a shape, and add them to those of other views.

        Parameters
        ----------
        job
            The job that needs the files.
        steps
            The steps that make them. Each takes the file of the one before as its source.
        exists
            Returns whether a file is in the cache, and need not be made.
        missing
            Gets the missing files.
        """
        source: CachedFile | None = None
        last_missing: CachedFile | None = None
        for step in steps:
            if source:
                self._open_jobs.add_made_from(source, step.file)
            if not exists(step.file):
                self._open_jobs.add_missing(job, step.file)
                missing[step.file] = _MissingFile(step, last_missing)
                last_missing = step.file
            source = step.file

    def _add_tasks(self, missing: Mapping[CachedFile, _MissingFile]) -> None:
        """Divide the steps that make missing files into tasks, and queue those that can begin.

        A task is the work of one process. If it needs a file that another task makes, it waits for
        that.
        """
        groups: defaultdict[tuple[object, ...], list[CachedFile]] = defaultdict(list)
        for file in missing:
            groups[_group_of(file, missing)].append(file)
        for files in groups.values():
            task = Task(tuple(missing[file].step for file in files))
            sources = [missing[file].source for file in files]
            of_other_tasks = [source for source in sources if source and source not in files]
            if of_other_tasks:
                self._blocked[of_other_tasks[0]].append(task)
            else:
                self._queue.add(task)

    def _take(self, step: Step, outcome: Outcome) -> Iterator[Record]:
        """React to the outcome of a step, and yield the records of the jobs that end by it.

        Parameters
        ----------
        step
            A step that has ended.
        outcome
            How it ended: ``"ok"``, ``"refused"`` (the shape), ``"incomplete"`` (for a reason that
            may not occur again), ``"stopped"`` (the run), or as a method fails: ``"failed"``,
            ``"crashed"``, ``"timeout"``, ``"memory"``, ``"unsupported"``.

        Raises
        ------
        BenchmarkError
            If nothing more can run, as on a full disk.
        """
        if outcome.status == "stopped":
            raise BenchmarkError(outcome.reason)
        if outcome.status in ("failed", "crashed", "incomplete"):
            outcome = self._without_blame(outcome)
        if outcome.status in ("incomplete", "crashed") and step.file not in self._retried:
            yield from self._retry(step, outcome.damaged)  # once
        elif outcome.status == "incomplete":
            yield from self._give_up(step, outcome)
        elif step.stage == "records" or outcome.status not in ("ok", "refused"):
            # The ranking is done, or the method failed: this ends the job.
            for job in self._open_jobs.waiting_for(step):
                yield self._end(job, outcome, step.view)
        elif outcome.status == "ok":
            yield from self._release(step.file, self._open_jobs.mark_made(step.file))
        else:  # a refused shape scores 0, and its jobs go on without it
            if step.stage == "prepared":
                self._announce(step, outcome.reason)
            yield from self._release(step.file, self._open_jobs.mark_lost(step.file))

    def _without_blame(self, outcome: Outcome) -> Outcome:
        """Return a failure; one that leaves its jobs incomplete if the suite was edited meanwhile.

        A process that started later then holds other code than this one.
        """
        try:
            self._suite.check()
        except CodeChanged as error:
            return outcome._replace(status="incomplete", reason=str(error), traceback="")
        return outcome

    def _retry(self, step: Step, damaged: Collection[CachedFile]) -> Iterator[Record]:
        """Try a step for the second time, after those that make the damaged files that it needs."""
        self._retried.add(step.file)
        jobs = self._open_jobs.waiting_for(step)
        if step.stage == "records":  # a file of the gallery was damaged
            yield from self._begin(jobs, damaged)
        else:
            yield from self._begin(jobs, [step.file, *damaged], step.file)

    def _give_up(self, step: Step, outcome: Outcome) -> Iterator[Record]:
        """Do without the result of a step that was tried twice; jobs that need it stay incomplete.

        Parameters
        ----------
        step
            The step.
        outcome
            Why it has no result. With ``of_shape``, the geodesics of the shape cannot be computed,
            so that no other method that needs them has a result of this shape either.
        """
        if step.stage == "prepared" or outcome.of_shape:
            self._announce(step, outcome.reason)
        if step.stage == "records":  # the ranking of a job
            for job in self._open_jobs.waiting_for(step):
                self._open_jobs.add_reason(job, outcome.reason)
                yield from self._finish(job)
            return
        lost = [step.file]
        if outcome.of_shape:
            lost += self._forms_by_geodesics(step.keys["prepared"])
        for file in dict.fromkeys(lost):
            yield from self._release(file, self._open_jobs.mark_lost(file, outcome.reason))

    def _forms_by_geodesics(self, prepared_key: str) -> list[CachedFile]:
        """Return the missing forms of a shape by methods that declare to need its geodesics.

        Parameters
        ----------
        prepared_key
            Key of the prepared shape.
        """
        forms: list[CachedFile] = []
        for job in self._open_jobs:
            if "pairs" not in job.job.method.info.needs:
                continue
            for side in job.record.sides:
                keys = zip(side.files["prepared"], side.files["forms"], strict=True)
                forms += [CachedFile("forms", form) for key, form in keys if key == prepared_key]
        return [form for form in forms if self._open_jobs.is_missing(form)]

    def _release(self, file: CachedFile, jobs: Iterable[Planned]) -> Iterator[Record]:
        """Queue the tasks that waited for a file; go on with jobs that waited for it."""
        for task in self._blocked.pop(file, ()):  # other steps of it may not need the file
            self._queue.add(task)
        for job in jobs:
            yield from self._finish(job)

    def _finish(self, job: Planned) -> Iterator[Record]:
        """Queue the ranking of a job that is ready; yield the record of an incomplete one."""
        state = self._open_jobs.state(job)
        if state == "ready":
            self._queue.add(Task((job.ranking(),), job.record))
        elif state == "incomplete":
            yield self._end(job, Outcome("incomplete", self._open_jobs.reason(job)))

    def _announce(self, step: Step, reason: str) -> None:
        """Say once why a shape has no result."""
        file = self._file_of_shape(step)
        if file:
            reason = f"{reason.replace(FILE, file.name)} ({file})"
        if not reason.startswith(step.view):
            reason = f"{step.view}: {reason}"
        message = step.source.name, reason
        if message not in self._announced:
            self._announced.add(message)
            say(reason, err=True)

    def _file_of_shape(self, step: Step) -> Path | None:
        """Return the file of the shape of a step; None if it has none.

        It is looked up in the data set of the step: another one may hold the same content.
        """
        for job in self._open_jobs.waiting_for(step):
            for side in job.sides:
                if side.source != step.source:
                    continue
                for entry in side.gallery.entries:
                    if entry.identifier == step.shape:
                        return entry.path
        return None

    def _end(self, job: Planned, outcome: Outcome, view: str = "") -> Record:
        """Return the record of a job that has ended, and write it into the results folder.

        It is not written over a record that says more, such as that of an earlier success.

        Parameters
        ----------
        job, outcome
            The job, and how it ended.
        view
            Name of the shape or view whose step failed; "" if it was the ranking of all.
        """
        content = msgspec.to_builtins(job.record)
        content["status"] = outcome.status
        content["finished"] = datetime.now(UTC).isoformat(timespec="milliseconds")
        content["commit"] = commit()
        content["packages"] = packages()
        if outcome.content:
            content |= outcome.content
        else:
            content["reason"] = f"{view}: {outcome.reason}" if view else outcome.reason
            content["traceback"] = outcome.traceback
        record = record_of(content)
        if _is_news(record, job.before):
            replaced_key = job.before.key if job.before else ""
            write_record(self._results, record, replaced_key)
        self._open_jobs.close(job)
        return record


def _is_news(record: Record, before: Record | None) -> bool:
    """Return whether a record is written in place of the one before: no result goes for less."""
    if before is None or before.status != "ok" or record.status == "ok":
        return True
    return record.status != "incomplete" and before.key != record.key


def _steps_to_make(steps: Sequence[Step], file: CachedFile | None) -> Sequence[Step]:
    """Return the steps of a shape up to the one that makes a file; all if no file is named."""
    if file is None:
        return steps
    for number, step in enumerate(steps, start=1):
        if step.file == file:
            return steps[:number]
    return ()


def _group_of(file: CachedFile, missing: Mapping[CachedFile, _MissingFile]) -> tuple[object, ...]:
    """Return what the steps of one task share.

    A shape is loaded once for all its files, and methods share its geodesics.
    """
    step, source = missing[file]
    if step.stage == "prepared":
        return step.source.name, step.source.data_root, step.shape or step.key
    if source is not None and source.stage == "forms":
        maker = missing[source].step.process
        if maker != step.process:  # the signature of a form that another process makes
            return step.file
    return step.process, step.job.row.seed, step.keys["prepared"]
