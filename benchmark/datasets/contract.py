"""Former place of :mod:`benchmark.api.datasets`."""

import warnings

from benchmark.api.datasets import *  # noqa: F403

warnings.warn(
    "benchmark.datasets.contract is benchmark.api.datasets now; import from benchmark.api",
    DeprecationWarning,
    stacklevel=2,
)
