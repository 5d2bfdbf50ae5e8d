"""Runs that are interrupted, killed, or meet a disk that is full."""

from __future__ import annotations

import re
import shutil
import signal
from bdb import BdbQuit

import psutil
import pytest

from benchmark.errors import BenchmarkError
from benchmark.machine import describe_machine
from benchmark.pipeline.cache import StorageError, writing
from benchmark.pipeline.record_files import read_records
from benchmark.registry.modules import import_plugins_anew
from benchmark.runs.planning import estimate
from benchmark.runs.runner import run_jobs
from tests.behaviour.suite import start
from tests.runs.toy import (
    FAULTS,
    LIGHT,
    LateStagesFirst,
    ThisProcess,
    done,
    noted,
    planned,
    run_toy,
)
from tests.toy import PATIENCE, files_of_at_most, wait_for


@pytest.fixture
def started(rods, tmp_path, monkeypatch):
    """A run of a waiting method as a program of its own, with its workers, once it is at work."""
    monkeypatch.setenv("FAULTS", str(tmp_path))
    for name in ("random", "queue"):  # which replace no module of Python
        (tmp_path / f"{name}.py").write_text("1 / 0")
    words = ("-d", rods, "-m", "waits-once", "--plugin", FAULTS, "--input", "mesh", *LIGHT, "-j", 2)
    program = start("run", *words, cwd=tmp_path)
    noted(tmp_path / "waits-once")
    return program, [worker.pid for worker in psutil.Process(program.pid).children()]


def is_gone(process):
    return (
        not psutil.pid_exists(process) or psutil.Process(process).status() == psutil.STATUS_ZOMBIE
    )


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_a_run_that_is_stopped_ends_at_once_says_so_and_keeps_what_is_done(
    started, rods, tmp_path, number
):
    program, workers = started
    assert len(workers) >= 2  # one of the suite waits while the plugin runs
    program.send_signal(number)
    error = program.communicate(timeout=PATIENCE)[1]
    assert (program.returncode, "Traceback" in error) == (130, False), error
    assert re.search("interrupted.*run again", error)
    wait_for(lambda: all(map(is_gone, workers)))
    kept = {
        path: path.stat().st_mtime_ns
        for path in (tmp_path / "results" / "runs" / "prepared").iterdir()
    }
    import_plugins_anew()  # it writes its notes elsewhere in this process
    record = run_toy(rods, tmp_path / "results", "waits-once", plugins=(FAULTS,))["waits-once"]
    assert record.status == "ok"
    assert kept == {path: path.stat().st_mtime_ns for path in kept} != {}


def test_workers_end_with_a_program_that_is_killed(started, tmp_path):
    program, workers = started
    program.kill()
    program.communicate()
    wait_for(lambda: all(map(is_gone, workers)))
    with writing(
        tmp_path / "results"
    ):  # its lock ended with it, and so did what it left half-written
        assert not list((tmp_path / "results" / "runs").rglob("*.tmp"))


def test_a_second_run_in_a_folder_is_refused(rods, tmp_path):
    with (
        writing(tmp_path),
        pytest.raises(StorageError, match="another run is writing to .*; wait for its end"),
    ):
        run_toy(rods, tmp_path, "surface-area")


@pytest.mark.parametrize("workers", [ThisProcess(), None], ids=["this process", "a worker"])
def test_a_full_disk_ends_the_run_with_one_line(rods, tmp_path, workers):
    jobs = planned(rods, tmp_path, "surface-area")
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    with (
        files_of_at_most(100),
        pytest.raises(BenchmarkError, match="cannot write to .*File too large; free some space"),
    ):
        list(run_jobs(jobs, tmp_path, workers=workers))
    assert run_toy(rods, tmp_path, "surface-area")["surface-area"].status == "ok"


@pytest.fixture(scope="module")
def finished(rods, tmp_path_factory):
    """The folder of a finished run, to be read only, and its record."""
    folder = tmp_path_factory.mktemp("finished")
    return folder, run_toy(rods, folder, "identity")["identity"]


