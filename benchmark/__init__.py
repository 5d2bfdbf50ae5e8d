"""The harness: what to run, running it, showing it."""

from typing import Any

#: What is offered here, and the module that has it: none is imported before it is asked for.
_OFFERED = {"open_results": "benchmark.report.results", "score": "benchmark.scoring.evaluation"}


def __getattr__(name: str) -> Any:
    if name not in _OFFERED:
        raise AttributeError(f"module 'benchmark' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(_OFFERED[name]), name)
