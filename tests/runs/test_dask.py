"""Jobs on a dask cluster of real processes under nannies, one of which is killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from benchmark.errors import ConfigurationError
from tests.runs.test_faults import wait_for
from tests.runs.toy import FAULTS, done, planned, run_toy

pytest.importorskip("distributed", reason="needs dask: pip install 'dask[distributed]'")

pytestmark = pytest.mark.slow


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """Return the address of a scheduler with two workers under nannies, and the processes."""
    monkeypatch.setenv("FAULTS", str(tmp_path))
    place = tmp_path / "scheduler.json"
    environment = {**os.environ, "PYTHONPATH": str(Path.cwd())}

    def start(program, *arguments):
        command = [sys.executable, "-m", f"distributed.cli.{program}", *map(str, arguments), "--no-dashboard"]
        return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    programs = [start("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", place)]
    while not place.is_file():
        time.sleep(0.1)
    address = json.loads(place.read_text())["address"]
    for number in range(2):
        programs.append(start("dask_worker", address, "--nthreads", 1, "--local-directory", tmp_path / f"disk{number}"))
    yield address
    for program in programs:
        for process in [*psutil.Process(program.pid).children(recursive=True), program]:
            process.kill()


def test_rows_are_those_of_one_machine_though_a_worker_is_killed(rods, tmp_path, cluster):
    jobs = planned(rods, tmp_path / "results", "slow", "surface-area", "bug", "segfault", plugins=(FAULTS,))
    killed = []

    def kill(progress):
        if not killed and (tmp_path / "slow").is_file():
            worker = psutil.Process(wait_for(tmp_path / "slow")[0]).parent()
            killed.append(worker.pid)
            os.kill(worker.pid, signal.SIGKILL)

    records = done(jobs, tmp_path / "results", dask=cluster, watch=kill)
    here = run_toy(rods, tmp_path / "here", "slow", "surface-area", plugins=(FAULTS,))
    assert killed
    assert {name: record.status for name, record in records.items()} == {
        "slow": "ok", "surface-area": "ok", "bug": "failed", "segfault": "crashed",
    }  # fmt: skip
    for name, record in here.items():
        assert (records[name].scores, records[name].per_query) == (record.scores, record.per_query)


def test_a_scheduler_that_does_not_answer_is_named(rods, tmp_path, monkeypatch):
    jobs = planned(rods, tmp_path / "results", "surface-area")
    with pytest.raises(ConfigurationError, match=r"no dask scheduler answers at tcp://127.0.0.1:9; start one"):
        done(jobs, tmp_path / "results", dask="tcp://127.0.0.1:9")
