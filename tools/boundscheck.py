"""``make boundscheck``: run every compiled kernel once with each index checked against the bounds of its array.

Compiled code does not look whether an index lies inside an array: a write past the end changes foreign memory and may
go unnoticed for years. Here an index outside an array raises ``IndexError``, and a kernel that no test marked
``kernels`` reaches fails the run.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

FOLDER = Path("build/boundscheck")
#: Read by numba when it is imported. Kernels of other runs were compiled without the checks, and a kernel that comes
#: from a cache does not say which others it calls: hence a cache of its own, empty at the start.
#: Indices are the same however fast the code: it is compiled quickly.
os.environ |= {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(FOLDER.absolute()), "NUMBA_OPT": "1"}

import numba  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402

from tests.kernels import first_party_modules, kernels_of, was_compiled  # noqa: E402


def main() -> int:
    """Run the tests marked ``kernels`` with checked indices; return the exit code."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    if not planted_overrun_is_caught():
        print("indices are not checked: did something import numba before?")
        return 1
    code = int(pytest.main(["-m", "kernels and not slow and not exhaustive", *sys.argv[1:]]))
    kernels = [kernel for module in first_party_modules() for kernel in kernels_of(module)]
    missed = [f"{kernel.__module__}.{kernel.__name__}" for kernel in kernels if not was_compiled(kernel)]
    print(f"{len(kernels) - len(missed)} of {len(kernels)} kernels ran with checked indices")
    for name in missed:
        print(f"no test marked 'kernels' runs {name}")
    return code or int(bool(missed) or not kernels)


def planted_overrun_is_caught() -> bool:
    """Whether a kernel that reads one place too far raises an error."""
    try:
        numba.njit(lambda array: array[array.size])(np.zeros(3))
    except IndexError:
        return True
    return False


if __name__ == "__main__":
    sys.exit(main())