@pytest.mark.parametrize(
    ("stage", "damage"),
    [
        ("prepared", "truncated"),
        ("forms", "flipped"),
        ("signatures", "empty"),
        ("records", "flipped"),
        ("*", "empty"),
    ],
)
def test_a_damaged_file_of_any_kind_is_made_again(rods, finished, tmp_path, stage, damage):
    results, before = shutil.copytree(finished[0], tmp_path / "results"), finished[1]
    for path in sorted((results / "runs").glob(f"{stage}/*.npz"))[: None if stage == "*" else 1]:
        content = bytearray(path.read_bytes())
        middle = len(content) // 2
        content[middle] ^= 255
        path.write_bytes({"truncated": content[:middle], "flipped": content, "empty": b""}[damage])
    jobs = planned(rods, results, "identity", rerun=("finished",))
    states = []
    after = done(jobs, results, workers=ThisProcess(), watch=states.append)["identity"]
    assert (after.scores, after.per_query) == (before.scores, before.per_query)
    assert all(0 <= state.done <= state.total for state in states)


def test_a_file_waits_for_every_damaged_one_that_it_is_made_from(rods, finished, tmp_path):
    """Signatures take surfaces from prepared shapes, too; forms are there and whole."""
    results, before = shutil.copytree(finished[0], tmp_path / "results"), finished[1]
    for path in (results / "runs" / "prepared").iterdir():
        path.write_bytes(b"damaged")
    shutil.rmtree(results / "runs" / "signatures")
    jobs = planned(rods, results, "identity", rerun=("finished",))
    after = done(jobs, results, workers=LateStagesFirst())["identity"]
    assert (after.status, after.per_query) == ("ok", before.per_query)


def test_a_plan_says_that_a_plugin_ran_in_this_process(rods, tmp_path):
    options = {"plugins": (FAULTS,), "scorer": "cm-bof"}
    (job,) = planned(rods, tmp_path, "last-three", in_this_process=True, **options)
    (again,) = planned(rods, tmp_path, "last-three", records=[job.record], **options)
    assert (again.state, again.reason[:50]) == (
        "stale",
        "it ran in the process of a program, or with -j 0, ",
    )


def test_a_debugger_works_in_this_process_and_its_end_is_nobodys_fault(rods, tmp_path, monkeypatch):
    def quits():
        raise BdbQuit

    monkeypatch.setattr("sys.breakpointhook", quits)
    for method, error in (("debugged", BdbQuit), ("interrupts", KeyboardInterrupt)):
        with pytest.raises(error):
            run_toy(rods, tmp_path / "results", method, plugins=(FAULTS,))
    assert not read_records(tmp_path / "results")


def test_workers_and_this_process_make_the_same_record(rods, tmp_path):
    made, seen = [], []
    for place, options in (("here", {"workers": ThisProcess()}), ("worker", {"size": 1})):
        results = tmp_path / place
        jobs = planned(rods, results, "classic-mds", "shape-dna") + planned(
            rods, results, "gps", input="view"
        )
        records = done(jobs, results, watch=seen.append, **options)
        made.append({name: (r.key, r.scores, r.per_query) for name, r in records.items()})
        assert {tuple(record.machines) for record in records.values()} == {(describe_machine(),)}
    assert made[0].keys() == {"classic-mds", "shape-dna", "gps"}
    assert made[0] == made[1]
    steps = (
        3 * 4 + 1 + 3 * 4 + 2 * 4
    )  # shapes prepared for each method and a frame, forms and descriptors, signatures
    assert (seen[-1].done, seen[-1].total) == (steps, steps)
    assert any("gps, " in name for progress in seen for name in progress.working)


def test_an_estimate_takes_the_seconds_of_finished_jobs_and_shared_stages_once(rods, tmp_path):
    run_toy(rods, tmp_path, "classic-mds", "identity")
    record = {record.method: record for record in read_records(tmp_path)}
    jobs = planned(
        rods, tmp_path, "classic-mds", "identity", "fine", rerun=("finished",), plugins=(FAULTS,)
    )
    found = estimate(jobs, record.values())
    each = [
        sum(record[name].seconds[stage] for stage in ("canonicalise", "signature"))
        for name in record
    ]
    shared = record["classic-mds"].seconds["prepare"] + record["classic-mds"].seconds["geodesics"]
    assert found.unknown == 1
    ranking = sum(record[name].seconds["ranking"] for name in record)
    assert ranking > 0
    assert found.seconds == pytest.approx(4 * (sum(each) + shared + ranking), abs=1e-3)
    assert (
        estimate([*jobs, *jobs], record.values()).seconds == found.seconds
    )  # each form counts once


def test_a_plan_in_an_empty_folder_is_estimated_from_published_records(rods, tmp_path):
    jobs = planned(rods, tmp_path / "empty", "classic-mds", "identity")
    assert estimate(jobs, []).unknown == 0
    assert estimate(jobs, [], published=tmp_path).unknown == 2
