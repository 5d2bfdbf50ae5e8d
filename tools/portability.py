"""``make portability``: compare golden results with the kernels of other processors, two variants in parallel.

Environment variables select the kernels of BLAS, numba, NumPy and torch.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
from threadpoolctl import threadpool_info

#: Folder for compiled code and logs.
FOLDER = Path("build/portability")
CPUINFO = Path("/proc/cpuinfo")


class Variant(NamedTuple):
    """BLAS kernels, processor flags that they need, and optionally instructions of 2008 for numba, NumPy and torch."""

    name: str
    blas: str = ""
    flags: str = ""
    numba: str = ""
    numpy: str = ""

    def settings(self) -> dict[str, str]:
        """Return environment variables; code that numba compiles for another processor has a separate cache."""
        cache = str((FOLDER / "numba-generic").resolve()) if self.numba else ""
        values = {
            "OPENBLAS_CORETYPE": self.blas, "NUMBA_CPU_NAME": self.numba, "NUMBA_CACHE_DIR": cache,
            "NPY_DISABLE_CPU_FEATURES": self.numpy, "MKL_CBWR": cache and "COMPATIBLE",
            "ATEN_CPU_CAPABILITY": cache and "default", "ONEDNN_MAX_CPU_ISA": cache and "SSE41",
        }  # fmt: skip
        return {name: value for name, value in values.items() if value}

    def obstacle(self) -> str:
        """Return the reason why the processor cannot run this variant; "" if it can."""
        if self.blas and platform.machine().lower() not in ("x86_64", "amd64"):
            return "no x86-64 processor"
        known = CPUINFO.read_text().split() if CPUINFO.is_file() else []
        missing = [flag for flag in self.flags.split() if flag not in known]
        return f"the processor has no {', '.join(missing)}" if missing else ""


AVX512 = "avx512f avx512cd avx512bw avx512dq avx512vl"
DISPATCHED = " ".join(name for name in __cpu_dispatch__ if __cpu_features__.get(name))
#: Instructions of 2008 in all libraries.
OLDEST = Variant("oldest", "Nehalem", numba="generic", numpy=DISPATCHED)
#: Without Zen, whose kernels differ from those of Haswell only in block sizes.
VARIANTS = (OLDEST, Variant("Haswell", "Haswell", "avx2 fma"), Variant("SkylakeX", "SkylakeX", AVX512))


def passes(variant: Variant) -> bool:
    """Compare the golden results with one variant, and print the outcome."""
    start, log = time.perf_counter(), FOLDER / f"{variant.name}.log"
    command, settings = [sys.executable, "-m", "tools.golden"], variant.settings()
    with log.open("w") as output:
        code = subprocess.run(command, env={**os.environ, **settings}, stdout=output, stderr=output).returncode
    text, ending = log.read_text(), "FAILED" if code else "passed"
    summary = (text.strip().splitlines() or ["no output"])[-1].strip()
    print(f"{variant.name:<10} {ending} in {time.perf_counter() - start:.0f} s: {summary}", flush=True)
    if code:
        variables = " ".join(f"{name}={value}" for name, value in settings.items())
        print(text[-4000:], f"all of it is in {log}; again: {variables} make golden", sep="\n", flush=True)
    return not code


def main() -> int:
    """Return 0 if golden results agree with all kernels that the processor supports but does not choose by default."""
    start = time.perf_counter()
    np.zeros((2, 2)) @ np.zeros((2, 2))
    own = {library.get("architecture") for library in threadpool_info() if library["user_api"] == "blas"}
    obstacles = {variant: variant.obstacle() for variant in VARIANTS if variant.name not in own}
    for variant, obstacle in obstacles.items():
        if obstacle:
            print(f"{variant.name:<10} skipped: {obstacle}", flush=True)
    FOLDER.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(max_workers=min(2, psutil.cpu_count() or 1)) as pool:
        outcomes = list(pool.map(passes, [variant for variant, obstacle in obstacles.items() if not obstacle]))
    if all(outcomes):
        print(f"golden results agree under all kernels in {time.perf_counter() - start:.0f} s")
    return int(not all(outcomes))


if __name__ == "__main__":
    sys.exit(main())
