"""Jobs, and the tasks into which they are divided for workers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

from benchmark.api.contracts import Input
from benchmark.pipeline.keys import Keys
from benchmark.registry.components import Component

State = Literal["finished", "failed", "missing", "stale", "unavailable", "unsupported"]


@dataclass(frozen=True)
class Job:
    """A method on a gallery under one input, as a worker gets it: without the gallery.

    Parameters
    ----------
    key
        Key of its record.
    name
        Gallery, input and method, for messages.
    source, data_root, plugins
        Where the shapes come from: a name or a folder, the folder of official sets, and plugin files.
    input, method, scorer, seed
        What to do with them.
    results
        The results folder.
    code
        Digest of the code that the plan saw; a worker with other code refuses the job.
    """

    key: str
    name: str
    source: str
    data_root: Path | None
    plugins: tuple[Path, ...]
    input: Input
    method: Component
    scorer: Component
    seed: int
    results: Path
    code: str

    @property
    def plugin(self) -> str:
        """Plugin files that it runs; a worker serves the suite or one plugin."""
        return " ".join(sorted({str(part.plugin) for part in (self.method, self.scorer) if part.plugin}))


class Step(NamedTuple):
    """A job at one shape, or its ranking."""

    job: Job
    keys: Keys = Keys("", "", "")
    model: Path | None = None


class Task(NamedTuple):
    """Work for one worker: all steps at one shape, or the ranking of one job.

    Parameters
    ----------
    steps
        The steps, of jobs on one data set; each yields an outcome, in order.
    shape
        Name of the shape; "" for a ranking.
    gallery
        For a ranking: the shapes with their classes, keys and models, and those that are lost in this run.
    """

    steps: tuple[Step, ...]
    shape: str = ""
    gallery: Gallery | None = None


class Gallery(NamedTuple):
    """The shapes that a job ranks against each other."""

    shapes: tuple[str, ...]
    labels: tuple[str, ...]
    keys: tuple[Keys, ...]
    models: tuple[Path | None, ...]
    lost: Mapping[str, str]


@dataclass(frozen=True)
class Outcome:
    """What became of a step.

    Parameters
    ----------
    status
        ``"ok"``, ``"refused"`` (the shape by this method), ``"lost"`` (the shape for all methods in this run),
        ``"storage"`` (the results folder cannot be written), ``"changed"`` (other code than in the plan), or the
        status of the record of a job that failed.
    reason, traceback
        Why there is no result.
    content
        Of a ranking: what its record says.
    """

    status: str
    reason: str = ""
    traceback: str = ""
    content: Mapping[str, Any] = field(default_factory=dict)
