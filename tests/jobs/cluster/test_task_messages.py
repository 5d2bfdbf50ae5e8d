"""Tasks that travel as text come out as they went in, and need dask as little as those who have none of it."""

import importlib.util
import json
from dataclasses import fields
from pathlib import Path

import pytest

from benchmark.errors import ConfigurationError
from benchmark.jobs.cluster import task_messages
from benchmark.jobs.execution.claims import Claims
from benchmark.jobs.job_specs import JobSpec, ScoringTask, ShapeBatch
from benchmark.jobs.plan import make_plan
from benchmark.jobs.run_plan import make_executor
from benchmark.methods.registry import methods, select
from benchmark.protocols.galleries import galleries
from benchmark.storage.keys import plain
from benchmark.storage.store import Store

NAMES = ("classic-mds[metric=diffusion]", "least-squares-mds[rtol=1e-4,start=classic]", "identity", "learned")


class Scope:
    def __init__(self, results):
        self.results, self.data_root, self.seed = results, None, 3


@pytest.fixture
def jobs(tmp_path):
    plan = make_plan(
        galleries((), ["animals"], None, quick=True), ["view"], select(NAMES, methods()), Store.open(tmp_path), 3
    )
    return [JobSpec.of(job, Scope(tmp_path)) for job in plan if job.to_run]


def test_a_task_comes_out_of_its_letter_as_it_went_in(jobs):
    assert any(job.models for job in jobs)
    for task in (ShapeBatch(tuple(jobs), ("cat0", "dog1")), ScoringTask(tuple(jobs))):
        text = json.dumps(task_messages.written(task))
        found = task_messages.TaskMessage(text).open()
        assert type(found) is type(task)
        assert getattr(found, "identifiers", None) == getattr(task, "identifiers", None)
        for before, after in zip(task.jobs, found.jobs, strict=True):
            for field in fields(JobSpec):
                then, now = getattr(before, field.name), getattr(after, field.name)
                if field.name == "models":
                    assert {name: (m.training, m.folder.resolve(), m.digest) for name, m in then.items()} == {
                        name: (m.training, m.folder, m.digest) for name, m in now.items()
                    }
                elif field.name in ("facts", "recipe"):
                    assert now == plain(then)
                elif field.name == "method":
                    assert (now, now.create()) == (then, then.create())
                else:
                    assert now == then


def test_paths_of_a_message_are_absolute(jobs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rods").mkdir()
    job = JobSpec(**{**vars(jobs[0]), "dataset": "./rods", "results": Path("results"), "data_root": Path()})
    content = task_messages.written_job(job)
    assert [content[name] for name in ("dataset", "results", "data_root")] == [
        str(tmp_path / "rods"), str(tmp_path / "results"), str(tmp_path),
    ]  # fmt: skip


def test_without_dask_the_hint_is_told(tmp_path, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "distributed" else find(name))
    with pytest.raises(ConfigurationError, match=r"needs the package distributed; run `pip install 'dask"):
        make_executor("dask", None, None, Claims(tmp_path / "claims"), "tcp://127.0.0.1:8786")
