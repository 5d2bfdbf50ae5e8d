"""Estimate the cost of a plan from the costs of finished jobs."""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmark.execution.job_specs import Job
from benchmark.pipeline.storage.records import Record
from benchmark.pipeline.storage.store import Store

#: Phases whose results all methods share; they count once per shape.
SHARED = ("prepare", "geodesics")

#: Number of files from which the mean size is estimated.
_SAMPLE = 500

#: Suffix of a method name that stands for any parameters.
_ANY = "[...]"


@dataclass(frozen=True)
class Estimate:
    """Upper bound for the cost of the jobs that a run would compute, ignoring stored stages.

    Parameters
    ----------
    seconds
        Computing time on one core.
    unknown
        Number of jobs without an estimate, because no job of their method and input has finished.
    mebibytes
        Disk space; None without jobs to run or stored files.
    """

    seconds: float
    unknown: int
    mebibytes: float | None

    def lines(self, n_jobs: int, workers: int) -> list[str]:
        """Describe the estimate, given the number of jobs to run and of workers."""
        if not n_jobs:
            return []
        lines = []
        if self.seconds or not self.unknown:
            shared = f", {_duration(self.seconds / workers)} with {workers} jobs at a time" if workers > 1 else ""
            lines.append(f"at most about {_duration(self.seconds)} of work{shared}, judging by finished jobs")
        if self.unknown:
            lines.append(f"{self.unknown} of them cannot be estimated: no job of their method has finished")
        room = "unknown before the first job" if self.mebibytes is None else f"about {self.mebibytes:.0f} MiB"
        return [*lines, f"disk: {room}"]


def estimate(jobs: Sequence[Job], store: Store) -> Estimate:
    """Estimate the cost of the jobs that a run of this plan would compute.

    Seconds per shape are those of the same method and input on the same gallery, otherwise the median over other
    galleries. Results shared by several methods count once.

    Parameters
    ----------
    jobs
        The plan.
    store
        Store of the records, and of the files used to estimate disk space.
    """
    to_run = list({job.key: job for job in jobs if job.to_run}.values())
    if not to_run:
        return Estimate(0.0, 0, None)
    costs: dict[tuple[str, str], list[Record]] = {}
    for record in (*store.published, *store.records):
        if "cost" in record:
            for name in {record["method"], record["method"].partition("[")[0] + _ANY}:
                costs.setdefault((name, record["input"]), []).append(record)
    seconds, unknown, n_forms = 0.0, 0, 0
    shared: dict[tuple[str, str, str], dict[str, float]] = {}
    for job in to_run:
        phases = _phases(job, costs)
        n_forms += len(job.identifiers)
        unknown += not phases
        seconds += len(job.identifiers) * sum(value for phase, value in phases.items() if phase not in SHARED)
        for identifier in job.identifiers:
            place = shared.setdefault((job.facts["data"]["name"], job.input, identifier), {})
            for phase in SHARED:
                place[phase] = max(place.get(phase, 0.0), phases.get(phase, 0.0))
    seconds += sum(sum(phases.values()) for phases in shared.values())
    sizes = [path.stat().st_size for path in itertools.islice(store.artefact_files(), _SAMPLE)]
    room = (n_forms + len(shared)) * statistics.fmean(sizes) / 2**20 if sizes else None
    return Estimate(seconds, unknown, room)


def _phases(job: Job, costs: Mapping[tuple[str, str], list[Record]]) -> Mapping[str, float]:
    """Return seconds per shape by phase: of the same gallery, otherwise the median over others; possibly empty."""
    alike = costs.get((job.method.name, job.input)) or costs.get((job.method.base_name + _ANY, job.input), [])
    of_gallery = [record for record in alike if record["gallery"] == job.gallery]
    timed = [record["cost"]["seconds_per_shape"] for record in of_gallery[-1:] or alike]
    return {phase: statistics.median(row.get(phase, 0.0) for row in timed) for phase in set().union(*timed)}


def _duration(seconds: float) -> str:
    """Format a time in a suitable unit."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"
