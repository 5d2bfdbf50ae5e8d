"""``make portability``: golden results under the kernels of other processors, two variants side by side."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from tools.portability.variants import FOLDER, TESTED, TOGETHER, Variant, own_kernels

#: The golden results of all components; a variant whose kernels are not compiled does that first.
COMMAND = (sys.executable, "-m", "tools.golden")


@dataclass(frozen=True)
class Outcome:
    """How the results of one variant compare."""

    variant: Variant
    passed: bool
    seconds: float
    output: str


def compared(variant: Variant, command: Sequence[str]) -> Outcome:
    """Run the command under one variant to its end."""
    start = time.perf_counter()
    done = subprocess.run(
        command, env=variant.variables(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    return Outcome(variant, done.returncode == 0, time.perf_counter() - start, done.stdout)


def run_suite(variants: Sequence[Variant] = TESTED, command: Sequence[str] = COMMAND) -> bool:
    """Run a command under each variant that the processor can run; print one line each; whether all passed."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for variant in variants:
        if variant.obstacle():
            print(f"{variant.name:<10} skipped: {variant.obstacle()}", flush=True)
    able = [variant for variant in variants if not variant.obstacle()]
    all_passed = True
    with ThreadPoolExecutor(max_workers=min(2, os.cpu_count() or 1)) as pool:
        for future in as_completed([pool.submit(compared, variant, command) for variant in able]):
            outcome = future.result()
            name, output = outcome.variant.name, outcome.output
            summary = output.strip().splitlines()[-1:] or ["no output"]
            ending = "passed" if outcome.passed else "FAILED"
            print(f"{name:<10} {ending} in {outcome.seconds:.0f} s: {summary[0].strip()}", flush=True)
            if not outcome.passed:
                all_passed = False
                log = FOLDER / f"{name}.log"
                log.write_text(output)
                settings = " ".join(f"{key}={value}" for key, value in outcome.variant.environment.items())
                print(output[-4000:], f"all of it is in {log}; again: {settings} make golden", sep="\n", flush=True)
    return all_passed


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
    passed = run_suite(variants)
    if passed:
        print(f"golden results agree under all kernels in {time.perf_counter() - start:.0f} s")
    return int(not passed)


if __name__ == "__main__":
    Path("build").mkdir(exist_ok=True)
    raise SystemExit(main(sys.argv[1:]))
