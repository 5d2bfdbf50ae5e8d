"""Faults of methods and of the world around: each costs its own job, and the record says what happened."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmark.cli.run import Settings, run_plan
from benchmark.execution import pools
from benchmark.execution.job_specs import Job, first_tasks
from benchmark.execution.plan import make_plan
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import methods, select
from benchmark.protocols.galleries import galleries
from tests.processes import is_alive, wait_until
from tests.toy import write_rods

ROOT = Path(__file__).parents[2]
FAULTS = Path(__file__).with_name("faults.py")

STATUSES = {
    "surface-area": "ok",
    "hang": "timeout",
    "segfault": "crashed",
    "exit-three": "crashed",
    "bug": "failed",
    "picky": "ok",
    "leaves-an-alarm": "ok",
    "leaves-a-thread": "ok",
}


def command(*arguments):
    return [sys.executable, "-m", "benchmark", *map(str, arguments)]


def benchmark(*arguments, notes, **options):
    return subprocess.run(
        command(*arguments), capture_output=True, text=True, cwd=ROOT, timeout=280, check=False,
        env=os.environ | {"FAULTS_NOTES": str(notes)}, **options,
    )  # fmt: skip


def records(results):
    found = [json.loads(path.read_text()) for path in (results / "runs" / "records").glob("*.json")]
    return {record["method"]: record for record in found}


def alive(notes, name):
    """Processes of which a method has told, and that are still there."""
    found = [int(line) for line in (notes / name).read_text().split()]
    return [process for process in found if is_alive(process)]


@pytest.fixture
def place(tmp_path):
    """Rods, a copy of the plugin, a folder for notes, and the arguments that select a method of it."""
    write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    shutil.copy(FAULTS, tmp_path / "faults.py")
    (tmp_path / "notes").mkdir()
    return tmp_path


def selection(place, *names):
    chosen = [word for name in names for word in ("-m", name)]
    plugin = ("--plugin", place / "faults.py") if set(names) - {"surface-area", "identity"} else ()
    return ("-d", place / "rods", "--input", "mesh", *chosen, *plugin, "--results", place / "results")


def only(place, *names):
    """Select some methods of the plugin; a file brings all of its methods, so the others are taken out of it."""
    text = (place / "faults.py").read_text()
    head, *blocks = text.split("@canonical_form(")
    kept = [block for block in blocks if block.partition('name="')[2].partition('"')[0] in names]
    (place / "faults.py").write_text("@canonical_form(".join([head, *kept]))
    return selection(place, *names, "surface-area")


@pytest.fixture(scope="module")
def faulty_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("faults")
    write_rods(folder / "rods", bends=(0.0, 1.0, 2.0))
    (folder / "notes").mkdir()
    shutil.copy(FAULTS, folder / "faults.py")
    # The scorer is compiled once on a new machine, which must not be what a job is stopped for.
    warm = ("-d", folder / "rods", "--input", "mesh", "-m", "identity", "--results", folder / "warm")
    assert benchmark("run", *warm, notes=folder / "notes").returncode == 0
    arguments = only(folder, *(set(STATUSES) - {"surface-area"}))
    done = benchmark("run", *arguments, "-j", 2, "--timeout", "20s", notes=folder / "notes")
    return folder, arguments, done, records(folder / "results")


@pytest.mark.slow
def test_each_fault_costs_its_own_job(faulty_run):
    folder, _, done, found = faulty_run
    assert {name: record["status"] for name, record in found.items()} == STATUSES
    assert alive(folder / "notes", "hang") + alive(folder / "notes", "children-of-hang") == []
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr


@pytest.mark.slow
def test_each_record_says_what_happened_and_what_to_do(faulty_run):
    _, _, done, found = faulty_run
    assert _at_a_shape(found["hang"], "stopped after 20 s; pass a longer --timeout")
    assert "in hang" in found["hang"]["traceback"]
    assert _at_a_shape(found["segfault"], "the process ended with SIGSEGV")
    assert "in segfault" in found["segfault"]["traceback"]
    assert "exit code 3" in found["exit-three"]["reason"]
    assert "'check' shows more" in found["exit-three"]["reason"]
    assert _at_a_shape(found["bug"], "ZeroDivisionError: division by zero")
    assert "1 / 0" in found["bug"]["traceback"]
    assert found["picky"]["unsupported"] == [["thin2", "too thin; feed it"]]
    assert (found["picky"]["n_shapes"], found["picky"]["coverage"]) == (6, pytest.approx(5 / 6))
    assert "Picky, mesh: 1 unsupported (thin2): too thin; feed it" in done.stdout


def _at_a_shape(record, said):
    """Whether a record names the first shape of a batch, in whatever order, and says what happened."""
    return re.match(rf"thi(ck|n)\d: {re.escape(said)}", record["reason"])


@pytest.mark.slow
def test_failures_are_kept_and_repeated_only_when_asked(faulty_run):
    folder, arguments, _, _ = faulty_run
    n_ok = list(STATUSES.values()).count("ok")
    again = benchmark("run", *arguments, "--timeout", "20s", notes=folder / "notes")
    assert again.stdout.startswith(f"0 of {len(STATUSES)} jobs to run, {n_ok} finished before")
    assert again.returncode == 1
    assert ": stopped after 20 s" in benchmark("plan", *arguments, notes=folder / "notes").stdout
    retried = benchmark("run", *arguments, "--retry", notes=folder / "notes")
    assert retried.stdout.startswith(f"{list(STATUSES.values()).count('crashed')} of {len(STATUSES)} jobs to run")


def start(place, *arguments):
    return subprocess.Popen(
        command("run", *arguments), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"FAULTS_NOTES": str(place / "notes")}, start_new_session=True,
    )  # fmt: skip


@pytest.mark.slow
def test_a_worker_that_is_killed_twice_costs_its_job_and_no_other(place):
    arguments = only(place, "hang")
    process = start(place, *arguments, "-j", 1)
    for count in (1, 2):
        wait_until(lambda n=count: (place / "notes" / "hang").exists() and len(told(place, "hang")) == n)
        os.kill(told(place, "hang")[-1], signal.SIGKILL)
    _, error = process.communicate(timeout=120)
    found = records(place / "results")
    assert process.returncode == 1, error
    assert {name: r["status"] for name, r in found.items()} == {"hang": "killed", "surface-area": "ok"}
    assert re.match(r"thi(ck|n)\d: the process was killed twice", found["hang"]["reason"])


def told(place, name):
    return [int(line) for line in (place / "notes" / name).read_text().split()]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the system cannot be asked")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_workers_and_what_they_started_die_with_the_harness(place, number):
    arguments = only(place, "hang")
    process = start(place, *arguments, "-j", 1)
    wait_until(lambda: (place / "notes" / "hang").exists() and told(place, "hang"))
    assert alive(place / "notes", "children-of-hang")
    process.send_signal(number)
    process.communicate(timeout=60)
    wait_until(lambda: not alive(place / "notes", "hang") + alive(place / "notes", "children-of-hang"))
    again = benchmark("run", *selection(place, "surface-area"), notes=place / "notes")
    assert again.returncode == 0
    assert list((place / "results" / "runs" / "progress").iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("executor", ["processes", "serial"])
def test_an_interrupt_keeps_finished_jobs_and_exits_130(place, executor):
    assert benchmark("run", *selection(place, "surface-area"), notes=place / "notes").returncode == 0
    process = start(place, *only(place, "hang"), "-j", 1, "--executor", executor)
    wait_until(lambda: (place / "notes" / "hang").exists() and told(place, "hang"))
    os.killpg(process.pid, signal.SIGINT)
    output, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "finished jobs are kept" in error
    assert "Traceback" not in output + error
    assert {name: r["status"] for name, r in records(place / "results").items()} == {"surface-area": "ok"}
    assert alive(place / "notes", "hang") == []


@pytest.mark.slow
@pytest.mark.parametrize("fate", ["survives", "is killed"])
def test_a_second_run_waits_for_the_jobs_of_the_first_and_takes_over_what_it_leaves(place, fate):
    arguments = only(place, "slow", "waits-once")
    first = start(place, *arguments, "-j", 2)
    wait_until((place / "notes" / "waits-once").exists)
    second = start(place, *arguments, "-j", 1)
    time.sleep(2)  # it may plan and look for work, and finds all of it taken
    if fate == "survives":
        os.kill(int((place / "notes" / "waits-once").read_text().split()[0]), signal.SIGKILL)
    else:
        first.kill()
    outputs = [first.communicate(timeout=200)[1], second.communicate(timeout=200)[1]]
    assert second.returncode == 0, outputs[1]
    assert first.returncode == (0 if fate == "survives" else -signal.SIGKILL)
    found = {name: record["status"] for name, record in records(place / "results").items()}
    assert found == {"slow": "ok", "waits-once": "ok", "surface-area": "ok"}
    if fate == "survives":
        assert len(told(place, "slow")) == 4 + 1  # each shape once, and one again to see whether runs differ
    assert list((place / "results" / "runs" / "scratch").iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("redirection", "code"), [("2>&-", 0), (">&-", 0), ("<&-", 0), ("2>&1 | head -1", 141), ("| head -1", 141)]
)
def test_a_run_needs_nobody_to_listen(place, redirection, code):
    words = command("run", *selection(place, "surface-area"), "-j", 1)
    script = f"set -o pipefail; {shlex.join(words)} {redirection}"
    done = subprocess.run(
        ["bash", "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=280, check=False
    )  # fmt: skip
    assert done.returncode == code
    assert "Traceback" not in done.stdout + done.stderr
    assert {name: r["status"] for name, r in records(place / "results").items()} == {"surface-area": "ok"}


@pytest.mark.slow
def test_an_edit_while_a_job_runs_is_noticed_and_the_job_done_anew(place):
    arguments = only(place, "edits-itself")
    done = benchmark("run", *arguments, "-j", 1, notes=place / "notes")
    assert done.returncode == 1
    assert records(place / "results")["surface-area"]["status"] == "ok"
    assert "the code changed during the run (plugin changed: faults.py " in done.stderr
    record = records(place / "results")["edits-itself"]
    forms = {path.stem for path in (place / "results" / "runs" / "artefacts").rglob("*.npz")}
    assert record["status"] == "changed"
    again = benchmark("run", *arguments, "-j", 1, notes=place / "notes")
    assert again.returncode == 0, again.stderr
    assert again.stdout.startswith("1 of 2 jobs to run, 1 finished before")
    assert forms <= {path.stem for path in (place / "results" / "runs" / "artefacts").rglob("*.npz")}


# Shares --------------------------------------------------------------------------------------------------------------


def orders(tmp_path, names=("identity", "fast-mds", "surface-area"), datasets=("rods",), identifiers=("a", "b", "c")):
    return [
        Job(
            key=f"{dataset} {spec.name}", facts={"gallery": dataset}, dataset=dataset, data_root=None,
            identifiers=tuple(identifiers), input="mesh", method=spec, seed=0, models={}, results=tmp_path, recipe={},
            table=dataset,
        )
        for dataset in datasets
        for spec in select(names, methods())
    ]  # fmt: skip


def test_shapes_come_to_foreign_code_in_an_order_that_tells_nothing(tmp_path):
    class Foreign(Job):
        is_foreign = True

    names = [f"shape{number}" for number in range(30)]
    jobs = orders(tmp_path, ("identity",), identifiers=names)
    made = [Foreign(**{**vars(job), "large_files": {"shape7": 2**26}}) for job in jobs]
    (one,), (other,) = first_tasks(made), first_tasks(made)
    assert sorted(one.identifiers) == sorted(other.identifiers) == sorted(names)
    assert one.identifiers != other.identifiers


def planned(place, store):
    return make_plan(galleries([], [str(place / "rods")]), ["mesh"], select(["surface-area"], methods()), store)


def test_a_job_that_another_run_has_finished_meanwhile_keeps_its_record(place):
    store = Store.open(place / "results")
    jobs = planned(place, store)
    times = []
    for _ in range(2):  # the second time by the plan of before
        assert run_plan(jobs, store, Settings(jobs=0))
        times += [path.stat().st_mtime_ns for path in store.records.folder.glob("*.json")]
    assert times[0] == times[1]


def test_data_that_change_during_a_run_are_named_and_leave_no_result(place):
    store = Store.open(place / "results")
    jobs = planned(place, store)
    shutil.copy(place / "rods" / "thick0.off", place / "rods" / "thin0.off")
    assert not run_plan(jobs, store, Settings(jobs=0))
    record = store.records.read(jobs[0].key)
    assert (record["status"], "the data changed during the run" in record["reason"]) == ("changed", True)


def test_there_are_no_more_processes_than_memory(monkeypatch):
    monkeypatch.setattr(pools, "memory_per_process", lambda processes=1: 2**32 // processes)
    assert pools.LocalPool(1000).size == 8
    assert pools.LocalPool(2).size == 2
