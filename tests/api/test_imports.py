"""What a plugin imports."""

import subprocess
import sys

import pytest

import benchmark.api


def test_a_name_that_nobody_has_is_told():
    with pytest.raises(AttributeError, match="no attribute 'canonical_from'"):
        _ = benchmark.api.canonical_from


def test_a_method_does_not_import_what_learners_and_harness_need():
    code = "import sys; from benchmark.api import Shape, MethodInfo; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "benchmark.api.contracts" in loaded
    assert not {"benchmark.api.learning", "benchmark.execution", "benchmark.pipeline", "torch"} & set(loaded)
