"""The kernels of a run are compiled once, by one process, before its workers start."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from unittest.mock import patch

import pytest

from benchmark.commands.kernels import compile_kernels_of, kernel_uses
from benchmark.commands.plan import plan
from benchmark.commands.run import run_plan
from benchmark.kernel_cache import VARIABLE, mark
from tests.runs.toy import LIGHT, without_processes
from tests.verbs import call


@pytest.fixture
def started(tmp_path, monkeypatch):
    """Names of the steps whose kernels programs were to compile, where none is compiled yet."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "kernels"))
    programs = []
    with patch("benchmark.commands.kernels.subprocess") as replaced:
        replaced.run.side_effect = lambda words, **_: programs.append(words[3:])
        yield programs


def planned_on(rods, results, *methods):
    return plan(str(rods), methods, input="mesh", results=results)


def test_one_program_compiles_what_the_selection_needs_and_nothing_else(rods, tmp_path, started):
    compile_kernels_of(planned_on(rods, tmp_path, "classic-mds"))
    (names,) = started
    assert {"classic-mds", "cm-bof"} <= {*names}
    assert {*names} <= {"classic-mds", "cm-bof", "preparation of mesh"}


def test_every_run_of_a_plan_compiles_its_kernels_first_but_for_a_cluster(rods, tmp_path, started):
    planned = planned_on(rods, tmp_path, "classic-mds")
    run_plan(planned, dask="tcp://nobody:1")
    assert started == []
    run_plan(planned)
    assert "classic-mds" in started[0]


def test_kernels_that_were_compiled_are_not_compiled_again(rods, tmp_path, started):
    for use in kernel_uses(["classic-mds", "cm-bof", "preparation of mesh"]):
        mark(use.name, use.source)
    compile_kernels_of(planned_on(rods, tmp_path, "classic-mds"))
    assert started == []
    compile_kernels_of(planned_on(rods, tmp_path, "classic-mds", "skeleton"))
    assert started == [["skeleton"]]


def test_a_use_is_marked_when_it_is_compiled_although_a_method_refuses_the_figure(started):
    (use,) = kernel_uses(["classic-mds"])
    assert not use.is_compiled
    use._replace(compute=lambda: None).compile()
    assert use.is_compiled


def test_a_selection_that_is_finished_compiles_nothing(rods, tmp_path, started):
    with without_processes():
        words = ["-d", rods, "--input", "mesh", "-m", "identity", "--results", tmp_path]
        call("run", *words, *LIGHT)
        started.clear()
        call("run", *words, *LIGHT)
    assert started == []


def test_networks_have_no_kernels():
    names = {use.name for use in kernel_uses()}
    assert {"classic-mds", "humans-scanlike", "cm-bof"} <= names
    assert not any(name.startswith("learned") for name in names)


@pytest.mark.slow
def test_workers_of_a_first_run_compile_no_kernel_twice(rods, tmp_path):
    words = ["run", "-d", rods, "--input", "mesh", "-m", "classic-mds", "-j", 2]
    command = [sys.executable, "-m", "benchmark", *words, *LIGHT, "--results", tmp_path / "results"]
    environment = os.environ | {VARIABLE: str(tmp_path / "kernels"), "NUMBA_DEBUG_CACHE": "1"}
    done = subprocess.run(
        [*map(str, command)], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    saved = Counter(re.findall(r"data saved to '(.*?)'", done.stdout + done.stderr))
    assert len(saved) > 3
    assert [file for file, count in saved.items() if count > 1] == []
    assert "compiling kernels: 1 of " in done.stderr
