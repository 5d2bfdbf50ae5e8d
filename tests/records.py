"""Made-up records of jobs, with all that tables need."""

from __future__ import annotations

from typing import Any

from benchmark.storage.keys import digest

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
    recipe = {
        "seed": 0,
        "input": input_,
        "method": method,
        "gallery": gallery,
        "code": {"method": {"code": {"m": code}}},
    }
    queries = [1.0 if k < round(nn * len(SHAPES)) else 0.0 for k in range(len(SHAPES))]
    found = {
        "gallery": gallery, "input": input_, "method": method, "title": method.title(), "family": "extended",
        "parameters": {}, "target": f"baselines.{method}:Method",
        "data": {
            "name": gallery, "title": gallery, "stand_in_for": "", "source": gallery, "quick": False,
            "module": "benchmark.datasets.files", "n_shapes": 4, "n_classes": 2,
            "chance": dict.fromkeys(MEASURES, 0.25),
        },
        "recipe": recipe, "status": "ok", "finished": finished,
        "scores": {"NN": nn, "FT": 0.5, "ST": 0.75, "DCG": 0.8},
        "per_query": dict.fromkeys(MEASURES, queries), "chance": dict.fromkeys(MEASURES, 0.25),
        "shapes": list(SHAPES), "labels": ["cat", "cat", "dog", "dog"], "n_shapes": 4, "n_classes": 2,
        "unsupported": [], "notes": {}, "cost": {"seconds_per_shape": {"canonicalise": 1.5}}, "peak_mib": 100,
        "wall_seconds": 1.0, "environments": [], "artefacts": ["ab"],
    }  # fmt: skip
    found["data"] |= data or {}
    found |= more
    return {"key": digest(found["recipe"]), **found}


def failed(status: str = "timeout", reason: str = "stopped", **options: Any) -> dict[str, Any]:
    """Record of a job without scores."""
    found = record(**options)
    kept = (
        "key",
        "gallery",
        "input",
        "method",
        "title",
        "family",
        "parameters",
        "target",
        "data",
        "recipe",
        "finished",
    )
    return {name: found[name] for name in kept} | {"status": status, "reason": reason}
