"""Jobs on a dask cluster of real processes: killed, hung, foreign workers cost nobody anything but time."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent import futures
from pathlib import Path

import psutil
import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.pipeline.storage.records import outcome
from benchmark.pipeline.storage.store import Store
from tests.processes import is_alive, wait_until
from tests.toy import write_rods

pytest.importorskip("distributed", reason="needs dask: pip install 'dask[distributed]'")

ROOT = Path(__file__).parents[3]

#: Tells each shape that it has described. At the first rod that finds the trap it waits for ever.
PLUGIN = """
import os, time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from benchmark.api.contracts import MethodInfo

NOTES = Path(__file__).parent / "notes"


def is_caught():
    try:
        (NOTES / "trap").rename(NOTES / "sprung")
    except FileNotFoundError:
        return False
    return True


@dataclass(frozen=True, kw_only=True)
class Noted:
    info: ClassVar[MethodInfo] = MethodInfo(name="noted", title="Noted")

    def describe(self, shape):
        if is_caught():
            (NOTES / "caught").write_text(str(os.getpid()))
            time.sleep(3600)
        with (NOTES / "done").open("a") as file:
            file.write(shape.identifier + "\\n")
        return np.ptp(shape.mesh.vertices, axis=0)

    def distances(self, descriptors):
        all_ = np.array(descriptors)
        return np.abs(all_[:, None] - all_).sum(axis=2)
