"""Made-up records of jobs, with all that tables need."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from benchmark.files import write_text
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.records import Records, as_text
from retrieval.measures import chance_levels

MEASURES = ("NN", "FT", "ST", "DCG")
SHAPES = ("cat0", "cat1", "dog0", "dog1")


def record(
    method: str = "classic-mds",
    input_: str = "mesh",
    gallery: str = "rods",
    nn: float = 0.75,
    *,
    code: str = "1",
    finished: str = "2026-01-01T00:00:00+00:00",
    data: dict[str, Any] | None = None,
    **more: Any,
) -> dict[str, Any]:
    """Record of a finished job; other ``code`` makes it one of another recipe in the same place."""
    recipe = {"seed": 0, "input": input_, "method": method, "gallery": gallery, "versions": {f"method/{method}": code}}
    values = {
        "gallery": gallery, "input": input_, "method": method, "title": method.title(), "family": "extended",
        "parameters": {}, "target": f"baselines.{method}:Method",
        "data": {
            "name": gallery, "title": gallery, "stand_in_for": "", "source": gallery, "quick": False,
            "module": "benchmark.datasets.files", "n_shapes": 4, "n_classes": 2,
            "chance": dict.fromkeys(MEASURES, 0.25),
        },
        "recipe": recipe, "status": "ok", "finished": finished,
        "scores": {"NN": nn, "FT": 0.5, "ST": 0.75, "DCG": 0.8},
        "shapes": list(SHAPES), "labels": ["cat", "cat", "dog", "dog"], "n_shapes": 4, "n_classes": 2,
        "unsupported": [], "notes": {}, "cost": {"seconds_per_shape": {"canonicalise": 1.5}}, "peak_mib": 100,
        "wall_seconds": 1.0, "environments": [], "artefacts": ["ab"],
    }  # fmt: skip
    values["data"] |= data or {}
    values |= more
    values.setdefault("chance", chance_levels(values["labels"]))
    values.setdefault("per_query", {name: queries(value, values["labels"]) for name, value in values["scores"].items()})
    return {"key": digest(values["recipe"]), **values}


@cache
def published() -> tuple[dict[str, Any], ...]:
    """The records that travel with the suite, read once."""
    return tuple(Records(Path(__file__).parents[1] / "results" / "records"))


def copy_published(folder: Path, wanted: Callable[[dict[str, Any]], bool]) -> None:
    """Write some of them into a folder, as files of their own."""
    folder.mkdir(parents=True, exist_ok=True)
    for published_record in filter(wanted, published()):
        write_text(folder / f"{published_record['key']}.json", as_text(published_record))


def queries(mean: float, labels: Sequence[str]) -> list[float | None]:
    """Values of single queries with this mean: hits and failures where there is such a number of hits."""
    has_relevant = [labels.count(label) > 1 for label in labels]
    hits, count = mean * sum(has_relevant), 0
    values: list[float | None] = []
    for scored in has_relevant:
        values.append((float(count < round(hits)) if hits == round(hits) else mean) if scored else None)
        count += scored
    return values


def failed(status: str = "timeout", reason: str = "stopped", **options: Any) -> dict[str, Any]:
    """Record of a job without scores."""
    finished = record(**options)
    place = ("key", "gallery", "input", "method", "title", "family", "finished")
    return {name: finished[name] for name in (*place, "parameters", "target", "data", "recipe")} | {
        "status": status,
        "reason": reason,
    }
