"""Rows of an ablation: what several trainings, or several folds, of one learner reached on average."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from benchmark.jobs.plan import Job
from benchmark.methods.registry import MethodSpec
from benchmark.report.cell import Cell
from benchmark.storage.keys import digest

SEED = "training_seed"


def row_of(spec: MethodSpec) -> MethodSpec:
    """The method whose row a training belongs to: the same one, whatever its seed."""
    return spec.without_parameter(SEED)


def averaged(jobs: Sequence[Job], records: Sequence[Mapping[str, Any]]) -> Cell:
    """Mean over the jobs of one row that have scores, with the standard deviation of one from another.

    Parameters
    ----------
    jobs
        Trainings or folds of one method.
    records
        The record of each job, or the reason why there is none.
    """
    done = [record for record in records if record.get("scores")]
    told = [
        f"{job.name.removesuffix(job.method.name)}{_seed(job)}: {record.get('reason', job.state)}"
        for job, record in zip(jobs, records, strict=True)
        if record not in done
    ]
    if not done:
        return Cell(str(records[0].get("status", jobs[0].state)), {"reason": told[0]}, n_averaged=0, n_wanted=len(jobs))
    names = done[0]["scores"].keys()
    columns = {name: [record["scores"][name] for record in done] for name in names}
    merged = {
        "key": digest([record["key"] for record in done]),
        "status": "ok",
        "reason": "; ".join(told),
        "scores": {name: statistics.fmean(values) for name, values in columns.items()},
        "chance": {name: statistics.fmean(record["chance"][name] for record in done) for name in done[0]["chance"]},
        "n_shapes": len({shape for record in done for shape in record["shapes"]}),
        "n_classes": len({label for record in done for label in record["labels"]}),
        "unsupported": [shape for record in done for shape in record["unsupported"]],
        "phase_seconds": {"all": sum(sum(record["phase_seconds"].values()) for record in done)},
        "peak_mib": max(record["peak_mib"] for record in done),
        "models": [model for record in done for model in record.get("models", ())],
    }
    spread = {name: statistics.stdev(values) for name, values in columns.items()} if len(done) > 1 else None
    return Cell("ok", merged, spread, len(done), len(jobs))


def _seed(job: Job) -> str:
    return f"training seed {job.method.parameters.get(SEED, 0)}"
