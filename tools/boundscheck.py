"""``make boundscheck``: run every compiled kernel with bounds checks of all indices.

Compiled code does not check whether an index is inside an array: a write past the end corrupts other memory and may go
unnoticed for years. Here, an index outside an array raises ``IndexError``. The run also fails if a kernel is run by no
test marked ``kernels``.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

FOLDER = Path("build/boundscheck")
#: Settings that numba reads on import. The cache is separate and starts empty, because kernels of other runs were
#: compiled without checks, and a cached kernel does not tell which others it calls. Low optimisation compiles faster
#: and does not change indices.
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
    """Return whether a kernel that reads one element past the end raises an error."""
    try:
        numba.njit(lambda array: array[array.size])(np.zeros(3))
    except IndexError:
        return True
    return False


if __name__ == "__main__":
    sys.exit(main())
