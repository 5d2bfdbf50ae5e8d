"""Jobs on a dask cluster of real processes under nannies, one of which is killed."""

from __future__ import annotations

import os
import shutil
import signal
from types import SimpleNamespace

import psutil
import pytest

from benchmark.errors import ConfigurationError
from benchmark.pipeline.record_arrays import read_distances
from benchmark.runs import dask
from benchmark.runs.tasks import Task
from tests.registry.plugin import write_plugin
from tests.runs.toy import FAULTS, done, noted, planned, run_toy
from tests.toy import SMALL_SCORER, rod, write_off


def test_a_process_has_a_share_of_the_memory_of_its_own_machine(monkeypatch):
    """Machines of a cluster share no memory."""
    pytest.importorskip("distributed")
    threads = {"tcp://10.0.0.1:40001": 4, "tcp://10.0.0.1:40002": 4, "tcp://10.0.0.2:40001": 2}
    of_machines = dask._threads_of_machines(threads)
    assert of_machines == {"10.0.0.1": 8, "10.0.0.2": 2}
    for address, count in (("tcp://10.0.0.2:40001", 2), ("tcp://10.0.0.3:40001", 3)):
        worker = SimpleNamespace(address=address, state=SimpleNamespace(nthreads=count))
        monkeypatch.setattr("distributed.get_worker", lambda worker=worker: worker)
        assert dask._threads_here(of_machines) == count


def test_a_thread_keeps_its_process_within_a_run_and_ends_it_in_the_next(monkeypatch):
    pools = []

    class OnePool:
        def __init__(self, size, memory, timeout):
            self.size, self.memory, self.timeout, self.is_closed = size, memory, timeout, False
            pools.append(self)

        def poll(self, queue):
            for step in queue.take("").steps:
                yield step, "ended"

        def close(self):
            self.is_closed = True

    monkeypatch.setattr(dask, "Pool", OnePool)
    monkeypatch.setattr(dask, "_threads_here", lambda threads: threads["here"])
    monkeypatch.setattr(dask, "memory_per_process", lambda n_processes: 24 // n_processes)
    monkeypatch.setattr(dask, "_of_thread", SimpleNamespace())
    steps = tuple(SimpleNamespace(process="", view=view) for view in ("thin0", "thin1"))
    for run, timeout in (("first", 60.0), ("first", 60.0), ("second", 3.0)):
        ended = dask.run_in_worker(Task(steps), run, timeout, {"here": 8})
        assert ended == [(step, "ended") for step in steps]
    assert [(pool.size, pool.memory, pool.timeout) for pool in pools] == [(1, 3, 60.0), (1, 3, 3.0)]
    assert [pool.is_closed for pool in pools] == [True, False]


def test_an_object_of_a_program_is_refused_by_a_cluster(rods, tmp_path):
    """No worker of a cluster has it: the run would wait without an end."""

    def own(shape):
        return shape.mesh.vertices

    jobs = planned(rods, tmp_path, own)
    with pytest.raises(ConfigurationError, match="'own' is an object of this program"):
        done(jobs, tmp_path, dask="tcp://127.0.0.1:9")


@pytest.mark.slow
def test_rows_are_those_of_one_machine_though_a_worker_is_killed(rods, tmp_path, cluster, notes):
    jobs = planned(
        rods, tmp_path / "results", "slow", "surface-area", "bug", "segfault", plugins=(FAULTS,)
    )
    killed = []

    def kill(progress):
        if not killed and (notes / "slow").is_file():
            worker = psutil.Process(noted(notes / "slow")[0]).parent()
            killed.append(worker.pid)
            os.kill(worker.pid, signal.SIGKILL)

    records = done(jobs, tmp_path / "results", dask=cluster, watch=kill)
    here = run_toy(rods, tmp_path / "here", "slow", "surface-area", plugins=(FAULTS,))
    assert killed
    assert {name: record.status for name, record in records.items()} == {
        "slow": "ok",
        "surface-area": "ok",
        "bug": "failed",
        "segfault": "crashed",
    }
    for name, record in here.items():
        assert (records[name].scores, records[name].per_query) == (record.scores, record.per_query)


@pytest.mark.slow
def test_a_cluster_serves_each_run_anew(rods, tmp_path, cluster):
    folder, plugin = shutil.copytree(rods, tmp_path / "rods"), tmp_path / "smooth.py"
    for number, factor in enumerate((1, 3)):
        write_plugin(
            plugin,
            methods=(
                "def canonicalise(self, shape):\n"
                f"        return shape.form({factor} * shape.mesh.vertices ** 3)"
            ),
        )
        write_off(folder / "thin1.off", rod(0.06, 0.5 + number))
        options = {"plugins": (plugin,), "scorer": SMALL_SCORER}
        records = done(
            planned(folder, tmp_path / "results", "smooth", **options),
            tmp_path / "results",
            dask=cluster,
        )
        clean = done(
            planned(folder, tmp_path / f"clean{number}", "smooth", **options),
            tmp_path / f"clean{number}",
        )
        assert (records["smooth"].status, records["smooth"].per_query) == (
            "ok",
            clean["smooth"].per_query,
        )
        there, here = (
            read_distances(tmp_path / name, records["smooth"])
            for name in ("results", f"clean{number}")
        )
        assert (there == here).all()


@pytest.mark.slow
def test_a_later_run_has_its_own_time_limit(rods, tmp_path, cluster):
    """Its shapes are prepared: nothing but the method that hangs comes near the limit."""
    jobs = planned(rods, tmp_path, "fine", plugins=(FAULTS,))
    records = done(jobs, tmp_path, dask=cluster)
    jobs = planned(rods, tmp_path, "hang", plugins=(FAULTS,))
    limited = done(jobs, tmp_path, dask=cluster, timeout=3.0)
    assert (records["fine"].status, limited["hang"].status) == ("ok", "timeout")
    assert "stopped after 3 s" in limited["hang"].reason


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_is_named(rods, tmp_path, monkeypatch):
    jobs = planned(rods, tmp_path / "results", "surface-area")
    with pytest.raises(
        ConfigurationError, match=r"no dask scheduler answers at tcp://127.0.0.1:9; start one"
    ):
        done(jobs, tmp_path / "results", dask="tcp://127.0.0.1:9")
