"""Former place of :mod:`benchmark.api.streaming`."""

import warnings

from benchmark.api.streaming import *  # noqa: F403

warnings.warn(
    "benchmark.streaming is benchmark.api.streaming now; import from benchmark.api", DeprecationWarning, stacklevel=2
)
