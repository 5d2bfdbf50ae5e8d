"""Jobs and tasks that travel as JSON come out as they went in, and need dask as little as those who have none of it."""

import importlib.util
from dataclasses import replace

import pytest

from benchmark.cli.run import Settings, run_plan
from benchmark.errors import ConfigurationError
from benchmark.execution.job_specs import Task, task_of, to_json
from benchmark.execution.plan import make_plan
from benchmark.pipeline.storage.keys import plain
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import MethodSpec, methods, select
from benchmark.plugins.scorers import ScorerSpec
from benchmark.protocols.galleries import galleries

NAMES = ("skeleton[bands=30]", "least-squares-mds[rtol=1e-4,start=classic]", "identity", "learned")


@pytest.fixture
def jobs(tmp_path):
    chosen = galleries((), ["animals"], None, quick=True)
    plan = make_plan(chosen, ["view"], select(NAMES, methods()), Store.open(tmp_path), seed=3)
    return [job for job in plan if job.to_run]


def test_a_task_comes_out_of_its_json_as_it_went_in(jobs):
    assert any(job.models for job in jobs)
    for task in (Task(tuple(jobs), ("cat0", "dog1")), Task(tuple(jobs[:1]), block=(1, 0), is_part=True)):
        found = task_of(to_json(task))
        assert to_json(found) == to_json(task)
        assert (found.identifiers, found.block, found.is_part) == (task.identifiers, task.block, task.is_part)
        assert [job.method.create() for job in found.jobs] == [job.method.create() for job in task.jobs]
        assert [job.recipe for job in found.jobs] == [plain(job.recipe) for job in task.jobs]


def test_methods_and_scorers_of_plugins_are_written_so_that_a_worker_does_not_import_them(jobs, tmp_path):
    plugin = tmp_path / "mine.py"
    plugin.write_text("raise AssertionError('imported')")
    mine = MethodSpec("mine", f"{plugin}:Mine")
    own = ScorerSpec("own", f"{plugin}:Own")
    (after,) = task_of(to_json(Task((replace(jobs[0], method=mine, scorer=own),)))).jobs
    assert (after.method, after.scorer) == (mine, own)


def test_without_dask_the_hint_is_told(tmp_path, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "distributed" else find(name))
    with pytest.raises(ConfigurationError, match=r"needs the package distributed; run `pip install 'dask"):
        run_plan([], Store.open(tmp_path), Settings(dask="tcp://127.0.0.1:8786"))
