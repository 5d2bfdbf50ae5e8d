"""Canonical forms for non-rigid shape retrieval: run methods, score them, and show the results."""

from __future__ import annotations

from importlib import import_module
from typing import Any

#: Module of each name; none is imported before it is used.
_OFFERED = {
    "canonical_form_of_depth": "benchmark.commands.forms",
    "canonicalise": "benchmark.commands.canonicalise",
    "compare": "benchmark.commands.compare",
    "demo": "benchmark.commands.demo",
    "describe": "benchmark.commands.listing",
    "forget": "benchmark.commands.forget",
    "listing": "benchmark.commands.listing",
    "merge": "benchmark.commands.merge",
    "open_results": "benchmark.report.results",
    "plan": "benchmark.commands.plan",
    "retrieve": "benchmark.commands.retrieve",
    "run": "benchmark.commands.run",
    "score": "benchmark.commands.score",
    "side_by_side": "benchmark.commands.form",
    "tables": "benchmark.commands.tables",
    "train": "benchmark.commands.train",
    "write_report": "benchmark.commands.report",
}

__all__ = sorted(_OFFERED)


def __getattr__(name: str) -> Any:
    if name not in _OFFERED:
        raise AttributeError(f"module 'benchmark' has no attribute '{name}'")
    return getattr(import_module(_OFFERED[name]), name)


def __dir__() -> list[str]:
    return __all__
