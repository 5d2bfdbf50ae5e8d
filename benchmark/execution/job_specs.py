"""Jobs, as they are planned, wait in the queue and travel to workers, and the tasks that they are cut into."""

from __future__ import annotations

import json
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from benchmark.api.contracts import Input
from benchmark.api.parameters import format_value
from benchmark.datasets.own import is_own
from benchmark.pipeline.ranking import BLOCK
from benchmark.pipeline.recipes import draws_of
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.scorers import DEFAULT, ScorerSpec
from benchmark.protocols.models import Model

State = Literal["cached", "failed", "stale", "published", "missing", "unavailable", "unsupported"]

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Job:
    """One job: a method on a gallery under one input.

    Parameters
    ----------
    key
        Name of its record; "" where none can be made.
    facts
        What the record tells of gallery and method besides scores.
    table
        Identifier of the table that it belongs to.
    dataset, data_root
        Where the shapes come from.
    identifiers
        The shapes of the gallery, in matrix order.
    input, method, seed
        What is made of them.
    results
        Folder of the store.
    recipe
        Everything that determines the scores.
    models
        Trained models by the names of their trainings; empty for a method that does not learn.
    trainings
        The training whose model treats a shape, by identifier.
    all_unseen
        Whether it is an error that a model was trained on one of the shapes.
    split_size
        Test subjects in each of all the ways to choose some; 0 where nobody asks for them.
    scorer
        What compares the forms.
    ranks_again
        Whether nothing but its measures is to be made: its distances are kept from an older record.
    large_files
        Bytes of those files of its shapes that are larger than :data:`LARGE_FILE`, by identifier.
    state
        ``cached``: a record is there. ``failed``: it failed before and is not repeated unasked. ``published``: a record
        came with the suite, none was made here. ``stale``: there is a record of another recipe. ``missing``: there is
        none. ``unavailable``: a package or a trained model is missing. ``unsupported``: the method does not take the
        input.
    reason
        Why it is in this state.
    """

    key: str
    facts: Mapping[str, Any]
    table: str
    dataset: str
    data_root: Path | None
    identifiers: tuple[str, ...]
    input: Input
    method: MethodSpec
    seed: int
    results: Path
    recipe: Mapping[str, Any]
    models: Mapping[str, Model] = field(default_factory=dict)
    trainings: Mapping[str, str] = field(default_factory=dict)
    all_unseen: bool = False
    split_size: int = 0
    scorer: ScorerSpec = field(default_factory=ScorerSpec)
    ranks_again: bool = False
    large_files: Mapping[str, int] = field(default_factory=dict)
    state: State = "missing"
    reason: str = "never run"

    @property
    def gallery(self) -> str:
        """Name of the gallery."""
        return str(self.facts["gallery"])

    @property
    def name(self) -> str:
        """Gallery, input and method, as people name a job, and the scorer where it is not the default one."""
        by = "" if self.scorer.name == DEFAULT else f" by {self.scorer.name}"
        return f"{self.gallery} {self.input} {self.method.name}{by}"

    @property
    def model_of(self) -> dict[str, Model]:
        """Trained model of each shape by identifier."""
        return {identifier: self.models[training] for identifier, training in self.trainings.items()}

    @property
    def is_foreign(self) -> bool:
        """Return whether code that is none of this suite makes a part of it."""
        return self.method.is_foreign or self.scorer.is_foreign or is_own(self.dataset)

    @property
    def to_run(self) -> bool:
        """Return whether a run would compute it."""
        return self.state in ("missing", "stale", "published")

    @property
    def package(self) -> str:
        """Jobs of one package may share a process: all built-in methods of a package, or those of one plugin file."""
        packages = dict.fromkeys(_package(module) for module in (self.method.module, self.scorer.module))
        return " ".join(package for package in packages if package != "retrieval")


def _package(module: str) -> str:
    return module if module.endswith(".py") else module.partition(".")[0]


