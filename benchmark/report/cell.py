"""One figure of a table before it is printed."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.records import chance_of, coverage_of
from benchmark.report.results import Result
from benchmark.report.statistics.queries import UNIT

Figures = Mapping[str, float]


@dataclass(frozen=True)
class Cell:
    """Results of one method under one input.

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
    def preparation_sd(self) -> Figures | None:
        """Standard deviation (n - 1) of the jittered preparations by measure; None without them."""
        if not self.repeats:
            return None
        return {name: statistics.stdev(scores[name] for scores in self.repeats) for name in self.repeats[0]}

    @property
    def coverage(self) -> float:
        """Share of the shapes that could be had of which there is a result; 0 without scores."""
        return coverage_of(self.record)

    @property
    def n_queries(self) -> int:
        """Queries behind the scores, those of all jobs."""
        return sum(len(_first_ranks(record)) for record in self.records)

    @property
    def n_tied(self) -> int:
        """Queries whose first rank relevant results share with others, so that their NN is a mean over orders."""
        return sum(
            abs(hits - round(hits)) > len(_draws(record)) * UNIT
            for record in self.records
            if record.get("tied_queries")
            for hits in _first_ranks(record)
        )

    @property
    def is_partial(self) -> bool:
        """Return whether there are scores, but not of all shapes."""
        return self.scores is not None and not self.is_complete

    @property
    def is_complete(self) -> bool:
        """Return whether there is a result of every shape, so that the figure may be called the best."""
        return self.scores is not None and self.coverage >= 1

    @property
    def scores(self) -> Figures | None:
        """Scores by measure, or None when there are none."""
        return self.record.get("scores")

    @property
    def seconds(self) -> float | None:
        """Seconds a shape, all phases together; None where none was timed."""
        phases = self.record.get("cost", {}).get("seconds_per_shape", {})
        return sum(phases.values()) if phases else None

    @property
    def models(self) -> list[Mapping[str, Any]]:
        """Trained models behind the scores, each once; empty for a method that does not learn."""
        return list({model["digest"]: model for model in self.record.get("models", ())}.values())


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
    return replace(_cell(results, n_galleries), repeats=_repeats(results, n_galleries))


def _repeats(results: Sequence[Result], n_galleries: int) -> tuple[Figures, ...]:
    """Scores of the row by each jittered preparation that all of its jobs have; none where there are less than two."""
    numbers = sorted(set(results[0].repeats).intersection(*(result.repeats for result in results)))
    made = [_cell([Result(result.repeats[number]) for result in results], n_galleries).scores for number in numbers]
    found = tuple(scores for scores in made if scores is not None)
    return found if len(found) > 1 else ()


def _cell(results: Sequence[Result], n_galleries: int) -> Cell:
    done = [result for result in results if result.record.get("scores")]
    outdated = "; ".join(dict.fromkeys(result.outdated for result in done if result.outdated))
    origin = " and ".join(sorted({result.origin for result in done} - {""}))
    galleries: dict[str, list[Mapping[str, Any]]] = {}
    for result in results:
        galleries.setdefault(result.record["gallery"], []).append(result.record)
    n_missing = max(n_galleries - len(galleries), 0)
    n_wanted = len(results) + n_missing
    if not done:
        record = results[0].record
        return Cell(record["status"], {"reason": record.get("reason", "")}, n_wanted=n_wanted)
    if n_wanted == 1:
        return Cell("ok", done[0].record, n_averaged=1, outdated=outdated, origin=origin, records=(done[0].record,))
    records = [result.record for result in done]
    names = list(records[0]["scores"])
    means = [_means(of_gallery, names) for of_gallery in galleries.values()]
    means += [dict.fromkeys([*names, "coverage"], 0.0)] * n_missing
    peaks = [record["peak_mib"] for record in records if record.get("peak_mib") is not None]
    told = [
        f"{result.record['gallery']}: {result.record.get('reason', result.record['status'])}"
        for result in results
        if result not in done
    ]
    merged = {
        "key": digest([record["key"] for record in records]),
        "reason": "; ".join(told) or "not run",
        "scores": {name: statistics.fmean(each[name] for each in means) for name in names},
        "coverage": statistics.fmean(each["coverage"] for each in means),
        "chance": {name: statistics.fmean(chance_of(r)[name] for r in records) for name in chance_of(records[0])},
        "n_shapes": len({shape for record in records for shape in record["shapes"]}),
        "n_classes": len({label for record in records for label in record["labels"]}),
        "unsupported": _each_once(shape for record in records for shape in record["unsupported"]),
        "cost": {"seconds_per_shape": _medians(records)},
        "peak_mib": max(peaks, default=None),
        "models": [model for record in records for model in record.get("models", ())],
        "seen": _each_once(shape for record in records for shape in record.get("seen", ())),
        "notes": records[0].get("notes", {}),
    }
    columns = means if len(means) > 1 else [record["scores"] for record in records]
    deviation = {name: statistics.stdev(each[name] for each in columns) for name in names} if len(columns) > 1 else None
    return Cell("ok", merged, deviation, len(done), n_wanted, outdated, origin, tuple(records))


def _draws(record: Mapping[str, Any]) -> Sequence[int]:
    """Draws of the scorer that the measures of a query are the mean over."""
    return (record["recipe"].get("scorer") or {}).get("codebooks", (0,))  # type: ignore[no-any-return]


def _first_ranks(record: Mapping[str, Any]) -> list[float]:
    """Of each query under how many draws its first rank is relevant: a whole number where nothing ties there."""
    return [value * len(_draws(record)) for value in record["per_query"]["NN"] if value is not None]


def _means(records: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, float]:
    """Scores of a gallery, and its coverage: means over its trainings, so that galleries count alike."""
    found = {name: statistics.fmean(record.get("scores", {}).get(name, 0.0) for record in records) for name in names}
    return found | {"coverage": statistics.fmean(coverage_of(record) for record in records)}


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
