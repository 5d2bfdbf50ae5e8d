"""``python -m benchmark.kernels`` leaves no kernel for a run to compile."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from benchmark.kernels.__main__ import PARTS
from tests.kernels import first_party_modules, kernels_of


@pytest.mark.slow
def test_every_kernel_is_compiled_ahead(tmp_path):
    """With an empty cache, which takes most of a minute."""
    command = [sys.executable, "-m", "benchmark.kernels"]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stderr
    assert all(f"{part} done after" in done.stderr for part in PARTS)
    kept = {path.name.partition("-")[0] for path in tmp_path.rglob("*.nbi")}
    kernels = [kernel for module in first_party_modules() for kernel in kernels_of(module)]
    wanted = {
        f"{kernel.__module__.rpartition('.')[2]}.{kernel.__name__}"
        for kernel in kernels
        if kernel.targetoptions.get("inline") != "always"
    }
    assert len(wanted) > 40
    assert sorted(wanted - kept) == []
