"""Results of one method under one input, over all galleries and trainings of a table."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from benchmark.pipeline.storage.records import chance_of, coverage_of
from benchmark.report.results import Result
from benchmark.report.significance import UNIT, queries_of

if TYPE_CHECKING:
    from pandas import DataFrame

Figures = Mapping[str, float]


@dataclass(frozen=True)
class Cell:
    """Results of one method under one input.

    Parameters
    ----------
    status
        Status of the record, or ``"missing"`` without one.
    record
        The record of the job; empty without one. For the mean of several jobs, what they say together.
    deviation
        Standard deviation (n - 1) by measure: of the galleries where there are several, else of the trainings; None
        for a single job.
    n_averaged, n_wanted
        Jobs that the scores are the mean of, and jobs that there should be.
    origin
        Where the scores were made: ``"here"``, ``"published"``, or both for a mean over jobs of both.
    outdated
        What has changed since the job was done; "" if nothing has.
    records
        The records of all jobs with scores, which hold the measures of each query.
    repeats
        Scores of the whole row by each of its jittered preparations, where there are at least two.
    """

    status: str = "missing"
    record: Mapping[str, Any] = field(default_factory=dict)
    deviation: Figures | None = None
    n_averaged: int = 0
    n_wanted: int = 1
    outdated: str = ""
    origin: str = ""
    records: tuple[Mapping[str, Any], ...] = field(default=(), repr=False)
    repeats: tuple[Figures, ...] = field(default=(), repr=False)

    @property
    def scores(self) -> Figures | None:
        """Scores by measure, or None when there are none."""
        return self.record.get("scores")

    @property
    def coverage(self) -> float:
        """Share of the shapes that could be had of which there is a result; 0 without scores."""
        return coverage_of(self.record)

    @property
    def is_complete(self) -> bool:
        """Return whether there is a result of every shape, so that the figure may be called the best."""
        return self.scores is not None and self.coverage >= 1

    @property
    def is_partial(self) -> bool:
        """Return whether there are scores, but not of all shapes."""
        return self.scores is not None and not self.is_complete

    @property
    def preparation_sd(self) -> Figures | None:
        """Standard deviation (n - 1) of the jittered preparations by measure; None without them."""
        if not self.repeats:
            return None
        return {name: statistics.stdev(scores[name] for scores in self.repeats) for name in self.repeats[0]}

    @cached_property
    def queries(self) -> DataFrame:
        """Measures of each query, see :func:`benchmark.report.significance.queries_of`."""
        return queries_of(self.records)

    @property
    def n_queries(self) -> int:
        """Queries behind the scores, those of all jobs."""
        return sum(value is not None for record in self.records for value in record["per_query"]["NN"])

    @property
    def n_tied(self) -> int:
        """Queries whose first rank relevant results share with others, so that their NN is a mean over orders."""
        return sum(_n_tied(record) for record in self.records if record.get("tied_queries"))

    @property
    def seconds(self) -> float | None:
        """Seconds a shape, all phases together; None where none was timed."""
        phases = self.record.get("cost", {}).get("seconds_per_shape", {})
        return sum(phases.values()) if phases else None

    @property
    def models(self) -> list[Mapping[str, Any]]:
        """Trained models behind the scores, each once; empty for a method that does not learn."""
        return list({model["digest"]: model for model in self.record.get("models", ())}.values())


def _n_tied(record: Mapping[str, Any]) -> int:
    """Queries whose first rank is relevant in no whole number of the scorer's draws."""
    draws = len((record["recipe"].get("scorer") or {}).get("codebooks", (0,)))
    hits = [value * draws for value in record["per_query"]["NN"] if value is not None]
    return sum(abs(count - round(count)) > draws * UNIT for count in hits)


def cell_of(results: Sequence[Result], n_galleries: int) -> Cell:
    """Return what one or several jobs reached: galleries of a table with folds, seeds of a training.

    A gallery or a training without a result counts 0, so that a crash in a hard one does not pay.

    Parameters
    ----------
    results
        One for each job that has a record.
    n_galleries
        Galleries that there should be.
    """
    cell = _cell(results, n_galleries)
    numbers = sorted(set(results[0].repeats).intersection(*(result.repeats for result in results)))
    again = [_cell([Result(result.repeats[number]) for result in results], n_galleries).scores for number in numbers]
    repeats = tuple(scores for scores in again if scores is not None)
    return replace(cell, repeats=repeats) if len(repeats) > 1 else cell


def _cell(results: Sequence[Result], n_galleries: int) -> Cell:
    done = [result for result in results if result.record.get("scores")]
    galleries: dict[str, list[Mapping[str, Any]]] = {}
    for result in results:
        galleries.setdefault(result.record["gallery"], []).append(result.record)
    n_missing = max(n_galleries - len(galleries), 0)
    n_wanted = len(results) + n_missing
    if not done:
        first = results[0].record
        return Cell(first["status"], {"reason": first.get("reason", "")}, n_wanted=n_wanted)
    records = [result.record for result in done]
    cell = Cell(
        "ok",
        records[0],
        n_averaged=len(done),
        n_wanted=n_wanted,
        outdated="; ".join(dict.fromkeys(result.outdated for result in done if result.outdated)),
        origin=" and ".join(sorted({result.origin for result in done} - {""})),
        records=tuple(records),
    )
    if n_wanted == 1:
        return cell
    names = [*records[0]["scores"], "coverage"]
    means = [_means(of_gallery, names) for of_gallery in galleries.values()] + [dict.fromkeys(names, 0.0)] * n_missing
    columns = means if len(means) > 1 else [record["scores"] for record in records]
    spread = {name: statistics.stdev(scores[name] for scores in columns) for name in names[:-1]}
    failures = [
        f"{result.record['gallery']}: {result.record.get('reason', result.record['status'])}"
        for result in results
        if result not in done
    ]
    *scores, coverage = ((name, statistics.fmean(of_gallery[name] for of_gallery in means)) for name in names)
    summary = {
        "reason": "; ".join(failures) or "not run",
        "scores": dict(scores),
        "coverage": coverage[1],
        "chance": _means([{"scores": chance_of(record)} for record in records], [*chance_of(records[0])]),
        "n_shapes": len({shape for record in records for shape in record["shapes"]}),
        "n_classes": len({label for record in records for label in record["labels"]}),
        "unsupported": [*dict.fromkeys(tuple(refused) for record in records for refused in record["unsupported"])],
        "cost": {"seconds_per_shape": _medians([record["cost"]["seconds_per_shape"] for record in records])},
        "peak_mib": max((peak for record in records if (peak := record.get("peak_mib")) is not None), default=None),
        "models": [model for record in records for model in record.get("models", ())],
        "seen": [*dict.fromkeys(shape for record in records for shape in record.get("seen", ()))],
        "notes": records[0].get("notes", {}),
    }
    return replace(cell, record=summary, deviation=spread)


def _means(records: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, float]:
    """Scores of a gallery, and its coverage: means over its trainings, so that galleries count alike."""
    columns = [{"coverage": coverage_of(record)} | record.get("scores", {}) for record in records]
    return {name: statistics.fmean(scores.get(name, 0.0) for scores in columns) for name in names}


def _medians(costs: Sequence[Figures]) -> dict[str, float]:
    """Seconds a shape by phase: the median over the jobs."""
    phases = dict.fromkeys(phase for cost in costs for phase in cost)
    return {phase: statistics.median(cost[phase] for cost in costs if phase in cost) for phase in phases}
