"""Methods that crash, hang or run out of memory lose one job, never the run."""

from __future__ import annotations

import os
import shutil

import psutil
import pytest

from benchmark.pipeline.records import read_records
from benchmark.runs import runner
from benchmark.runs.runner import run
from tests.runs.toy import FAULTS, noted, planned, run_toy
from tests.toy import wait_for

FAULTY = (
    "fine", "bug", "exits", "os-exit", "segfault", "hang", "memory", "nan", "short", "picky",
    "refuses", "prints",
)  # fmt: skip

#: Status and reason of each.
ENDINGS = {
    "bug": ("failed", "thick0: faults.py:36: ZeroDivisionError: division by zero"),
    "exits": ("failed", "thick0: faults.py:41: SystemExit: 3"),
    "os-exit": ("crashed", "thick0: the process ended with exit code 3"),
    "segfault": ("crashed", "thick0: the process ended with SIGSEGV"),
    "hang": ("timeout", "thick0: stopped after 4 s; pass a longer --timeout"),
    "memory": ("memory", "thick0: out of memory; run with fewer jobs (-j 1) or on a larger machine"),
    "nan": ("failed", "thick0: faults.py: method 'nan' returned no canonical form"),
    "short": ("failed", "thick0: faults.py: method 'short' returned no canonical form"),
    "refuses": ("failed", "thin0: the first 3 shapes are refused alike: not today"),
}


@pytest.fixture(scope="module")
def faulty(rods, tmp_path_factory):
    """The records of a run of all faults, and the notes of the methods."""
    folder = tmp_path_factory.mktemp("faults")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FAULTS", str(folder))
        patch.setattr(runner, "memory_per_process", lambda processes=1: 3 * 2**29)
        records = run_toy(rods, folder / "results", *FAULTY, size=2, timeout=4.0, plugins=(FAULTS,))
    return records, folder


@pytest.mark.parametrize("name", ENDINGS)
def test_a_fault_ends_its_job_and_says_where(faulty, name):
    record, (status, reason) = faulty[0][name], ENDINGS[name]
    first = {"thick0", "thin0", "thick1", "thin1"}  # which shape is first depends on the workers
    shape, _, rest = record.reason.partition(": ")
    assert (record.status, rest.startswith(reason.partition(": ")[2]), shape in first) == (status, True, True), record


def test_the_others_are_scored_and_a_refused_shape_counts_as_zero(faulty):
    records = faulty[0]
    assert records["fine"].status == records["picky"].status == "ok"
    assert records["picky"].unsupported == [("thick1", "too bent; straighten it")]
    assert records["picky"].coverage == 0.75
    index = records["picky"].shapes.index("thick1")
    assert {name: values[index] for name, values in records["picky"].per_query.items()} == dict.fromkeys(
        records["picky"].scores, 0.0
    )
    assert {record.method for record in read_records(faulty[1] / "results")} == set(FAULTY)


def test_a_method_that_refuses_its_first_three_shapes_alike_sees_no_other(faulty):
    assert len((faulty[1] / "refuses").read_text().split()) <= 3 + 1  # one may be under way


def test_the_traceback_is_kept(faulty):
    assert "in bug\n    return 1 / 0" in faulty[0]["bug"].traceback


def test_children_of_a_stopped_method_end(faulty):
    processes = [int(line) for line in (faulty[1] / "hang").read_text().split()]
    assert processes
    wait_for(lambda: not any(map(psutil.pid_exists, processes)), 2.0)


def test_failed_jobs_run_again_only_when_asked(rods, faulty):
    results = faulty[1] / "results"
    for again, runs in (((), False), (("failed",), True), (("finished", "failed"), True), (("finished",), False)):
        (job,) = planned(rods, results, "bug", plugins=(FAULTS,), again=again)
        assert (job.to_run, job.state) == (runs, "failed")


def test_a_worker_killed_from_outside_is_replaced_busy_or_idle(rods, tmp_path, monkeypatch):
    monkeypatch.setenv("FAULTS", str(tmp_path))
    killed = []

    def kill(progress):
        if not killed and (tmp_path / "waits-once").is_file():
            killed.extend(noted(tmp_path / "waits-once"))
            os.kill(killed[0], 9)

    jobs = planned(rods, tmp_path / "results", "waits-once", "slow", plugins=(FAULTS,))
    records = {}
    for job, record in run(jobs, tmp_path / "results", size=1, timeout=60, watch=kill):
        records[job.record.method] = record
        for child in psutil.Process().children():
            if "benchmark.runs.tasks" in " ".join(child.cmdline()):
                child.kill()  # it is idle, or begins to rank
    assert killed
    assert {record.status for record in records.values()} == {"ok"}
    assert len(records) == 2


def test_what_cannot_be_prepared_is_refused_for_all_and_named_once(rods, tmp_path, capsys):
    folder = shutil.copytree(rods, tmp_path / "rods")
    (folder / "thin2.off").write_text("OFF\n3 1 0\n0 0 0\n")
    records = run_toy(folder, tmp_path / "results", "identity", "surface-area", inputs=("mesh", "view"))
    for record in records.values():
        assert (record.status, record.unprepared, record.coverage) == ("ok", ["thin2"], 0.8)
    assert [line[:30] for line in capsys.readouterr().err.splitlines()] == ["thin2: not a readable off file"]


@pytest.mark.parametrize("stage", ["preparation", "geodesics"])
def test_a_shape_whose_shared_stage_hangs_is_refused_for_all_and_no_method_is_to_blame(
    rods, tmp_path, monkeypatch, stage
):
    monkeypatch.setenv("FAULTS", str(tmp_path))
    monkeypatch.setenv("HANGS", stage)
    records = run_toy(rods, tmp_path / "results", "needs-geodesics", "fine", size=1, timeout=8.0, plugins=(FAULTS,))
    assert {record.status for record in records.values()} == {"ok"}
    refused = [record.unsupported for record in records.values() if record.unsupported]
    reason = f"its {stage}: stopped after 8 s; pass a longer --timeout"
    assert refused in ([[("thick0", reason)]], [[("thick0", reason)]] * 2)
    assert records["needs-geodesics"].unprepared == ["thick0"]
