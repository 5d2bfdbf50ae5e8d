"""One thread per process: jobs are the unit of parallel work, and results do not depend on thread counts."""

from __future__ import annotations

import os

from benchmark.cgroup import cpu_limit

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
    """Number of cores that this process may use, by its affinity and the quota of its container; at least one."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, int(min(cores, cpu_limit())))
