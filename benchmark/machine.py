"""Cores and memory of a process, its limit of one thread, and copies of it.

Results must not depend on the number of threads.
"""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path, PurePosixPath
from typing import TypeVar

from benchmark.errors import ConfigurationError

Item = TypeVar("Item")
Value = TypeVar("Value")

#: Environment variables that numerical libraries read when they are loaded.
VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)

#: Variable that says how many threads of a process share a comparison of shapes; one without it.
THREADS = "CANONICAL_FORMS_THREADS"

#: Share of the memory of the machine or container that all processes together may use.
MEMORY_SHARE = 0.85

#: Where Linux shows limits of control groups, and says which groups a process is in.
_CONTROL_GROUPS = Path("/sys/fs/cgroup")
_GROUPS_OF_PROCESS = Path("/proc/self/cgroup")


def pin_threads() -> None:
    """Limit this process and its children to one thread.

    Numerical libraries must be imported after it.
    """
    for name in VARIABLES:
        os.environ[name] = "1"


def in_threads(function: Callable[[Item], Value], items: Iterable[Item]) -> list[Value]:
    """Return what a function returns for each item, in their order.

    The items are independent, and are shared by as many threads as :data:`THREADS` says. It pays
    for functions that spend their time in kernels and products of matrices, which run beside each
    other.

    Raises
    ------
    ConfigurationError
        If the variable is no number of threads.
    """
    text = os.environ.get(THREADS, "1")
    if not text.isdecimal() or int(text) < 1:
        raise ConfigurationError(f"{THREADS} is '{text}', not a number of threads", "unset it")
    count = int(text)
    if count == 1:
        return [function(item) for item in items]
    with ThreadPoolExecutor(count) as threads:
        return list(threads.map(function, items))


def available_cores() -> int:
    """Return the number of cores that affinity and CPU quota allow; at least one."""
    from joblib import cpu_count

    return int(cpu_count())


def memory_per_process(processes: int = 1) -> int:
    """Return the memory limit of one of several processes in bytes.

    Together they get most of the memory of the machine.
    """
    return int(_memory() * MEMORY_SHARE / processes)


def describe_machine() -> str:
    """Describe this machine: processor, cores, memory, BLAS, and the GPU that this process uses.

    Records name it beside their seconds, which depend on it.
    """
    parts = [_machine_without_gpu()]
    torch = sys.modules.get("torch")
    if torch and torch.cuda.is_initialized():  # a method may use it later than others
        parts.append(torch.cuda.get_device_name())
    return ", ".join(parts)


@cache
def _machine_without_gpu() -> str:
    """Describe processor, cores, memory and BLAS."""
    cores = available_cores()
    parts = [
        _processor(),
        f"{cores} core" if cores == 1 else f"{cores} cores",
        f"{round(_memory() / 2**30)} GiB",
        *_blas_of_numpy(),
    ]
    return ", ".join(parts)


def _processor() -> str:
    """Return the model of the processor."""
    with suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        for line in text.splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _blas_of_numpy() -> list[str]:
    """Return name and architecture of the BLAS of numpy; none if it is unknown.

    Which others are loaded depends on what this process did before.
    """
    import numpy  # noqa: F401  # loads its BLAS
    from threadpoolctl import threadpool_info

    for library in threadpool_info():
        if library["user_api"] == "blas" and "numpy" in library["filepath"]:
            return [f"{library['internal_api']} {library.get('architecture', '')}"]
    return []


def _memory() -> float:
    """Return the memory of the machine or container in bytes."""
    import psutil

    return float(min(psutil.virtual_memory().total, memory_limit()))


def memory_limit() -> float:
    """Return the memory limit of the control groups of this process in bytes; infinite without."""
    limit = float("inf")
    with suppress(OSError):
        text = _GROUPS_OF_PROCESS.read_text(encoding="utf-8")
        group = PurePosixPath(text.rpartition("::/")[2].strip())
        for folder in (group, *group.parents):
            file = _CONTROL_GROUPS / folder / "memory.max"
            with suppress(OSError, ValueError):  # without a limit it says "max"
                limit = min(limit, float(file.read_text(encoding="ascii")))
    return limit


@contextmanager
def same_umask() -> Iterator[None]:
    """Put back the umask of this process after the code within, which may have changed it."""
    before = os.umask(0o077)  # the only way to ask for it
    os.umask(before)
    try:
        yield
    finally:
        os.umask(before)


@contextmanager
def copies_end() -> Iterator[None]:
    """End here each copy of this process that the code within has forked, and that comes back.

    Such a copy would go on with the program: it would answer in the place of this process, and
    write into the same files.
    """
    process = os.getpid()
    try:
        yield
    finally:
        if os.getpid() != process:
            with suppress(Exception):  # the code may have closed it
                sys.stderr.write("a process that was forked did not end: call os._exit in it\n")
                sys.stderr.flush()
            os._exit(1)
