"""Faults of methods: each costs its own job, and the record says what happened."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.toy import write_rods

ROOT = Path(__file__).parents[2]

FAULTS = """
import os
import signal
import time

import numpy as np

from benchmark.contracts import UnsupportedShape, canonical_form


@canonical_form(name="hang", title="Hang")
def hang(shape):
    time.sleep(3600)


@canonical_form(name="segfault", title="Segfault")
def segfault(shape):
    os.kill(os.getpid(), signal.SIGSEGV)


@canonical_form(name="glutton", title="Glutton")
def glutton(shape):
    eaten = [np.empty(2**27) for _ in range(1000)]
    return eaten[0]


@canonical_form(name="bug", title="Bug")
def bug(shape):
    return 1 / 0


@canonical_form(name="nan", title="NaN")
def nan(shape):
    return shape.mesh.vertices * np.nan


@canonical_form(name="picky", title="Picky")
def picky(shape):
    if shape.identifier == "thin2":
        raise UnsupportedShape("too thin", "feed it")
    return shape.mesh.vertices


@canonical_form(name="silent-exit", title="Silent exit")
def silent_exit(shape):
    os._exit(3)
"""


def benchmark(*arguments, **options):
    command = [sys.executable, "-m", "benchmark", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=280, check=False, **options)


def records(results):
    found = [json.loads(path.read_text()) for path in (results / "runs" / "records").glob("*.json")]
    return {record["method"]: record for record in found}


@pytest.fixture(scope="module")
def faulty_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("faults")
    write_rods(folder / "rods", bends=(0.0, 1.0, 2.0))
    (folder / "faults.py").write_text(FAULTS)
    arguments = ("-d", folder / "rods", "--input", "mesh", "-m", "surface-area", "--plugin", folder / "faults.py")
    done = benchmark("run", *arguments, "--results", folder / "results", "-j", 2, "--timeout", "25s")
    return folder, arguments, done, records(folder / "results")


@pytest.mark.slow
def test_each_fault_costs_its_own_job(faulty_run):
    _, _, done, found = faulty_run
    statuses = {name: record["status"] for name, record in found.items()}
    assert statuses == {
        "surface-area": "ok",
        "hang": "timeout",
        "segfault": "crashed",
        "glutton": "memory",
        "bug": "failed",
        "nan": "unsupported",
        "picky": "ok",
        "silent-exit": "crashed",
    }
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr


@pytest.mark.slow
def test_each_record_says_what_happened_and_what_to_do(faulty_run):
    _, _, done, found = faulty_run
    assert "longer --timeout" in found["hang"]["reason"]
    assert "SIGSEGV" in found["segfault"]["reason"]
    assert "exit code 3" in found["silent-exit"]["reason"]
    assert found["bug"]["reason"] == "ZeroDivisionError: division by zero"
    assert "1 / 0" in found["bug"]["traceback"]
    assert "NaN" in found["nan"]["reason"]
    assert found["picky"]["unsupported"] == [["thin2", "too thin; feed it"]]
    assert found["picky"]["n_shapes"] == 5
    assert "Picky, mesh: 1 unsupported (thin2): too thin; feed it" in done.stdout


@pytest.mark.slow
def test_failures_are_kept_and_repeated_only_when_asked(faulty_run):
    folder, arguments, _, _ = faulty_run
    again = benchmark("run", *arguments, "--results", folder / "results", "--timeout", "25s")
    assert again.stdout.startswith("0 of 8 jobs to run, 2 finished before")
    assert again.returncode == 1
    plan = benchmark("plan", *arguments, "--results", folder / "results").stdout
    assert "timeout: stopped after 25 s" in plan
    retried = benchmark("run", *arguments, "--results", folder / "results", "--retry", "crashed")
    assert retried.stdout.startswith("2 of 8 jobs to run")


@pytest.mark.slow
def test_an_interrupt_keeps_finished_jobs_and_exits_130(tmp_path):
    write_rods(tmp_path / "rods")
    (tmp_path / "faults.py").write_text(FAULTS)
    arguments = ["-d", tmp_path / "rods", "--input", "mesh", "-m", "surface-area", "--results", tmp_path / "results"]
    assert benchmark("run", *arguments).returncode == 0
    command = [sys.executable, "-m", "benchmark", "run", *arguments, "--plugin", tmp_path / "faults.py", "-j", "1"]
    process = subprocess.Popen(
        list(map(str, command)), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    time.sleep(6)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "finished jobs are kept" in error
    assert records(tmp_path / "results")["surface-area"]["status"] == "ok"
