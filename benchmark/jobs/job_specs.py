"""Descriptions of jobs and tasks, which travel to other processes and machines as JSON."""

from __future__ import annotations

import json
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Input
from benchmark.datasets.own import is_own
from benchmark.jobs.foreign.specs import ForeignMethodSpec, ForeignScorerSpec, kept_apart
from benchmark.methods.registry import MethodSpec
from benchmark.methods.scorers import DEFAULT, ScorerSpec
from benchmark.parameters.values import format_value
from benchmark.protocols.models import Model


@dataclass(frozen=True)
class JobSpec:
    """One job: a method on a gallery under one input.

    Parameters
    ----------
    key
        Name of its record.
    facts
        What the record tells of gallery and method besides scores.
    dataset, data_root
        Where the shapes come from.
    identifiers
        The shapes of the gallery, in matrix order.
    input, method, seed
        What is made of them.
    models
        Trained models by the names of their trainings; empty for a method that does not learn.
    results
        Folder of the store.
    recipe
        Everything that determines the scores.
    all_unseen
        Whether it is an error that a model was trained on one of the shapes.
    split_size
        Test subjects in each of all the ways to choose some; 0 where nobody asks for them.
    scorer
        What compares the forms.
    ranks_again
        Whether nothing but its measures is to be made: its distances are kept from an older record.
    trainings
        The training whose model treats a shape, by identifier.
    """

    key: str
    facts: Mapping[str, Any]
    dataset: str
    data_root: Path | None
    identifiers: tuple[str, ...]
    input: Input
    method: MethodSpec
    seed: int
    models: Mapping[str, Model]
    results: Path
    recipe: Mapping[str, Any]
    all_unseen: bool
    split_size: int = 0
    scorer: ScorerSpec = field(default_factory=ScorerSpec)
    ranks_again: bool = False
    trainings: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Gallery, input and method, as people name a job, and the scorer where it is not the default one."""
        by = "" if self.scorer.name == DEFAULT else f" by {self.scorer.name}"
        return f"{self.facts['gallery']} {self.input} {self.method.name}{by}"

    @property
    def model_of(self) -> dict[str, Model]:
        """Trained model of each shape by identifier."""
        return {identifier: self.models[training] for identifier, training in self.trainings.items()}

    @property
    def is_foreign(self) -> bool:
        """Return whether code that is none of this suite makes a part of it."""
        return self.method.is_foreign or self.scorer.is_foreign or is_own(self.dataset)

    @property
    def file_sizes(self) -> Mapping[str, int]:
        """Bytes of the files of its shapes, by identifier, where they are known: to whoever plans, not to a worker."""
        return {}

    @property
    def package(self) -> str:
        """Jobs of one package may share a process: all built-in methods of a package, or those of one plugin file."""
        packages = dict.fromkeys(_package(module) for module in (self.method.module, self.scorer.module))
        return " ".join(each for each in packages if each != "retrieval")


def _package(module: str) -> str:
    return module if module.endswith(".py") else module.partition(".")[0]


@dataclass(frozen=True)
class ShapeBatch:
    """Some shapes of a data set under one input, each to be treated by several methods before the next one.

    Parameters
    ----------
    jobs
        Jobs of one data set, input, seed and package; each treats those of the shapes that are in its gallery.
    identifiers
        The shapes.
    """

    jobs: tuple[JobSpec, ...]
    identifiers: tuple[str, ...]


@dataclass(frozen=True)
class ScoringTask:
    """The second half of jobs: all their shapes are treated, and are to be ranked."""

    jobs: tuple[JobSpec, ...]


@dataclass(frozen=True)
class ComparisonTask:
    """Comparing the shapes of one job, all of them treated, under one draw of its scorer: a part of its ranking.

    Parameters
    ----------
    jobs
        The job alone.
    draw
        The draw.
    """

    jobs: tuple[JobSpec, ...]
    draw: int | None


Task = ShapeBatch | ScoringTask | ComparisonTask

#: What travels, by name: in JSON that name stands beside the arguments that make the same again.
_CLASSES: dict[str, Any] = {
    each.__name__: each
    for each in (
        ShapeBatch, ScoringTask, ComparisonTask, JobSpec, Model, MethodSpec, ForeignMethodSpec, ScorerSpec,
        ForeignScorerSpec, Path,
    )
}  # fmt: skip


def to_json(described: Task | JobSpec) -> str:
    """Write a task or a job; methods and scorers of plugins so that whoever reads it imports none of them."""
    return json.dumps(described, default=_with_class)


def from_json(text: str) -> Any:
    """Return what was written; raises ``ConfigurationError`` if there is no such method or scorer here."""
    return json.loads(text, object_hook=_of_class)


def _with_class(value: Any) -> Any:
    if isinstance(value, Path):
        return {"class": Path.__name__, "arguments": [str(value)]}
    if isinstance(value, MethodSpec | ScorerSpec):
        value = kept_apart(value)
    name = JobSpec.__name__ if isinstance(value, JobSpec) else type(value).__name__
    if name not in _CLASSES:
        return format_value(value)  # a parameter of a method, which reads it again
    return {"class": name, "arguments": [getattr(value, each.name) for each in fields(_CLASSES[name])]}


def _of_class(content: dict[str, Any]) -> Any:
    if content.keys() != {"class", "arguments"}:
        return content
    return _CLASSES[content["class"]](*(tuple(e) if isinstance(e, list) else e for e in content["arguments"]))


def shape_batches(jobs: list[JobSpec]) -> list[ShapeBatch]:
    """Cut the first half of jobs into batches.

    Jobs that treat the same shapes go together, so that a shape is prepared, and its geodesics are computed, once for
    all methods. Large files come first, each in a batch of its own: at the end, all would wait for the last of them.
    """
    groups: dict[tuple[Any, ...], list[JobSpec]] = {}
    for job in jobs:
        place = (job.dataset, job.data_root, job.input, job.seed, job.results, job.package)
        groups.setdefault(place, []).append(job)
    found: list[ShapeBatch] = []
    large: dict[tuple[Any, ...], tuple[int, ShapeBatch]] = {}
    for place, group in groups.items():
        if again := tuple(job for job in group if job.ranks_again):
            found.append(ShapeBatch(again, ()))
            group = [job for job in group if not job.ranks_again]
        identifiers = list(dict.fromkeys(identifier for job in group for identifier in job.identifiers))
        sizes = {identifier: size for job in group for identifier, size in job.file_sizes.items()}
        if any(job.is_foreign for job in group):  # galleries are sorted by class; neither order nor size is to tell it
            sizes = {}
            secrets.SystemRandom().shuffle(identifiers)
        for identifier in [each for each in identifiers if sizes.get(each, 0) > LARGE_FILE]:
            shape = (*place[:3], identifier)
            if shape not in large:  # what others of the same shape find prepared takes them no longer than any other
                large[shape] = sizes[identifier], _batch(group, (identifier,))
                identifiers.remove(identifier)
        starts = range(0, len(identifiers), LARGEST_BATCH)
        found += [_batch(group, tuple(identifiers[start : start + LARGEST_BATCH])) for start in starts]
    return [batch for _, batch in sorted(large.values(), key=lambda pair: -pair[0])] + found


def _batch(group: list[JobSpec], chosen: tuple[str, ...]) -> ShapeBatch:
    wanted = set(chosen)
    return ShapeBatch(tuple(job for job in group if wanted & set(job.identifiers)), chosen)


#: Shapes in one batch.
LARGEST_BATCH = 40

#: Bytes of a file beyond which preparing its shape takes longer than all else: some 100 000 vertices.
LARGE_FILE = 2**23
