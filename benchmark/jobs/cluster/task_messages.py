"""Tasks as text, to be read on another machine: plain data that names everything and carries no code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmark.datasets.catalogue import is_known, is_path
from benchmark.jobs.foreign.specs import ForeignMethodSpec, ForeignScorerSpec
from benchmark.jobs.job_specs import JobSpec, ScoringTask, ShapeBatch, Task
from benchmark.methods.registry import MethodSpec, variant
from benchmark.methods.scorers import ScorerSpec, scorer_of
from benchmark.protocols.models import Model
from benchmark.storage.keys import plain

Content = dict[str, Any]


@dataclass(frozen=True)
class TaskMessage:
    """A task as JSON; it is opened in the process that does it, for that imports plugins."""

    text: str

    def open(self) -> Task:
        """Read the task; raises ``BenchmarkError`` if a method of it cannot be made here."""
        return read(json.loads(self.text))


def written(task: Task) -> Content:
    """A task as mappings, lists, strings and numbers; paths are absolute.

    Parameters
    ----------
    task
        Shapes to treat, or jobs to rank.
    """
    content: Content = {"jobs": [written_job(job) for job in task.jobs]}
    return content | {"identifiers": list(task.identifiers)} if isinstance(task, ShapeBatch) else content


def read(content: Mapping[str, Any]) -> Task:
    """The task that :func:`written` described; raises ``BenchmarkError`` if a method of it cannot be made here."""
    jobs = tuple(read_job(job) for job in content["jobs"])
    return ShapeBatch(jobs, tuple(content["identifiers"])) if "identifiers" in content else ScoringTask(jobs)


def written_job(job: JobSpec) -> Content:
    """One job as plain data."""
    is_folder = not is_known(job.dataset) and is_path(job.dataset)
    models = {model.digest: model for model in job.models.values()}
    return {
        "key": job.key,
        "facts": plain(job.facts),
        "dataset": str(Path(job.dataset).resolve()) if is_folder else job.dataset,
        "data_root": None if job.data_root is None else str(job.data_root.resolve()),
        "identifiers": list(job.identifiers),
        "input": job.input,
        "method": written_method(job.method),
        "seed": job.seed,
        "models": {
            digest: {"training": model.training, "folder": str(model.folder.resolve()), "card": model.card}
            for digest, model in models.items()
        },
        "model_of": {identifier: model.digest for identifier, model in job.models.items()},
        "results": str(job.results.resolve()),
        "recipe": plain(job.recipe),
        "all_unseen": job.all_unseen,
        "split_size": job.split_size,
        "scorer": written_scorer(job.scorer),
    }


def read_job(content: Mapping[str, Any]) -> JobSpec:
    """The job that :func:`written_job` described."""
    models = {
        digest: Model(found["training"], Path(found["folder"]), found["card"])
        for digest, found in content["models"].items()
    }
    return JobSpec(
        key=content["key"],
        facts=content["facts"],
        dataset=content["dataset"],
        data_root=None if content["data_root"] is None else Path(content["data_root"]),
        identifiers=tuple(content["identifiers"]),
        input=content["input"],
        method=read_method(content["method"]),
        seed=content["seed"],
        models={identifier: models[digest] for identifier, digest in content["model_of"].items()},
        results=Path(content["results"]),
        recipe=content["recipe"],
        all_unseen=content["all_unseen"],
        split_size=content["split_size"],
        scorer=read_scorer(content["scorer"]),
    )


def written_method(spec: MethodSpec) -> Content:
    """A method by its name with parameters, in their one spelling, and where its class is."""
    return {"name": spec.name, "base_name": spec.base_name, "target": spec.target, "named": spec.named}


def read_method(content: Mapping[str, Any]) -> MethodSpec:
    """The method that :func:`written_method` described; raises ``ConfigurationError`` if there is none such here."""
    base = MethodSpec(content["base_name"], content["target"], named=content["named"])
    if base.is_foreign:
        return ForeignMethodSpec(base.base_name, base.target, named=base.named, spelling=content["name"])
    return variant(content["name"], {base.base_name: base})


def written_scorer(spec: ScorerSpec) -> Content:
    """A scorer by its name, where its class is, and its parameters in their one spelling."""
    return {"name": spec.name, "base_name": spec.base_name, "target": spec.target}


def read_scorer(content: Mapping[str, Any]) -> ScorerSpec:
    """The scorer that :func:`written_scorer` described; raises ``ConfigurationError`` if there is none such here."""
    base = ScorerSpec(content["base_name"], content["target"])
    if base.is_foreign:
        return ForeignScorerSpec(base.base_name, base.target, spelling=content["name"])
    return scorer_of(content["name"], {base.base_name: base})
