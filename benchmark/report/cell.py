"""One figure of a table before it is printed."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from benchmark.report.results import Result
from benchmark.storage.keys import digest

Figures = Mapping[str, float]


@dataclass(frozen=True)
class Cell:
    """What one method reached under one input.

    Parameters
    ----------
    status
        Status of the record, or ``"missing"`` without one.
    record
        The record of the job; empty without one. For the mean of several jobs, what they tell together.
    deviation
        Standard deviation (n - 1) by measure: of the galleries where there are several, else of the trainings; None
        for a single job.
    n_averaged, n_wanted
        Jobs that the scores are the mean of, and jobs that there should be.
    outdated
        What has changed since the job was done; "" if nothing has.
    records
        The records of all jobs with scores, which hold the measures of each query.
    """

    status: str = "missing"
    record: Mapping[str, Any] = field(default_factory=dict)
    deviation: Figures | None = None
    n_averaged: int = 0
    n_wanted: int = 1
    outdated: str = ""
    records: tuple[Mapping[str, Any], ...] = field(default=(), repr=False)

    @property
    def scores(self) -> Figures | None:
        """Scores by measure, or None when there are none."""
        return self.record.get("scores")

    @property
    def models(self) -> list[Mapping[str, Any]]:
        """Trained models behind the scores, each once; empty for a method that does not learn."""
        return list({model["digest"]: model for model in self.record.get("models", ())}.values())


def cell_of(results: Sequence[Result], n_wanted: int) -> Cell:
    """What one or several jobs reached: galleries of a table with folds, seeds of a training.

    Parameters
    ----------
    results
        One for each job that has a record.
    n_wanted
        Jobs that there should be.
    """
    done = [result for result in results if result.record.get("scores")]
    outdated = "; ".join(dict.fromkeys(result.outdated for result in done if result.outdated))
    if not done:
        record = results[0].record
        return Cell(record["status"], {"reason": record.get("reason", "")}, n_wanted=n_wanted)
    if n_wanted == 1 and len(done) == 1:
        return Cell("ok", done[0].record, n_averaged=1, outdated=outdated, records=(done[0].record,))
    records = [result.record for result in done]
    columns = _by_gallery(records)
    peaks = [record["peak_mib"] for record in records if record.get("peak_mib") is not None]
    told = [
        f"{result.record['gallery']}: {result.record.get('reason', result.record['status'])}"
        for result in results
        if result not in done
    ]
    merged = {
        "key": digest([record["key"] for record in records]),
        "reason": "; ".join(told) or "not run",
        "scores": {name: statistics.fmean(values) for name, values in columns.items()},
        "chance": {name: statistics.fmean(r["chance"][name] for r in records) for name in records[0]["chance"]},
        "n_shapes": len({shape for record in records for shape in record["shapes"]}),
        "n_classes": len({label for record in records for label in record["labels"]}),
        "unsupported": _each_once(shape for record in records for shape in record["unsupported"]),
        "cost": {"seconds_per_shape": _medians(records)},
        "peak_mib": max(peaks, default=None),
        "models": [model for record in records for model in record.get("models", ())],
        "seen": _each_once(shape for record in records for shape in record.get("seen", ())),
        "notes": records[0].get("notes", {}),
    }
    spread_over = columns if len(next(iter(columns.values()))) > 1 else _columns(records)
    deviation = {name: statistics.stdev(values) for name, values in spread_over.items()} if len(done) > 1 else None
    return Cell("ok", merged, deviation, len(done), max(n_wanted, len(done)), outdated, tuple(records))


def _by_gallery(records: Sequence[Mapping[str, Any]]) -> dict[str, list[float]]:
    """Scores of each gallery by measure, the mean over its trainings: galleries count alike however many they have."""
    galleries: dict[str, list[Mapping[str, Any]]] = {}
    for record in records:
        galleries.setdefault(record["gallery"], []).append(record)
    means = [{name: statistics.fmean(v) for name, v in _columns(found).items()} for found in galleries.values()]
    return {name: [each[name] for each in means] for name in means[0]}


def _columns(records: Sequence[Mapping[str, Any]]) -> dict[str, list[float]]:
    return {name: [record["scores"][name] for record in records] for name in records[0]["scores"]}


def _medians(records: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Seconds a shape by phase: the median over the jobs."""
    phases = dict.fromkeys(phase for record in records for phase in record["cost"]["seconds_per_shape"])
    return {
        phase: statistics.median(
            record["cost"]["seconds_per_shape"][phase]
            for record in records
            if phase in record["cost"]["seconds_per_shape"]
        )
        for phase in phases
    }


def _each_once(items: Any) -> list[Any]:
    found = []
    for item in items:
        if item not in found:
            found.append(item)
    return found
