"""One thread per process: jobs are the unit of parallel work, and results do not depend on thread counts."""

from __future__ import annotations

import os

#: Variables read by numerical libraries when they are loaded.
VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


def pin_threads() -> None:
    """Pin the threads of this process and of those it starts; call it before a numerical library is imported."""
    for name in VARIABLES:
        os.environ[name] = "1"
