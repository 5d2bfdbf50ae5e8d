"""Cores and memory of a process, and its limit of one thread: results must not depend on the number of threads."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator
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
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, int(min(cores, cpu_limit())))


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

    models = [line.partition(":")[2].strip() for line in _lines(Path("/proc/cpuinfo")) if line.startswith("model name")]
    libraries = [library for library in threadpool_info() if library["user_api"] == "blas"]
    # That of numpy: which others are loaded depends on what this process did before.
    blas = [f"{of['internal_api']} {of.get('architecture', '')}" for of in libraries if "numpy" in of["filepath"]]
    torch = sys.modules.get("torch")
    gpu = [torch.cuda.get_device_name()] if torch and torch.cuda.is_available() else []
    memory = round(min(psutil.virtual_memory().total, memory_limit()) / 2**30)
    cores = available_cores()
    name = models[0] if models else platform.processor() or platform.machine()
    return ", ".join([name, f"{cores} core{'s' * (cores > 1)}", f"{memory} GiB", *blas[:1], *gpu])


def _lines(path: Path) -> list[str]:
    with suppress(OSError):
        return path.read_text(encoding="utf-8", errors="replace").splitlines()
    return []


def memory_limit() -> float:
    """Return the memory limit of the control groups of this process, in bytes."""
    limits = _read("memory", ("memory.max",), ("memory.limit_in_bytes",))
    return min((float(limit) for (limit,) in limits), default=float("inf"))


def cpu_limit() -> float:
    """Return the CPU quota of the control groups of this process, in cores."""
    quotas = _read("cpu", ("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us"))
    limits = [float(quota) / float(period) for quota, period in quotas]
    return min((limit for limit in limits if limit > 0), default=float("inf"))


def _read(controller: str, files: tuple[str, ...], version_1: tuple[str, ...]) -> Iterator[list[str]]:
    """Yield the words of files of a controller for each group of this process; version 1 has one folder each."""
    with suppress(OSError, ValueError):
        for line in _GROUPS.read_text(encoding="utf-8").splitlines():
            _, controllers, group = line.split(":", 2)
            path = PurePosixPath(group.lstrip("/"))
            for name in {"", controller} & set(controllers.split(",")):
                for folder in (_MOUNTED / name / part for part in (path, *path.parents)):
                    with suppress(OSError):
                        texts = [(folder / file).read_text(encoding="ascii") for file in (version_1 if name else files)]
                        yield " ".join(texts).replace("max", "inf").split()
