"""Jobs on a dask cluster of real processes under nannies, one of which is killed."""

from __future__ import annotations

import os
import signal

import psutil
import pytest

from benchmark.errors import ConfigurationError
from tests.runs.toy import FAULTS, done, noted, planned, run_toy

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def distributed():
    return pytest.importorskip("distributed", reason="needs dask: pip install 'dask[distributed]'")


@pytest.fixture
def cluster(distributed, tmp_path, monkeypatch):
    """Return the address of a scheduler with two workers under nannies."""
    monkeypatch.setenv("FAULTS", str(tmp_path))
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "local_directory": tmp_path}
    with distributed.LocalCluster(**options) as cluster:
        yield cluster.scheduler_address


def test_rows_are_those_of_one_machine_though_a_worker_is_killed(rods, tmp_path, cluster):
    jobs = planned(rods, tmp_path / "results", "slow", "surface-area", "bug", "segfault", plugins=(FAULTS,))
    killed = []

    def kill(progress):
        if not killed and (tmp_path / "slow").is_file():
            worker = psutil.Process(noted(tmp_path / "slow")[0]).parent()
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
