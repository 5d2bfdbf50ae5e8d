"""Processors to be, by environment variables: which kernels BLAS, numba and numpy choose."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from threadpoolctl import threadpool_info

#: Compiled code and results are kept here; nothing in it is worth a commit.
FOLDER = Path("build/portability")

AVX2 = frozenset({"avx2", "fma"})
AVX512 = frozenset({"avx512f", "avx512cd", "avx512bw", "avx512dq", "avx512vl"})


@dataclass(frozen=True)
class Variant:
    """One way to run the same program.

    Parameters
    ----------
    name
        One word.
    environment
        Variables that the numerical libraries read when they are loaded.
    needs
        Flags in ``/proc/cpuinfo`` without which the processor cannot run it.
    cache
        Name of a folder for numba's compiled code, where it differs from that of the checkout. A kernel of BLAS does
        not change that code.
    """

    name: str
    environment: Mapping[str, str]
    needs: frozenset[str] = field(default=frozenset())
    cache: str | None = None

    def variables(self) -> dict[str, str]:
        """All environment variables of a process of this variant."""
        folder = {} if self.cache is None else {"NUMBA_CACHE_DIR": str((FOLDER / self.cache).resolve())}
        return {**os.environ, **self.environment, **folder}

    def obstacle(self) -> str:
        """Why the processor cannot run this variant; empty if it can."""
        if "OPENBLAS_CORETYPE" in self.environment and platform.machine().lower() not in ("x86_64", "amd64"):
            return "no x86-64 processor"
        missing = sorted(self.needs - processor_flags())
        return f"the processor has no {', '.join(missing)}" if missing else ""


def own_kernels() -> str:
    """The kernels that numpy's BLAS chooses by itself, by the name of the variant; empty if it cannot tell."""
    import numpy  # noqa: F401  (loads the library that is asked)

    found = (library.get("architecture", "") for library in threadpool_info() if library["user_api"] == "blas")
    return next(found, "")


def processor_flags() -> frozenset[str]:
    """Flags of the first processor in ``/proc/cpuinfo``; empty where that file is missing."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return frozenset()
    flags = next((line for line in lines if line.startswith("flags")), ":")
    return frozenset(flags.split(":", 1)[1].split())


def without_numpy_dispatch() -> str:
    """Names of all instruction sets that numpy chooses at run time on this processor."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    return " ".join(name for name in __cpu_dispatch__ if __cpu_features__.get(name))


NEHALEM = Variant("Nehalem", {"OPENBLAS_CORETYPE": "Nehalem"})
HASWELL = Variant("Haswell", {"OPENBLAS_CORETYPE": "Haswell"}, AVX2)
ZEN = Variant("Zen", {"OPENBLAS_CORETYPE": "Zen"}, AVX2)
SKYLAKEX = Variant("SkylakeX", {"OPENBLAS_CORETYPE": "SkylakeX"}, AVX512)
GENERIC = Variant("generic", {"NUMBA_CPU_NAME": "generic"}, cache="numba-generic")
#: Everything that can be switched to the instructions of 2008 at once.
OLDEST = Variant(
    "oldest",
    {
        "OPENBLAS_CORETYPE": "Nehalem",
        "NUMBA_CPU_NAME": "generic",
        "NPY_DISABLE_CPU_FEATURES": without_numpy_dispatch(),
    },
    cache="numba-generic",
)

#: Under each of these the tests must pass. Two run side by side: the one that compiles for itself starts beside the one
#: that compiles for all others.
TESTED = (NEHALEM, GENERIC, HASWELL, ZEN, SKYLAKEX)
#: For continuous integration: what can be tested at once in one variant, and one of the two that share the kernels of
#: Haswell, which differ in the sizes of blocks alone.
TOGETHER = (OLDEST, HASWELL, SKYLAKEX)