class ShapeBatch(msgspec.Struct, frozen=True, tag=True):
    """Some shapes of a data set under one input, each to be treated by several methods before the next one.

    Parameters
    ----------
    jobs
        Jobs of one data set, input, seed and package; each treats those of the shapes that are in its gallery.
    identifiers
        The shapes.
    is_repeat
        Whether the shapes are counted with another batch, which treats them, too.
    """

    jobs: tuple[Job, ...]
    identifiers: tuple[str, ...]
    is_repeat: bool = False


class ScoringTask(msgspec.Struct, frozen=True, tag=True):
    """The second half of jobs: all their shapes are treated, and are to be ranked."""

    jobs: tuple[Job, ...]


class ComparisonTask(msgspec.Struct, frozen=True, tag=True):
    """Comparing a block of shapes of one job with those before it, all of them treated, under one draw of its scorer.

    Parameters
    ----------
    jobs
        The job alone.
    draw
        The draw.
    start
        Number of the first shape of the block.
    """

    jobs: tuple[Job, ...]
    draw: int | None
    start: int = 0


Task = ShapeBatch | ScoringTask | ComparisonTask


def to_json(task: Task | Job) -> str:
    """Write a task or a job; a parameter of a method is written as text, which the method reads again."""
    return json.dumps(msgspec.to_builtins(task, enc_hook=format_value))


def task_of(text: str) -> Task:
    """Return the task that was written; raises ``ConfigurationError`` if there is no such method or scorer here."""
    return _read(text, Task)  # type: ignore[arg-type]


def job_of(text: str) -> Job:
    """Return the job that was written; see :func:`task_of`."""
    return _read(text, Job)


def _read(text: str, kind: type[T]) -> T:
    return msgspec.convert(json.loads(text), kind, dec_hook=lambda custom, value: custom(value))


def shape_batches(jobs: list[Job]) -> list[ShapeBatch]:
    """Cut the first half of jobs into batches.

    Jobs that treat the same shapes go together, so that a shape is prepared, and its geodesics are computed, once for
    all methods. Large files come first, each in a batch of its own: at the end, all would wait for the last of them.
    """
    groups: dict[tuple[Any, ...], list[Job]] = {}
    for job in jobs:
        place = (job.dataset, job.data_root, job.input, job.seed, job.results, job.package)
        groups.setdefault(place, []).append(job)
    batches: list[ShapeBatch] = []
    large: dict[tuple[Any, ...], tuple[int, ShapeBatch]] = {}
    for place, group in groups.items():
        if again := tuple(job for job in group if job.ranks_again):
            batches.append(ShapeBatch(again, ()))
            group = [job for job in group if not job.ranks_again]
        identifiers = list(dict.fromkeys(identifier for job in group for identifier in job.identifiers))
        sizes = {identifier: size for job in group for identifier, size in job.large_files.items()}
        if any(job.is_foreign for job in group):  # galleries are sorted by class; neither order nor size is to tell it
            sizes = {}
            secrets.SystemRandom().shuffle(identifiers)
        for identifier in [name for name in identifiers if name in sizes]:
            shape = (*place[:3], identifier)
            if shape not in large:  # what others of the same shape find prepared takes them no longer than any other
                large[shape] = sizes[identifier], _batch(group, (identifier,))
                identifiers.remove(identifier)
        starts = range(0, len(identifiers), LARGEST_BATCH)
        batches += [_batch(group, tuple(identifiers[start : start + LARGEST_BATCH])) for start in starts]
    return [batch for _, batch in sorted(large.values(), key=lambda pair: -pair[0])] + batches


def _batch(group: list[Job], chosen: tuple[str, ...]) -> ShapeBatch:
    return ShapeBatch(tuple(job for job in group if not set(chosen).isdisjoint(job.identifiers)), chosen)


def comparison_tasks(job: Job) -> list[ComparisonTask]:
    """Cut the ranking of a job into blocks of rows under each draw; code of plugins compares a gallery at once."""
    starts = range(0, 1 if job.method.describes or job.scorer.is_foreign else len(job.identifiers), BLOCK)
    return [ComparisonTask((job,), draw, start) for draw in draws_of(job.method, job.scorer) for start in starts]


#: Shapes in one batch.
LARGEST_BATCH = 40

#: Bytes of a file beyond which preparing its shape takes longer than all else: some 100 000 vertices.
LARGE_FILE = 2**23
