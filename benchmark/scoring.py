"""Former place of :mod:`benchmark.api.scoring`."""

import warnings

from benchmark.api.scoring import *  # noqa: F403

warnings.warn(
    "benchmark.scoring is benchmark.api.scoring now; import from benchmark.api", DeprecationWarning, stacklevel=2
)
