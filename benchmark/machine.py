"""Cores and memory of a process, and its limit of one thread: results must not depend on the number of threads."""

from __future__ import annotations

import os
import platform
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path, PurePosixPath

#: Environment variables that numerical libraries read when they are loaded.
VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)

#: Share of the memory of the machine or container that all processes together may use.
MEMORY_SHARE = 0.85

_MOUNTED, _GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def pin_threads() -> None:
    """Limit this process and its children to one thread; call this before importing a numerical library."""
    for name in VARIABLES:
        os.environ[name] = "1"


def available_cores() -> int:
    """Return the number of cores that affinity and CPU quota allow; at least one."""
    from joblib import cpu_count

    return int(cpu_count())


def memory_per_process(processes: int = 1) -> int:
    """Return the memory limit of one of several processes in bytes; together they get most of the machine's memory."""
    import psutil

    return int(min(psutil.virtual_memory().total, memory_limit()) * MEMORY_SHARE / processes)


@cache
def describe_machine() -> str:
    """Return processor, cores, memory and BLAS, on which seconds depend, and the GPU if this process uses one."""
    import numpy  # noqa: F401  # loads its BLAS
    import psutil
    from threadpoolctl import threadpool_info

    models = [platform.processor() or platform.machine()]
    with suppress(OSError):
        described = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        models = [
            line.partition(":")[2].strip() for line in described if line.startswith("model name")
        ] or models
    libraries = [library for library in threadpool_info() if library["user_api"] == "blas"]
    # That of numpy: which others are loaded depends on what this process did before.
    blas = [
        f"{of['internal_api']} {of.get('architecture', '')}"
        for of in libraries
        if "numpy" in of["filepath"]
    ]
    torch = sys.modules.get("torch")
    gpu = [torch.cuda.get_device_name()] if torch and torch.cuda.is_available() else []
    memory = round(min(psutil.virtual_memory().total, memory_limit()) / 2**30)
    cores = available_cores()
    return ", ".join(
        [models[0], f"{cores} core{'s' * (cores > 1)}", f"{memory} GiB", *blas[:1], *gpu]
    )


def memory_limit() -> float:
    """Return the memory limit of the control groups of this process, in bytes."""
    limits = [float("inf")]
    with suppress(OSError):
        group = PurePosixPath(_GROUPS.read_text(encoding="utf-8").rpartition("::/")[2].strip())
        for part in (group, *group.parents):
            with suppress(OSError, ValueError):  # no limit is "max"
                limits.append(float((_MOUNTED / part / "memory.max").read_text(encoding="ascii")))
    return min(limits)
