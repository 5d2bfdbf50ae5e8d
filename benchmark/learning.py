"""Former place of :mod:`benchmark.api.learning`."""

import warnings

from benchmark.api.learning import *  # noqa: F403

warnings.warn(
    "benchmark.learning is benchmark.api.learning now; import from benchmark.api", DeprecationWarning, stacklevel=2
)