"""


class Cluster:
    """A scheduler and workers on this machine."""

    def __init__(self, folder):
        self.folder, self.processes = folder, []
        self.scheduler = self._start("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
                                     "--scheduler-file", folder / "scheduler.json")  # fmt: skip
        wait_until(lambda: (folder / "scheduler.json").exists() and self._address())
        self.url = self._address()

    def _address(self):
        try:
            return json.loads((self.folder / "scheduler.json").read_text())["address"]
        except ValueError:
            return ""

    def worker(self, path=ROOT):
        number = len(self.processes)
        return self._start("dask_worker", self.url, "--nthreads", "1", "--no-nanny", "--no-dashboard",
                           "--local-directory", self.folder / f"disk{number}", path=path)  # fmt: skip

    def _start(self, program, *arguments, path=ROOT):
        others = [part for part in os.environ.get("PYTHONPATH", "").split(os.pathsep) if part and Path(part) != ROOT]
        with (self.folder / f"{program}{len(self.processes)}.log").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", f"distributed.cli.{program}", *map(str, arguments)], cwd=self.folder,
                env=os.environ | {"PYTHONPATH": os.pathsep.join([str(path), *others])}, stdout=log, stderr=log,
            )  # fmt: skip
        self.processes.append(process)
        return process

    def close(self):
        for process in self.processes:
            with_children = [process, *psutil.Process(process.pid).children(recursive=True)] if alive(process) else []
            for each in with_children:
                each.send_signal(signal.SIGKILL)
            process.wait()


def alive(process):
    return process.poll() is None


@pytest.fixture
def cluster(tmp_path):
    (tmp_path / "cluster").mkdir()
    made = Cluster(tmp_path / "cluster")
    yield made
    made.close()


@pytest.fixture
def place(tmp_path):
    """Rods in three shares, the plugin, and what selects it."""
    write_rods(tmp_path / "rods", bends=(0.0, 0.4, 0.8, 1.2, 1.6, 2.0))
    (tmp_path / "noted.py").write_text(PLUGIN)
    (tmp_path / "notes").mkdir()
    return tmp_path


def selection(place, results):
    words = ("-d", place / "rods", "--input", "mesh", "-m", "noted", "-m", "surface-area")
    return (*words, "--plugin", place / "noted.py", "--results", place / results)


def run(*arguments):
    done = CliRunner().invoke(cli, [*map(str, ("run", *arguments))])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


def on(cluster):
    return "--dask", cluster.url


def outcomes(results):
    return {record["key"]: outcome(record) for record in Store.open(results).records}


def described(place):
    found = sorted((place / "notes" / "done").read_text().split())
    (place / "notes" / "done").unlink()
    return found


def at_the_trap(place, cluster, number):
    """Set the trap, and send a signal to the dask worker whose task is caught in it."""
    (place / "notes" / "trap").write_text("")

    def spring():
        wait_until((place / "notes" / "caught").exists, 120)
        wait_until((place / "notes" / "caught").read_text)
        caught.append(int((place / "notes" / "caught").read_text()))
        above = {parent.pid for parent in psutil.Process(caught[0]).parents()}
        (worker,) = (process for process in cluster.processes if process.pid in above)
        time.sleep(1)  # it may tell how far it is
        worker.send_signal(number)

    caught = []
    thread = threading.Thread(target=spring)
    thread.start()
    return thread, caught


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(signal.SIGKILL, marks=pytest.mark.slow),
        pytest.param(signal.SIGSTOP, marks=pytest.mark.exhaustive),
    ],
)
def test_a_worker_that_is_killed_or_hangs_costs_a_retry(place, cluster, monkeypatch, number):
    from benchmark.execution import dask_pool

    monkeypatch.setattr(dask_pool, "SILENCE", 6.0)
    assert run(*selection(place, "alone"), "-j", "0").exit_code == 0
    shapes = described(place)
    cluster.worker()
    cluster.worker()
    thread, caught = at_the_trap(place, cluster, number)
    done = run(*selection(place, "cluster"), *on(cluster))
    thread.join()
    assert done.exit_code == 0, done.output
    assert outcomes(place / "cluster") == outcomes(place / "alone")
    assert described(place) == shapes  # nothing twice
    if number == signal.SIGKILL:
        wait_until(lambda: not psutil.pid_exists(caught[0]), 20)  # its work goes with the worker


@pytest.mark.slow
def test_a_process_beside_a_worker_does_the_tasks_of_a_run_in_turn(place, cluster, monkeypatch):
    from benchmark.execution import job_specs

    monkeypatch.setattr(job_specs, "LARGEST_BATCH", 5)
    words = ("-d", place / "rods", "--input", "mesh", "-m", "fast-mds", "-m", "surface-area", "--results")
    assert run(*words, place / "alone", "-j", "0").exit_code == 0
    worker = cluster.worker()
    done = run(*words, place / "cluster", *on(cluster))
    assert done.exit_code == 0, done.output
    assert outcomes(place / "cluster") == outcomes(place / "alone")
    begun = [each for each in psutil.Process(worker.pid).children() if "run(*sys.argv" in " ".join(each.cmdline())]
    assert len(begun) == 1, "one did three batches and the ranking"
    worker.kill()
    wait_until(lambda: not is_alive(begun[0].pid), 20)


@pytest.mark.slow
def test_a_scheduler_that_goes_is_told_of_and_finished_jobs_are_kept(place, cluster):
    cluster.worker()
    first = ("-d", place / "rods", "--input", "mesh", "-m", "surface-area", "--results", place / "results")
    assert run(*first, *on(cluster)).exit_code == 0
    thread, _ = at_the_trap(place, cluster, signal.SIGCONT)
    thread.join(0)
    killer = threading.Thread(target=lambda: (thread.join(), cluster.scheduler.kill()))
    killer.start()
    with pytest.raises(BenchmarkError, match=f"the dask scheduler at {cluster.url} is gone; start it again and run"):
        run(*selection(place, "results"), *on(cluster))
    killer.join()
    assert [record["method"] for record in Store.open(place / "results").records] == ["surface-area"]
    assert list((place / "results" / "runs" / "progress").iterdir()) == []


@pytest.mark.slow
def test_workers_with_other_code_or_none_are_refused_by_name(place, cluster, tmp_path):
    other = tmp_path / "other"
    for package in ("benchmark", "baselines", "retrieval", "learned"):
        shutil.copytree(ROOT / package, other / package, ignore=shutil.ignore_patterns("__pycache__", "models"))
    with (other / "baselines" / "surface_area.py").open("a") as file:
        file.write("\nCHANGED = True\n")
    cluster.worker(other)
    with pytest.raises(ConfigurationError, match="worker tcp.*: code changed: baselines .*; install the same"):
        run(*selection(place, "results"), *on(cluster))
    (tmp_path / "nowhere").mkdir()  # what an interpreter says that has none, for this one may have it installed
    (tmp_path / "nowhere" / "benchmark.py").write_text("raise ModuleNotFoundError(\"No module named 'benchmark'\")")
    cluster.worker(tmp_path / "nowhere")
    cluster.worker()
    wait_until(lambda: all(b"Registered to" in log.read_bytes() for log in cluster.folder.glob("dask_worker*.log")))
    done = run(*selection(place, "results"), *on(cluster))
    assert done.exit_code == 0, done.output
    assert "left out: worker tcp" in done.stderr
    assert "No module named 'benchmark'" in done.stderr


@pytest.mark.parametrize(
    ("inventory", "problem"),
    [
        ({}, "another version of this suite"),
        ({"code": {}, "packages": {}, "plugin": {}, "models": {}}, "code changed: benchmark/execution"),
        ({"problem": "its code has changed", "hint": "start it again"}, "its code has changed; start it again"),
        ({"code": {"benchmark/execution": "a"}, "packages": {}, "plugin": {}, "models": {}}, ""),
    ],
    ids=["another version", "other code", "a problem", "the same"],
)
def test_a_worker_whose_inventory_differs_is_refused(inventory, problem):
    from benchmark.execution import dask_pool

    pool = object.__new__(dask_pool.DaskPool)
    pool._inventory = {"code": {"benchmark/execution": "a"}, "packages": {}, "plugin": {}, "models": {}}
    node = dask_pool.WorkerNode("tcp://a", "a", 1, futures.Future())
    node.inventory.set_result({"tcp://a": json.dumps(inventory)})
    pool._admit(node)
    assert node.is_ready == (not problem)
    assert problem in str(node.refusal or "")


@pytest.mark.slow
def test_workers_that_do_not_see_the_results_folder_are_refused_before_work_begins(place, cluster, monkeypatch):
    from benchmark.execution import dask_pool

    def without_marker(self):
        self._marker.unlink(missing_ok=True)
        look_round(self)

    look_round = dask_pool.DaskPool._look_round
    monkeypatch.setattr(dask_pool.DaskPool, "_look_round", without_marker)
    cluster.worker()
    said = f"worker tcp.*: it does not see the results folder {place}/results, .*; mount .*"
    with pytest.raises(ConfigurationError, match=said):
        run(*selection(place, "results"), *on(cluster))
    assert not (place / "notes" / "done").exists()
    assert list((place / "results" / "runs" / "progress").iterdir()) == []


@pytest.mark.parametrize("written", ["by this run", "by another run", None])
def test_the_results_folder_is_shared_if_a_worker_reads_what_the_run_wrote(tmp_path, written):
    from benchmark.execution import dask_pool

    if written is not None:
        (tmp_path / "marker").write_text(written)
    assert dask_pool._is_shared(tmp_path / "marker", "by this run") == (written == "by this run")


def test_a_scheduler_that_is_not_there_is_named_at_once(place, monkeypatch):
    from benchmark.execution import dask_pool

    monkeypatch.setattr(dask_pool, "_CONNECTING", 1.0)
    with pytest.raises(ConfigurationError, match=r"no dask scheduler answers at tcp://127.0.0.1:9 .*; start one or"):
        run(*selection(place, "results"), "--dask", "tcp://127.0.0.1:9")
    assert list((place / "results" / "runs" / "progress").iterdir()) == []
