"""The queue of a run: towards the end, batches are cut into parts, and draws of large jobs are compared apart."""

import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.execution import scheduler as module
from benchmark.execution.claims import Claims
from benchmark.execution.job_specs import ComparisonTask, ScoringTask, ShapeBatch
from benchmark.execution.pools import LocalPool
from benchmark.execution.runner import failure, keep
from benchmark.execution.scheduler import JobQueue
from benchmark.pipeline.storage.records import outcome
from benchmark.pipeline.storage.store import Store
from tests.execution.test_executors import orders
from tests.toy import write_rods


@pytest.fixture
def queue(tmp_path, monkeypatch):
    """Queue of two forms and a descriptor of three shapes, which count as many, all of them treated."""
    monkeypatch.setattr(module, "LARGE", 3)
    with Claims(tmp_path / "claims") as claims:
        made = JobQueue(orders(tmp_path), Store.open(tmp_path), claims)
        while isinstance(task := made.take(1, 1), ShapeBatch):
            made.finish(task)
        made.put_back(task)
        yield made


def test_a_comparison_that_nobody_finished_waits_again_unless_its_job_is_over(queue):
    for _ in range(2):
        queue.take(2, 2)
    first, second, third = (queue.take(2, 2) for _ in range(3))
    queue.put_back(first)
    assert queue
    assert queue.take(2, 2) == first
    queue.put_back(first)
    busy = {task.jobs[0].key for task in (second, third)}
    assert list(queue.ended(busy | set(queue.pending))) == []
    (job,) = second.jobs
    keep(job, queue._store, failure("failed", "a form is too much for the scorer"))
    assert [each.key for each, _ in queue.ended(set())][:1] == [job.key]
    assert queue.take(2, 2) is None
    for task in (second, third):
        queue.finish(task)
    assert queue.take(2, 2) is None
    assert not queue


def test_a_run_that_compares_draws_apart_finds_the_same(tmp_path, monkeypatch):
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.2))
    words = ["run", "-d", str(rods), "-m", "identity", "--input", "mesh", "--results"]
    assert CliRunner().invoke(cli, [*words, str(tmp_path / "one"), "-j", "1"]).exit_code == 0

    tasks, begin = [], LocalPool.begin
    monkeypatch.setattr(LocalPool, "begin", lambda pool, task: tasks.append(type(task)) or begin(pool, task))
    monkeypatch.setattr(module, "LARGE", 2)
    done = CliRunner().invoke(cli, [*words, str(tmp_path / "two"), "-j", "2"])
    assert done.exit_code == 0, done.output
    assert tasks == [ShapeBatch, *[ComparisonTask] * 3, ScoringTask]
    (one,), (two,) = (list(Store.open(tmp_path / name).records) for name in ("one", "two"))
    assert outcome(two) == outcome(one)
    assert two["digests"] == one["digests"]
    assert two["artefacts"] == one["artefacts"]
