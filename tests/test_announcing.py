"""Kernels that are compiled are named, those of the suite alone."""

from __future__ import annotations

import os
import subprocess
import sys

PROGRAM = """
import numpy as np
from benchmark.kernel_cache.announcing import announce_compilation
announce_compilation()
announce_compilation()
from benchmark.geometry.rasterise import depth_buffer
{call}
"""


def test_a_kernel_is_named_while_it_is_compiled_and_not_again(tmp_path):
    call = (
        "from tests.toy import rod\n"
        "from benchmark.geometry.camera import FRONT\n"
        "from benchmark.geometry.depth import render_depth\n"
        "render_depth(rod(0.1, 0.5), FRONT, 1.0)"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    told = []
    for _ in range(2):
        words = [sys.executable, "-c", PROGRAM.format(call=call)]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
        told.append(done.stderr)
    assert told == ["compiling kernel 1, draw_triangles of rasterise, once\n", ""]
