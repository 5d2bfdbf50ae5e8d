"""Plan the jobs of a selection, and run them in worker processes that may crash, hang or run out of memory."""

from benchmark.run.estimates import Estimate, estimate
from benchmark.run.plan import Planned, plan
from benchmark.run.runner import Progress, run

__all__ = ["Estimate", "Planned", "Progress", "estimate", "plan", "run"]
