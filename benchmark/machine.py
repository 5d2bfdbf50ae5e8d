"""What a process may use of the machine: cores, memory, and one thread, for results do not depend on their number."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

#: Variables read by numerical libraries when they are loaded.
VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)

#: Share of the memory of the machine, or of the cgroup, that all processes together may take.
MEMORY_SHARE = 0.85

_MOUNTED, _GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def pin_threads() -> None:
    """Pin the threads of this process and of those it starts; call it before a numerical library is imported."""
    for name in VARIABLES:
        os.environ[name] = "1"


def available_cores() -> int:
    """Number of cores that this process may use, by its affinity and the quota of its container; at least one."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, int(min(cores, cpu_limit())))


def memory_per_process(processes: int = 1) -> int:
    """Bytes that one of several processes may take: together, most of the memory of the machine or the container."""
    import psutil

    return int(min(psutil.virtual_memory().total, memory_limit()) * MEMORY_SHARE / processes)


def memory_limit() -> float:
    """Bytes that the control groups of this process, such as those of a container, let it take."""
    limits = _read("memory", ("memory.max",), ("memory.limit_in_bytes",))
    return min((float(limit) for (limit,) in limits), default=float("inf"))


def cpu_limit() -> float:
    """Processors whose time the control groups of this process let it take."""
    quotas = _read("cpu", ("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us"))
    limits = [float(quota) / float(period) for quota, period in quotas]
    return min((limit for limit in limits if limit > 0), default=float("inf"))


def _read(controller: str, files: tuple[str, ...], version_1: tuple[str, ...]) -> Iterator[list[str]]:
    """Words of some files of a controller, for each group that this process is in: of its own folder in version 1."""
    with suppress(OSError, ValueError):
        for line in _GROUPS.read_text(encoding="utf-8").splitlines():
            _, controllers, group = line.split(":", 2)
            path = PurePosixPath(group.lstrip("/"))
            for name in {"", controller} & set(controllers.split(",")):
                for folder in (_MOUNTED / name / part for part in (path, *path.parents)):
                    with suppress(OSError):
                        texts = [(folder / file).read_text(encoding="ascii") for file in (version_1 if name else files)]
                        yield " ".join(texts).replace("max", "inf").split()
