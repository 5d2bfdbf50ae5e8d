"""Results of one method under one input, over all galleries and trainings of a table."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from benchmark.pipeline.storage.records import chance_of, coverage_of
from benchmark.report.results import Result
from benchmark.report.significance import UNIT

Figures = Mapping[str, float]

Record = Mapping[str, Any]

#: Status of a line without a record.
MISSING = "missing"

_EMPTY: Mapping[str, Any] = {
    "status": MISSING, "reason": "", "scores": None, "coverage": 0.0, "deviation": None, "preparation_sd": None,
    "n_repeats": 0, "chance": None, "supported": {}, "codebook_deviation": None, "splits": None, "n_averaged": 0,
    "n_wanted": 1, "n_shapes": None, "n_classes": None, "n_queries": 0, "n_tied": 0, "unsupported": (), "seen": (),
    "models": (), "notes": {}, "phases": {}, "seconds": None, "peak_mib": None, "origin": "", "outdated": "",
    "records": (),
}  # fmt: skip


def line_of(results: Sequence[Result], n_galleries: int) -> dict[str, Any]:
    """Return what one or several jobs reached: galleries of a table with folds, seeds of a training.

    A gallery or a training without a result counts 0, so that a crash in a hard one does not pay.

    Parameters
    ----------
    results
        One for each job that has a record.
    n_galleries
        Galleries that there should be.

    Returns
    -------
    dict
        ``status`` ("missing" without a record) and ``reason``; ``scores`` by measure, or None, and ``coverage``, means
        over galleries; ``deviation``, their standard deviation (n - 1), of galleries where there are several, else of
        trainings, None for a single job; ``preparation_sd``, that over ``n_repeats`` jittered preparations, where there
        are two; ``chance``; ``supported``, ``codebook_deviation`` and ``splits`` of a single job; ``n_averaged`` and
        ``n_wanted``, jobs that the scores are the mean of, and that there should be; ``n_shapes``, ``n_classes``,
        ``n_queries``, and ``n_tied`` (queries whose first rank ties, so that their NN is a mean over orders);
        ``unsupported`` and ``seen`` shapes, ``models``, ``notes``; seconds a shape by phase (``phases``, medians over
        the jobs) and their sum (``seconds``); ``peak_mib``, ``origin``, ``outdated``, and the ``records`` with scores.
    """
    if not results:
        return dict(_EMPTY)
    scored = [result for result in results if result.record.get("scores")]
    records = [result.record for result in scored]
    n_wanted = len(results) + max(n_galleries - len({result.record["gallery"] for result in results}), 0)
    if not scored:
        first = results[0].record
        status = {"status": first["status"], "reason": first.get("reason", "")}
        return {**_EMPTY, **status, "n_wanted": n_wanted}
    is_single, first = n_wanted == 1, records[0]
    only = first if is_single else {}
    galleries = _of_galleries([result.record for result in results], [*first["scores"], "coverage"], n_galleries)
    scores = _means(galleries)
    phases = [record["cost"]["seconds_per_shape"] for record in records]
    seconds = {
        phase: statistics.median(of_job[phase] for of_job in phases if phase in of_job)
        for phase in dict.fromkeys(phase for of_job in phases for phase in of_job)
    }
    failures = [
        f"{result.record['gallery']}: {result.record.get('reason', result.record['status'])}"
        for result in results
        if result not in scored
    ]
    spread_over = galleries if len(galleries) > 1 else [record["scores"] for record in records]
    return {
        **_EMPTY,
        "status": "ok",
        "reason": "; ".join(failures) or "not run",
        "coverage": scores.pop("coverage"),
        "scores": scores,
        "deviation": None if is_single else _deviations(spread_over, scores),
        **_over_preparations(results, [*scores], n_galleries),
        "chance": _means([chance_of(record) for record in records]),
        "supported": only.get("supported", {}),
        "codebook_deviation": only.get("codebook_deviation"),
        "splits": only.get("splits"),
        "n_averaged": len(scored),
        "n_wanted": n_wanted,
        "n_shapes": only.get("n_shapes") or len({shape for record in records for shape in record["shapes"]}),
        "n_classes": only.get("n_classes") or len({label for record in records for label in record["labels"]}),
        "n_queries": sum(value is not None for record in records for value in record["per_query"]["NN"]),
        "n_tied": sum(_n_tied(record) for record in records if record.get("tied_queries")),
        "unsupported": _union(tuple(refused) for record in records for refused in record["unsupported"]),
        "seen": _union(shape for record in records for shape in record.get("seen", ())),
        "models": [*{model["digest"]: model for record in records for model in record.get("models", ())}.values()],
        "notes": first.get("notes") or {},
        "phases": seconds,
        "seconds": sum(seconds.values()) if seconds else None,
        "peak_mib": max((peak for record in records if (peak := record.get("peak_mib")) is not None), default=None),
        "origin": " and ".join(sorted({result.origin for result in scored} - {""})),
        "outdated": "; ".join(_union(result.outdated for result in scored if result.outdated)),
        "records": tuple(records),
    }


def _of_galleries(records: Iterable[Record], names: Sequence[str], n_galleries: int) -> list[Figures]:
    """Scores and coverage of each gallery, means over its trainings, so that galleries count alike."""
    galleries: dict[str, list[Figures]] = {}
    for record in records:
        figures = dict.fromkeys(names, 0.0) | record.get("scores", {}) | {"coverage": coverage_of(record)}
        galleries.setdefault(record["gallery"], []).append({name: figures[name] for name in names})
    missing = [dict.fromkeys(names, 0.0)] * (n_galleries - len(galleries))
    return [*map(_means, galleries.values()), *missing]


def _means(figures: Sequence[Figures]) -> dict[str, float]:
    return {name: statistics.fmean(row[name] for row in figures) for name in figures[0]}


def _deviations(figures: Sequence[Figures], names: Iterable[str]) -> dict[str, float] | None:
    if len(figures) < 2:
        return None
    return {name: statistics.stdev(row[name] for row in figures) for name in names}


def _over_preparations(results: Sequence[Result], names: Sequence[str], n_galleries: int) -> dict[str, Any]:
    """Spread of the whole row over the jittered preparations that all its jobs have."""
    numbers = sorted(set(results[0].repeats).intersection(*(result.repeats for result in results)))
    repeats = [[result.repeats[number] for result in results] for number in numbers]
    scores = [_means(_of_galleries(records, names, n_galleries)) for records in repeats]
    return {"n_repeats": len(scores), "preparation_sd": _deviations(scores, names)} if len(scores) > 1 else {}


def _union(items: Iterable[Any]) -> list[Any]:
    return [*dict.fromkeys(items)]


def _n_tied(record: Record) -> int:
    """Queries whose first rank is relevant in no whole number of the scorer's draws."""
    draws = len((record["recipe"].get("scorer") or {}).get("codebooks", (0,)))
    hits = [value * draws for value in record["per_query"]["NN"] if value is not None]
    return sum(abs(count - round(count)) > draws * UNIT for count in hits)
