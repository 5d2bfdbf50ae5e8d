"""The suite under several kernels: what runs, what is skipped, and that one failure fails it."""

import os
import subprocess
import sys

import pytest

from tools.portability import suite, variants
from tools.portability.variants import GENERIC, HASWELL, NEHALEM, SKYLAKEX, TESTED, TOGETHER, Variant

PRINT = (sys.executable, "-c", "import os; print(os.environ['WHO'])")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(variants, "FOLDER", tmp_path)
    monkeypatch.setattr(suite, "FOLDER", tmp_path)
    return tmp_path


def named(name: str, **environment: str) -> Variant:
    return Variant(name, {"WHO": name, **environment})


def test_each_variant_runs_in_its_environment_and_has_a_line(capsys):
    assert suite.run_suite([named("first"), named("second"), named("third")], PRINT)
    lines = sorted(capsys.readouterr().out.splitlines())
    assert [line.split()[0] for line in lines] == ["first", "second", "third"]
    assert all(" passed in " in line and line.endswith(f" s: {line.split()[0]}") for line in lines)


def test_a_failure_fails_and_leaves_its_output(capsys, folder):
    command = (
        sys.executable,
        "-c",
        "import os; print(os.environ['WHO']); raise SystemExit(3 * (os.environ['WHO'] == 'bad'))",
    )
    assert not suite.run_suite([named("first"), named("bad"), named("later")], command)
    out = capsys.readouterr().out
    assert "bad        FAILED in" in out
    assert "WHO=bad make golden" in out
    assert "later      passed in" in out
    assert (folder / "bad.log").read_text() == "bad\n"


def test_what_the_processor_lacks_is_skipped_and_said(capsys, monkeypatch):
    monkeypatch.setattr(variants.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(variants, "processor_flags", lambda: frozenset({"avx2", "fma"}))
    assert [variant.name for variant in TESTED if variant.obstacle()] == ["SkylakeX"]
    assert suite.run_suite([SKYLAKEX], PRINT)
    assert capsys.readouterr().out.startswith("SkylakeX   skipped: the processor has no avx512bw, avx512cd")


def test_kernels_of_blas_are_for_x86_alone(monkeypatch):
    monkeypatch.setattr(variants.platform, "machine", lambda: "arm64")
    assert NEHALEM.obstacle() == "no x86-64 processor"
    assert not GENERIC.obstacle()


def test_code_for_no_processor_in_particular_has_a_cache_of_its_own():
    assert GENERIC.variables()["NUMBA_CACHE_DIR"] != os.environ.get("NUMBA_CACHE_DIR")
    assert SKYLAKEX.variables().get("NUMBA_CACHE_DIR") == os.environ.get("NUMBA_CACHE_DIR")
    assert GENERIC.variables()["NUMBA_CPU_NAME"] == "generic"
    assert GENERIC.variables()["PATH"] == os.environ["PATH"]


@pytest.mark.skipif(bool(NEHALEM.obstacle()), reason="BLAS has no kernels to choose from")
@pytest.mark.parametrize("variant", [NEHALEM, HASWELL], ids=lambda variant: variant.name)
def test_the_kernels_that_blas_chose_are_told_and_left_out_on_demand(variant, capfd):
    if variant.obstacle():
        pytest.skip(variant.obstacle())
    program = (
        "from tools.portability import suite; suite.run_suite = lambda variants: print(*(v.name for v in variants));"
        "suite.main(['--others'])"
    )
    subprocess.run([sys.executable, "-c", program], env=variant.variables(), check=True)
    said, names = capfd.readouterr().out.splitlines()[:2]
    assert said.split()[0] == variant.name
    assert names.split() == [each.name for each in TOGETHER if each is not variant]
