"""Which jobs of a run have no record yet, and which files of the cache they wait for."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import Literal

from benchmark.pipeline.cache import CachedFile
from benchmark.runs.planning import Planned
from benchmark.runs.tasks import Step

JobState = Literal["waiting", "ready", "incomplete"]


class OpenJobs:
    """The jobs of a run that have no record yet.

    A file of the cache that jobs need is *missing* until it is settled: it was made, or it will
    not be, and neither will the files that are made from it. While a job lacks a missing file, it
    is *waiting*. Then it is *ready* to be ranked, or *incomplete* if a shape has no result for a
    reason that is not in its content. A job whose record is written is closed.

    Parameters
    ----------
    jobs
        The jobs of the run by their keys.
    """

    def __init__(self, jobs: Mapping[str, Planned]) -> None:
        self._jobs = dict(jobs)
        self._missing_of_job: dict[str, set[CachedFile]] = {key: set() for key in jobs}
        self._jobs_of_missing: defaultdict[CachedFile, list[str]] = defaultdict(list)
        self._made_from: defaultdict[CachedFile, dict[CachedFile, None]] = defaultdict(dict)
        self._reasons: defaultdict[str, dict[str, None]] = defaultdict(dict)

    def __len__(self) -> int:
        return len(self._jobs)

    def __iter__(self) -> Iterator[Planned]:
        return iter([*self._jobs.values()])

    @property
    def n_missing(self) -> int:
        """How many files the jobs lack; one that several jobs lack counts for each."""
        return sum(map(len, self._missing_of_job.values()))

    def waiting_for(self, step: Step) -> list[Planned]:
        """Return the open jobs that a step is done for."""
        keys = self._jobs_of_missing.get(step.file, [])
        if step.stage == "records":
            keys = [step.job.key]
        return [self._jobs[key] for key in keys if key in self._jobs]

    def is_wanted(self, step: Step) -> bool:
        """Return whether a job still waits for the outcome of a step."""
        return bool(self.waiting_for(step))

    def is_missing(self, file: CachedFile) -> bool:
        """Return whether a file is missing and not settled yet."""
        return file in self._jobs_of_missing

    def add_missing(self, job: Planned, file: CachedFile) -> None:
        """Note that a job lacks a file."""
        key = job.record.key
        if file not in self._missing_of_job[key]:
            self._missing_of_job[key].add(file)
            self._jobs_of_missing[file].append(key)

    def add_made_from(self, source: CachedFile, file: CachedFile) -> None:
        """Note that a file is made from another one."""
        self._made_from[source][file] = None

    def add_reason(self, job: Planned, reason: str) -> None:
        """Note why a shape of a job remains without a result."""
        self._reasons[job.record.key][reason] = None

    def mark_made(self, file: CachedFile) -> list[Planned]:
        """Settle a file that was made; return the jobs that waited for it."""
        return self._settle([file])

    def mark_lost(self, file: CachedFile, reason: str = "") -> list[Planned]:
        """Settle a file that will not be made, and all that would be made from it.

        Parameters
        ----------
        file
            The file.
        reason
            Why its jobs remain incomplete; "" for a shape that is refused, whose jobs do not.

        Returns
        -------
        list of Planned
            The jobs that waited for one of these files.
        """
        jobs = self._settle([file, *self._files_made_from(file)])
        if reason:
            for job in jobs:
                self.add_reason(job, reason)
        return jobs

    def _settle(self, files: Iterable[CachedFile]) -> list[Planned]:
        """Note that files are missing no more; return the open jobs that lacked one of them."""
        keys: dict[str, None] = {}
        for file in files:
            for key in self._jobs_of_missing.pop(file, ()):
                if key in self._jobs:
                    self._missing_of_job[key].discard(file)
                    keys[key] = None
        return [self._jobs[key] for key in keys]

    def _files_made_from(self, file: CachedFile) -> Iterator[CachedFile]:
        """Yield the files that are made from a file, directly or not."""
        for following in self._made_from.pop(file, ()):
            yield following
            yield from self._files_made_from(following)

    def state(self, job: Planned) -> JobState:
        """Return the state of an open job."""
        key = job.record.key
        if self._missing_of_job[key]:
            return "waiting"
        return "incomplete" if self._reasons[key] else "ready"

    def reason(self, job: Planned) -> str:
        """Return why an incomplete job is so: the first reason, and how many there are besides."""
        first, *others = self._reasons[job.record.key]
        return f"{first} (and {len(others)} more)" if others else first

    def close(self, job: Planned) -> None:
        """Note that the record of a job is written."""
        del self._jobs[job.record.key]
        del self._missing_of_job[job.record.key]
