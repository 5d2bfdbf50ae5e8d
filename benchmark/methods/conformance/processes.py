"""Checks that a method answers the same in processes of their own, and on another processor."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.api.contracts import FloatArray
from benchmark.methods.conformance.case import (
    REPEAT_TOLERANCE,
    ConformanceCase,
    Failed,
    Skipped,
    Warned,
    explain,
    relative_difference,
    same,
)
from benchmark.methods.registry import MethodSpec
from benchmark.system.calls import BrokenCall, Guard, call_apart
from benchmark.system.text import DATA_VARIABLE

KERNEL = "OPENBLAS_CORETYPE"

#: Kernel that every x86-64 processor of today can run, and none would choose.
OLD_KERNEL = "Nehalem"


def check_fresh_process(case: ConformanceCase) -> str:
    """Return whether another process answers the same, and to the last bit."""
    found = _elsewhere(case)
    same(case.reference, found, "another process answers differently; do not depend on hashes, globals or the clock")
    if found.tobytes() == case.reference.tobytes():
        return "made again elsewhere, it answers the same to the last bit"
    # This process has done other work before, so only two fresh ones can be expected to agree in every bit.
    again = _elsewhere(case)
    if found.tobytes() == again.tobytes():
        return "every fresh process answers the same to the last bit"
    raise Warned(
        f"two processes differ by {relative_difference(found, again):.1e} of the largest number; choices that follow "
        "may go another way each time: give iterative solvers a fixed start (v0=...), draw from shape.random()"
    )


def check_other_processor(case: ConformanceCase) -> str:
    """Return whether the answer survives other rounding errors: those of the BLAS kernel of another processor."""
    if platform.machine().lower() not in ("x86_64", "amd64"):
        raise Skipped("the kernel of another processor can be chosen on x86-64 only")
    kernel = "" if os.environ.get(KERNEL) == OLD_KERNEL else OLD_KERNEL
    found = _elsewhere(case, kernel=kernel)
    called = f"the BLAS kernel {kernel}" if kernel else "the processor's own BLAS kernel"
    if found.shape != case.reference.shape:
        raise Warned(f"{called} makes {found.shape} of {case.reference.shape}; a choice hangs on the last bits")
    if found.tobytes() == case.reference.tobytes():
        return f"{called} changes no bit"
    difference = relative_difference(case.reference, found)
    if difference <= REPEAT_TOLERANCE:
        return f"{called} changes {difference:.1e} of the largest number, too little to be seen by the scorer"
    raise Warned(
        f"{called} changes {difference:.1e} of the largest number, so scores will differ between machines; where a "
        "choice hangs on the last bits, break ties by geometry and leave thresholds a margin"
    )


def _elsewhere(case: ConformanceCase, kernel: str | None = None) -> FloatArray:
    """Answer for the figure in a new process, under another BLAS kernel if one is named; "" is the default one."""
    try:
        with _environment(kernel):
            found = call_apart(_answer, case.spec, case.model, guard=Guard("the method", "find the crash"))
    except BrokenCall as error:
        raise Failed(
            "the process ended before it answered; find the crash, or guard your script by if __name__ == '__main__'"
        ) from error
    if "fault" in found:
        raise Failed(found["fault"])
    return np.array(found["numbers"], dtype=np.float64)


def _answer(spec: MethodSpec, model: Path | None) -> dict[str, Any]:
    """The answer as JSON can carry it, which keeps every bit of a number, or what is wrong with it."""
    hide_data()
    try:
        return {"numbers": ConformanceCase(spec, model).reference.tolist()}
    except BaseException as error:  # also what ends a program
        return {"fault": explain(error)}


def hide_data() -> None:
    """Let no file of the data folder be found in this process: what a method needs of a shape, the shape offers."""
    folder = os.environ.pop(DATA_VARIABLE, "")
    if not folder:
        return
    hidden = Path(folder).resolve()

    def refuse(event: str, arguments: tuple[Any, ...]) -> None:
        if event in ("open", "os.listdir", "os.scandir") and isinstance(arguments[0], (str, bytes, os.PathLike)):
            path = Path(os.fsdecode(arguments[0])).resolve()
            if path.is_relative_to(hidden):
                raise FileNotFoundError(f"{path}: the data folder is hidden, for a method gets all it may know")

    sys.addaudithook(refuse)


@contextmanager
def _environment(kernel: str | None) -> Iterator[None]:
    """Name a BLAS kernel to the processes that are started inside; libraries that are loaded here do not notice."""
    before = os.environ.get(KERNEL)
    if kernel is not None:
        os.environ.pop(KERNEL, None)
        if kernel:
            os.environ[KERNEL] = kernel
    try:
        yield
    finally:
        os.environ.pop(KERNEL, None)
        if before is not None:
            os.environ[KERNEL] = before
