"""Made-up records."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from benchmark.pipeline.records import Record

#: Twelve shapes of three classes.
LABELS = [name for name in ("cat", "dog", "owl") for _ in range(4)]


def record(
    method: str = "gps",
    nn: float | Sequence[float] = 0.75,
    *,
    dataset: str = "rods",
    fold: str = "",
    input_: str = "mesh",
    labels: Sequence[str] = LABELS,
    stand_in_for: str = "",
    quick: bool = False,
    **more: Any,
) -> Record:
    """Record of a job whose queries all have the same measures, or these values of NN."""
    shapes = [f"{label}{place}" for place, label in enumerate(labels)]
    values = [nn] * len(labels) if isinstance(nn, float) else list(nn)
    others = {"FT": 0.5, "ST": 0.6, "DCG": 0.7, "E": 0.3, "mAP": 0.4}
    per_query = {"NN": values} | {name: [value] * len(labels) for name, value in others.items()}
    gallery = f"{dataset} {fold}".strip() + (" (quick)" if quick else "")
    content = {
        "key": hashlib.sha256(repr((method, gallery, input_, values, more)).encode()).hexdigest()[
            :32
        ],
        "status": "ok",
        "gallery": gallery,
        "gallery_digest": "1",
        "input": input_,
        "method": method,
        "title": method.title(),
        "family": "paper",
        "shapes": shapes,
        "labels": list(labels),
        "data": {
            "name": dataset,
            "title": dataset,
            "source": dataset,
            "stand_in_for": stand_in_for,
            "quick": quick,
        },
        "per_query": per_query,
        "scores": {name: sum(of) / len(of) for name, of in per_query.items()},
        "seconds": {"canonicalise": 1.0, "geodesics": 0.5, "prepare": 9.0},
        "processor_seconds": {"canonicalise": 1.0, "geodesics": 0.5},
        "finished": "2026-01-01T00:00:00+00:00",
    }
    return msgspec.convert(content | more, Record)


def failed(method: str, reason: str = "it fell", status: str = "failed", **more: Any) -> Record:
    """Record of a job without scores."""
    return record(method, status=status, reason=reason, scores={}, per_query={}, **more)


def by_class(values: Mapping[str, float], labels: Sequence[str] = LABELS) -> list[float]:
    """One value for all queries of a class."""
    return [values[label] for label in labels]
