"""Former place of :mod:`benchmark.api.contracts`."""

import warnings

from benchmark.api.contracts import *  # noqa: F403

warnings.warn(
    "benchmark.contracts is benchmark.api.contracts now; import from benchmark.api", DeprecationWarning, stacklevel=2
)
