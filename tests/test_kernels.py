"""Compiled kernels go when a module is newer whose kernels or constants are part of them."""

import os

import pytest

from benchmark.kernels import compiled_files, drop_stale_kernels

KERNEL = """from numba import njit
from baselines.{origin} import {name}


@njit
def kernel(x):
    return x
"""

FILES = {
    "constants.py": "HALF = 0.5\n\n\ndef unrelated():\n    return 1\n",
    "inner.py": KERNEL.format(origin="constants", name="HALF"),
    "outer.py": KERNEL.format(origin="inner", name="kernel"),
    "alone.py": KERNEL.format(origin="constants", name="unrelated"),
}


@pytest.fixture
def suite(tmp_path):
    folder = tmp_path / "baselines"
    (folder / "__pycache__").mkdir(parents=True)
    for name, text in FILES.items():
        (folder / name).write_text(text)
        os.utime(folder / name, (1000, 1000))
    for name in ("inner", "outer", "alone"):
        for ending in (".nbi", ".1.nbc"):
            path = folder / "__pycache__" / f"{name}.{name}-1.py311{ending}"
            path.write_text("")
            os.utime(path, (2000, 2000))
    return tmp_path


def kept(suite):
    return {source.stem for source, _ in compiled_files(suite)}


@pytest.mark.parametrize(
    ("edited", "expected"),
    [
        ("constants.py", {"alone"}),
        ("inner.py", {"alone"}),
        ("outer.py", {"alone", "inner"}),
        ("alone.py", {"inner", "outer"}),
    ],
)
def test_what_was_compiled_from_older_code_goes(suite, edited, expected):
    drop_stale_kernels(suite)
    os.utime(suite / "baselines" / edited, (3000, 3000))
    drop_stale_kernels(suite)
    assert kept(suite) == expected
