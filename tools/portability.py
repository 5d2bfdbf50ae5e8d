"""``make portability``: golden results under the kernels of other processors, two variants side by side.

Which kernels BLAS, numba and numpy choose is set by environment variables.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
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
    needs: frozenset[str] = frozenset()
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


#: The golden results of all components; a variant whose kernels are not compiled does that first.
COMMAND = (sys.executable, "-m", "tools.golden")


def compared(variant: Variant) -> tuple[Variant, int, float, str]:
    """Exit code, seconds and output of the command under one variant."""
    start, both = time.perf_counter(), subprocess.STDOUT
    done = subprocess.run(COMMAND, env=variant.variables(), stdout=subprocess.PIPE, stderr=both, text=True, check=False)
    return variant, done.returncode, time.perf_counter() - start, done.stdout


def all_pass(variants: Sequence[Variant]) -> bool:
    """Run the command under each variant that the processor can run; print one line each; whether all passed."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for variant in variants:
        if variant.obstacle():
            print(f"{variant.name:<10} skipped: {variant.obstacle()}", flush=True)
    failed = False
    with ThreadPoolExecutor(max_workers=min(2, os.cpu_count() or 1)) as pool:
        runs = [pool.submit(compared, variant) for variant in variants if not variant.obstacle()]
        for future in as_completed(runs):
            variant, code, seconds, output = future.result()
            summary = output.strip().splitlines()[-1:] or ["no output"]
            ending = "FAILED" if code else "passed"
            print(f"{variant.name:<10} {ending} in {seconds:.0f} s: {summary[0].strip()}", flush=True)
            if code:
                failed, log = True, FOLDER / f"{variant.name}.log"
                log.write_text(output)
                settings = " ".join(f"{key}={value}" for key, value in variant.environment.items())
                print(output[-4000:], f"all of it is in {log}; again: {settings} make golden", sep="\n", flush=True)
    return not failed


def main(arguments: Sequence[str]) -> int:
    """Run the suite; 0 if all variants passed.

    With ``--others``, without the kernels that this processor chooses by itself, under which ``make golden`` ran, and
    the old instructions of BLAS, numba and numpy at once.
    """
    start = time.perf_counter()
    variants: Sequence[Variant] = TESTED
    if "--others" in arguments:
        own = own_kernels()
        if own in (variant.name for variant in TESTED):
            print(f"{own:<10} left out: the choice of this processor", flush=True)
        variants = [variant for variant in TOGETHER if variant.name != own]
    passed = all_pass(variants)
    if passed:
        print(f"golden results agree under all kernels in {time.perf_counter() - start:.0f} s")
    return int(not passed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
