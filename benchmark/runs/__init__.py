"""Plan the jobs of a selection, and run them in worker processes that may crash, hang or run out of memory."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from benchmark.runs.estimates import Estimate, estimate
    from benchmark.runs.planning import Planned, plan
    from benchmark.runs.runner import Progress, run

__all__ = ["Estimate", "Planned", "Progress", "estimate", "plan", "run"]

_MODULES = {"Estimate": "estimates", "estimate": "estimates", "Planned": "planning"}
_MODULES |= {"plan": "planning", "Progress": "runner", "run": "runner"}


def __getattr__(name: str) -> Any:
    """Import a module when it is needed: workers need none of these."""
    if name not in __all__:
        raise AttributeError(f"module 'benchmark.runs' has no attribute '{name}'")
    return getattr(import_module(f"benchmark.runs.{_MODULES[name]}"), name)
