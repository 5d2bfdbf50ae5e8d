"""Jobs, and the tasks into which they are divided for workers."""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec

from benchmark.api.contracts import Input
from benchmark.api.parameters import format_value
from benchmark.datasets.own import is_own
from benchmark.pipeline.artefact_ranking import BLOCK
from benchmark.pipeline.recipes import draws_of
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.scorers import DEFAULT, ScorerSpec
from benchmark.protocols.models import Model

State = Literal["cached", "failed", "stale", "published", "missing", "unavailable", "unsupported"]


@dataclass(frozen=True, kw_only=True)
class Job:
    """One job: a method on a gallery with one input.

    Parameters
    ----------
    key
        Key of its record; "" if it cannot run.
    facts
        Entries of the record that describe gallery and method.
    table
        Identifier of its table.
    dataset, data_root
        Source of the shapes.
    identifiers
        The shapes of the gallery, in matrix order.
    input, method, seed
        How to process the shapes.
    results
        Folder of the store.
    recipe
        Everything that determines the scores.
    models
        Trained models by training; empty if the method does not learn.
    trainings
        Training whose model is applied to a shape, by identifier.
    all_unseen
        Whether training on a shape of the gallery is an error.
    scorer
        Scorer that compares the forms.
    ranks_again
        Whether only measures must be computed: the distances of an older record are still valid.
    large_files
        Sizes in bytes of the files larger than :data:`LARGE_FILE`, by identifier.
    state
        ``cached``: has a record. ``failed``: failed before and runs again only on request. ``published``: has a record
        published with the suite, but no local one. ``stale``: has a record of another recipe. ``missing``: has no
        record. ``unavailable``: a package or a trained model is missing. ``unsupported``: the method does not accept
        the input.
    reason
        Reason for the state.
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
        """Gallery, input and method, and the scorer if it is not the default."""
        by = "" if self.scorer.name == DEFAULT else f" by {self.scorer.name}"
        return f"{self.gallery} {self.input} {self.method.name}{by}"

    @property
    def model_of(self) -> dict[str, Model]:
        """Trained model of each shape, by identifier."""
        return {identifier: self.models[training] for identifier, training in self.trainings.items()}

    @property
    def is_foreign(self) -> bool:
        """Whether it runs code from outside the suite."""
        return self.method.is_foreign or self.scorer.is_foreign or is_own(self.dataset)

    @property
    def to_run(self) -> bool:
        """Whether a run would compute it."""
        return self.state in ("missing", "stale", "published")

    @property
    def package(self) -> str:
        """Package or plugin file of its method and scorer; jobs of one package may share a process."""
        packages = dict.fromkeys(_package(module) for module in (self.method.module, self.scorer.module))
        return " ".join(package for package in packages if package != "retrieval")


def _package(module: str) -> str:
    return module if module.endswith(".py") else module.partition(".")[0]


class Task(msgspec.Struct, frozen=True):
    """A part of one or more jobs for one process: shapes to process, a block of distances, or the ranking.

    Parameters
    ----------
    jobs
        Jobs of a task of shapes share data set, input, seed and package; a block belongs to one job.
    identifiers
        Shapes; all jobs process a shape before any job processes the next one.
    block
        Draw of the scorer and number of the first row of a block of distances.
    is_part
        Whether it was cut from another task; if so, it is neither counted, merged nor cut again.
    """

    jobs: tuple[Job, ...]
    identifiers: tuple[str, ...] = ()
    block: tuple[int | None, int] | None = None
    is_part: bool = False


@dataclass(frozen=True)
class Status:
    """Latest progress reported for a task.

    Parameters
    ----------
    job
        Key of the current job; "" before the first.
    steps
        Number of finished shapes.
    shape
        Identifier of the current shape; "" between shapes.
    is_starting
        Whether the process of a plugin is starting; this time does not count towards the timeout.
    """

    job: str = ""
    steps: int = 0
    shape: str = ""
    is_starting: bool = False


def to_json(task: Task) -> str:
    """Write a task as JSON; parameters of methods are written as text and parsed again on reading."""
    return json.dumps(msgspec.to_builtins(task, enc_hook=format_value))


def task_of(text: str) -> Task:
    """Read a task; raise ``ConfigurationError`` if its method or scorer does not exist here."""
    return msgspec.convert(json.loads(text), Task, dec_hook=lambda custom, value: custom(value))


def first_tasks(jobs: Iterable[Job]) -> list[Task]:
    """Divide the shapes of jobs into tasks; a job with valid distances is only ranked.

    Jobs on the same shapes share tasks, so that preparation and geodesics of a shape are computed once for all methods.
    Large files come first, since the run would otherwise end with one worker busy and the others idle.
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
        if any(job.is_foreign for job in group):  # neither order nor file size may reveal classes
            secrets.SystemRandom().shuffle(identifiers)
        for start in range(0, len(identifiers), LARGEST_BATCH):
            chosen = tuple(identifiers[start : start + LARGEST_BATCH])
            tasks.append(Task(tuple(job for job in group if not set(chosen).isdisjoint(job.identifiers)), chosen))
    return tasks


def comparison_tasks(job: Job) -> list[Task]:
    """Divide the distances of a job into blocks of rows for each draw; plugins compare a whole gallery at once."""
    starts = range(0, 1 if job.method.describes or job.scorer.is_foreign else len(job.identifiers), BLOCK)
    return [Task((job,), block=(draw, start)) for draw in draws_of(job.method, job.scorer) for start in starts]


#: Maximum number of shapes in one task.
LARGEST_BATCH = 40

#: File size in bytes above which preparation dominates the cost of a shape: about 100 000 vertices.
LARGE_FILE = 2**23
