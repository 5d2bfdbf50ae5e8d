"""What a plugin imports: one place, and the former ones with a warning."""

import importlib
import subprocess
import sys

import pytest

import benchmark.api

FORMER = {name: name for name in ("contracts", "learning", "scoring", "streaming")} | {"datasets.contract": "datasets"}


@pytest.mark.parametrize("former", FORMER)
def test_a_former_module_warns_and_has_the_same_names(former):
    sys.modules.pop(f"benchmark.{former}", None)
    with pytest.warns(DeprecationWarning, match="import from benchmark.api"):
        old = importlib.import_module(f"benchmark.{former}")
    new = importlib.import_module(f"benchmark.api.{FORMER[former]}")
    assert all(getattr(old, name) is getattr(new, name) is getattr(benchmark.api, name) for name in new.__all__)


def test_a_name_that_nobody_has_is_told():
    with pytest.raises(AttributeError, match="no attribute 'canonical_from'"):
        _ = benchmark.api.canonical_from


def test_a_method_does_not_import_what_learners_and_harness_need():
    code = "import sys; from benchmark.api import Shape, MethodInfo; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "benchmark.api.contracts" in loaded
    assert not {"benchmark.api.learning", "benchmark.jobs", "torch"} & set(loaded)
