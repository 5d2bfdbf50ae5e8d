"""The queue of a run: towards the end, batches are cut into parts, and draws of large jobs are compared apart."""

from dataclasses import replace

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.execution import scheduler as module
from benchmark.execution.claims import Claims
from benchmark.execution.pools import LocalPool
from benchmark.execution.scheduler import JobQueue
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.records import outcome
from benchmark.pipeline.storage.store import Store
from tests.execution.test_executors import orders
from tests.records import failed
from tests.toy import write_rods


@pytest.fixture
def queue(tmp_path, monkeypatch):
    """Queue of two forms and a descriptor of three shapes, which count as many, all of them treated."""
    monkeypatch.setattr(module, "LARGE", 3)
    with Claims(tmp_path) as claims:
        jobs = [replace(job, key=digest({"job": job.method.name})) for job in orders(tmp_path)]
        queue = JobQueue({job.key: job for job in jobs}, Store.open(tmp_path), claims)
        while (task := queue.take(1, 1)).identifiers:
            queue.finish(task)
        queue.put_back(task)
        yield queue


def test_a_comparison_that_nobody_finished_waits_again_unless_its_job_is_over(queue):
    assert queue.take(1, 2).block is None
    first, second, third = (queue.take(2, 2) for _ in range(3))
    assert [task.block for task in (first, second, third)] == [(0, 0), (1, 0), (2, 0)]
    queue.put_back(first)
    assert queue.take(2, 2) == first
    queue.put_back(first)
    assert list(queue.ended()) == []
    (job,) = second.jobs
    queue.store.write_record(failed(recipe={"job": job.method.name}))
    assert [each.key for each, _ in queue.ended()] == [job.key]
    assert queue.take(2, 2).jobs[0].method.name == "surface-area"
    for task in (second, third):
        queue.finish(task)
    assert not queue


def test_a_job_tried_alone_leaves_the_others_of_its_task(tmp_path):
    with Claims(tmp_path) as claims:
        queue = JobQueue({job.key: job for job in orders(tmp_path)}, Store.open(tmp_path), claims)
        task = queue.take(1, 1)
        queue.put_apart(task, 1, "rods pca")
        alone, others = queue.take(1, 1), queue.take(1, 1)
        assert [job.key for job in alone.jobs] == ["rods pca"]
        assert [job.key for job in others.jobs] == ["rods identity", "rods surface-area"]
        assert alone.identifiers == others.identifiers == ("b", "c")
        queue.finish(alone)
        queue.finish(others)
        assert queue.shapes_done == 3
        ranking = queue.take(1, 1)
        assert len(ranking.jobs) == 3
        queue.finish(ranking)
        assert {record["status"] for _, record in queue.ended()} == {"crashed"}


def test_a_run_that_compares_draws_apart_finds_the_same(tmp_path, monkeypatch):
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.2))
    words = ["run", "-d", str(rods), "-m", "identity", "--input", "mesh", "--results"]
    assert CliRunner().invoke(cli, [*words, str(tmp_path / "one"), "-j", "1"]).exit_code == 0

    tasks, begin = [], LocalPool.begin
    monkeypatch.setattr(LocalPool, "begin", lambda pool, task: tasks.append(task) or begin(pool, task))
    monkeypatch.setattr(module, "LARGE", 2)
    done = CliRunner().invoke(cli, [*words, str(tmp_path / "two"), "-j", "2"])
    assert done.exit_code == 0, done.output
    assert [task.block for task in tasks] == [None, (0, 0), (1, 0), (2, 0), None]
    (one,), (two,) = (list(Store.open(tmp_path / name).records) for name in ("one", "two"))
    assert outcome(two) == outcome(one)
    assert two["digests"] == one["digests"]
    assert two["artefacts"] == one["artefacts"]
