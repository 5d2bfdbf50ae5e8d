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


def available_cores() -> int:
    """Number of cores that this process may use, where the system tells; else those of the machine, at least one."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
