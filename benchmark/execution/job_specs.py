"""Jobs, as they are planned, wait in the queue and travel to workers, and the tasks that they are cut into."""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterable, Mapping
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


class Task(msgspec.Struct, frozen=True):
    """A part of some jobs, for one process: shapes to treat, or a block of distances, or else the ranking.

    Parameters
    ----------
    jobs
        Jobs of shapes share data set, input, seed and package; a block has one job.
    identifiers
        Shapes, each to be treated by all of the jobs that have it in their gallery before the next one.
    block
        Draw of the scorer, and number of the first shape, of a block of shapes to compare with those before it.
    is_part
        Whether it was cut from another task: it is not counted, not joined with others and not cut again.
    """

    jobs: tuple[Job, ...]
    identifiers: tuple[str, ...] = ()
    block: tuple[int | None, int] | None = None
    is_part: bool = False


@dataclass(frozen=True)
class Status:
    """Progress of a task, as its process said last.

    Parameters
    ----------
    job
        Key of the job that it is at; "" before the first one.
    steps
        Shapes of its batch that are behind it.
    shape
        Identifier of the shape that it is at; "" between shapes.
    is_starting
        Whether a process starts that imports the plugin of the job, which is no work of the job.
    """

    job: str = ""
    steps: int = 0
    shape: str = ""
    is_starting: bool = False


def to_json(task: Task | Job) -> str:
    """Write a task or a job; a parameter of a method is written as text, which the method reads again."""
    return json.dumps(msgspec.to_builtins(task, enc_hook=format_value))


def task_of(text: str) -> Task:
    """Return the task that was written; raises ``ConfigurationError`` if there is no such method or scorer here."""
    return _read(text, Task)


def job_of(text: str) -> Job:
    """Return the job that was written; see :func:`task_of`."""
    return _read(text, Job)


def _read(text: str, kind: type[T]) -> T:
    return msgspec.convert(json.loads(text), kind, dec_hook=lambda custom, value: custom(value))


def first_tasks(jobs: Iterable[Job]) -> list[Task]:
    """Cut the shapes of jobs into tasks; a job whose distances are kept is ranked at once.

    Jobs that treat the same shapes go together, so that a shape is prepared, and its geodesics are computed, once for
    all methods. Large files come first: at the end, all would wait for the last of them.
    """
    tasks: list[Task] = []
    groups: dict[tuple[Any, ...], list[Job]] = {}
    for job in jobs:
        if job.ranks_again:
            tasks.append(Task((job,)))
        else:
            place = (job.dataset, job.data_root, job.input, job.seed, job.results, job.package)
            groups.setdefault(place, []).append(job)
    for group in groups.values():
        sizes = {identifier: job.large_files.get(identifier, 0) for job in group for identifier in job.identifiers}
        identifiers = sorted(sizes, key=lambda identifier: -sizes[identifier])
        if any(job.is_foreign for job in group):  # galleries are sorted by class; neither order nor size is to tell it
            secrets.SystemRandom().shuffle(identifiers)
        for start in range(0, len(identifiers), LARGEST_BATCH):
            chosen = tuple(identifiers[start : start + LARGEST_BATCH])
            tasks.append(Task(tuple(job for job in group if not set(chosen).isdisjoint(job.identifiers)), chosen))
    return tasks


def comparison_tasks(job: Job) -> list[Task]:
    """Cut the distances of a job into blocks of rows under each draw; code of plugins compares a gallery at once."""
    starts = range(0, 1 if job.method.describes or job.scorer.is_foreign else len(job.identifiers), BLOCK)
    return [Task((job,), block=(draw, start)) for draw in draws_of(job.method, job.scorer) for start in starts]


#: Shapes in one batch.
LARGEST_BATCH = 40

#: Bytes of a file beyond which preparing its shape takes longer than all else: some 100 000 vertices.
LARGE_FILE = 2**23
