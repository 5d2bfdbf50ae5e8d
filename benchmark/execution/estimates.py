"""Cost of a plan, by the costs of finished jobs."""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmark.execution.job_specs import Job
from benchmark.pipeline.storage.records import Record
from benchmark.pipeline.storage.store import Store

#: Phases that all methods of a shape share: one pays for them.
SHARED = ("prepare", "geodesics")

#: Files whose mean size stands for that of all.
_SAMPLE = 500

#: Stands behind the name of a method for whatever parameters it has.
_ANY = "[...]"


@dataclass(frozen=True)
class Estimate:
    """Cost of the jobs of a plan that are to run, if none of their stages were done already.

    Parameters
    ----------
    seconds
        Of work, on one core.
    unknown
        Jobs whose method never finished under their input, so that nobody can tell.
    mebibytes
        Of what stays on the disk; None where nothing is there to measure.
    """

    seconds: float
    unknown: int
    mebibytes: float | None

    def lines(self, n_jobs: int, workers: int) -> list[str]:
        """In words, for a plan with so many jobs to run."""
        if not n_jobs:
            return []
        lines = []
        if self.seconds or not self.unknown:
            shared = f", {_duration(self.seconds / workers)} with {workers} jobs at a time" if workers > 1 else ""
            lines.append(f"at most about {_duration(self.seconds)} of work{shared}, by the costs of finished jobs")
        if self.unknown:
            lines.append(f"{self.unknown} of them cannot be estimated: no job of their method has finished")
        room = "unknown before the first job here" if self.mebibytes is None else f"about {self.mebibytes:.0f} MiB"
        return [*lines, f"disk: {room}"]


def estimate(jobs: Sequence[Job], store: Store) -> Estimate:
    """Estimate the jobs of a plan that are to run.

    Seconds a shape are those of the same method and input on the same gallery, else the median over other galleries;
    what the methods of a shape share counts once.

    Parameters
    ----------
    jobs
        The plan.
    store
        Holds the records, and the files whose size tells that of others.
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
    """Seconds a shape by phase: of the gallery itself, else the median over others; empty if there are none."""
    alike = costs.get((job.method.name, job.input)) or costs.get((job.method.base_name + _ANY, job.input), [])
    here = [record for record in alike if record["gallery"] == job.gallery]
    timed = [record["cost"]["seconds_per_shape"] for record in here[-1:] or alike]
    return {phase: statistics.median(row.get(phase, 0.0) for row in timed) for phase in set().union(*timed)}


def _duration(seconds: float) -> str:
    """A time in the unit that suits it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"
