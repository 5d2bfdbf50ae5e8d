"""Estimate the time of a plan from the seconds of finished jobs, published ones included."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmark.code_digest import ROOT
from benchmark.pipeline.records import Record, read_records
from benchmark.runs.planning import Planned

#: Timed stages of each file in the cache: prepared shape, form and signature.
STAGES = (("prepare", "geodesics"), ("canonicalise",), ("signature",))

#: Results folder of the checkout, whose published records know seconds of every method; an installed package has none.
SUITE_RESULTS = ROOT / "results"


@dataclass(frozen=True)
class Estimate:
    """Upper bound for the work of the jobs that a run would do, as if nothing were in the cache.

    Parameters
    ----------
    seconds
        Seconds on one core.
    unknown
        Number of jobs without an estimate, because no job of their method has finished anywhere.
    """

    seconds: float
    unknown: int


def estimate(planned: Sequence[Planned], results: Path, published: Path = SUITE_RESULTS) -> Estimate:
    """Estimate the work of a plan; a form that several galleries rank counts once.

    Seconds a shape are those of the same method and input on the same gallery, otherwise the median over other
    galleries, of the method with any parameters if need be. Jobs here count before published ones.
    """
    to_run = [job for job in planned if job.to_run]
    costs: dict[tuple[str, str], list[Record]] = {}
    for record in (*read_records(published, local=False), *read_records(results, published=False)) if to_run else ():
        for name in {record.method, _base(record.method)} if record.seconds else ():
            costs.setdefault((name, record.input), []).append(record)
    unknown, spent = 0, dict[str, float]()  # seconds of each file of the cache, which several jobs may take
    for job in to_run:
        phases = _seconds(job, costs)
        unknown += not phases
        for keys in job.keys:
            for key, stages in zip(keys, STAGES, strict=True):
                spent[key] = max(spent.get(key, 0.0), sum(phases.get(stage, 0.0) for stage in stages))
    return Estimate(sum(spent.values()), unknown)


def _seconds(job: Planned, costs: Mapping[tuple[str, str], list[Record]]) -> dict[str, float]:
    """Return seconds a shape by stage; empty if they are unknown."""
    method, input_ = job.job.method.name, job.job.input
    alike = costs.get((method, input_)) or costs.get((_base(method), input_), [])
    of_gallery = [record for record in alike if record.gallery == job.facts["gallery"]]
    timed = [record.seconds for record in of_gallery[-1:] or alike]
    return {phase: statistics.median(row.get(phase, 0.0) for row in timed) for phase in sorted(set().union(*timed))}


def _base(method: str) -> str:
    return method.partition("[")[0]
