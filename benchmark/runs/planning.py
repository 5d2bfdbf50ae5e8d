"""Plan a run: the jobs of galleries and methods, which of them have a record, and what changed since for the others."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Literal

import msgspec

from benchmark.api.contracts import Input
from benchmark.datasets.catalogue import is_known, is_path
from benchmark.errors import ConfigurationError
from benchmark.pipeline.keys import Keys, code_of_modules, digest, keys_of
from benchmark.pipeline.records import Place, Record, describe_change, read_records
from benchmark.pipeline.shapes import Preparation
from benchmark.protocols.galleries import Gallery
from benchmark.protocols.models import MissingModel, Model, TooNear, find_models
from benchmark.protocols.trainings import NoFolds
from benchmark.registry import Component, select_one
from benchmark.runs.jobs import Job, State, Step

#: Module with the code of all measures.
MEASURES = "benchmark.pipeline.measures"

#: Which jobs with a record run again: none, those that failed, or all.
Again = Literal["", "failed", "all"]


@dataclass(frozen=True)
class Planned:
    """A job with its gallery, and what is known of it.

    Parameters
    ----------
    job
        The job.
    gallery
        The shapes.
    facts
        Fields of its record that are known in advance.
    keys
        Keys of the cached files of each shape.
    models
        Trained model of each shape, by name; empty if the method does not learn.
    state, reason
        ``finished``: it has a record. ``failed``: its record says that it failed. ``stale``: its record is of other
        code, data or parameters; the reason names them. ``missing``: it has none. ``unavailable``: a package or a
        trained model is missing. ``unsupported``: the method does not take the input.
    replaces
        Key of the record that its own replaces; "" if there is none.
    to_run
        Whether a run would do it.
    """

    job: Job
    gallery: Gallery
    facts: Mapping[str, Any] = field(repr=False)
    keys: tuple[Keys, ...] = field(default=(), repr=False)
    models: Mapping[str, Model] = field(default_factory=dict, repr=False)
    state: State = "missing"
    reason: str = "never run"
    replaces: str = ""
    to_run: bool = False

    @property
    def name(self) -> str:
        """Gallery, input and method, for messages."""
        return self.job.name

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the shapes, in the order of the distance matrix."""
        return tuple(self.facts["shapes"])

    @property
    def labels(self) -> tuple[str, ...]:
        """Classes of the shapes."""
        return tuple(self.facts["labels"])

    def model_of(self, shape: str) -> Path | None:
        """Return the folder of the model for a shape, if the method learns."""
        return self.models[shape].folder if shape in self.models else None

    def steps(self) -> Iterator[tuple[Step, str, Path | None]]:
        """Yield the step of each shape with its name and file."""
        for entry, keys in zip(self.gallery.entries, self.keys, strict=True):
            yield Step(self.job, keys, self.model_of(entry.identifier)), entry.identifier, entry.path

    def record(self, **facts: Any) -> Record:
        """Return the record of the job with further facts."""
        files = dict(zip(("prepared", "forms", "signatures"), map(list, zip(*self.keys, strict=True)), strict=False))
        summaries = {model.training: model.summary() for model in self.models.values()}
        content = {**self.facts, "models": [*summaries.values()], "seen": self.seen, "files": files or None, **facts}
        return msgspec.convert(content, Record)

    @property
    def seen(self) -> list[str]:
        """Names of the shapes that the model for them was trained on."""
        dataset, pairs = self.gallery.dataset.name, [(e, self.models.get(e.identifier)) for e in self.gallery.entries]
        return [entry.identifier for entry, model in pairs if model is not None and model.has_seen(entry, dataset)]


def plan(
    galleries: Iterable[Gallery],
    inputs: Iterable[Input],
    methods: Iterable[Component],
    results: Path,
    *,
    scorer: Component | None = None,
    seed: int = 0,
    again: Again = "",
    plugins: Iterable[Path] = (),
) -> list[Planned]:
    """List the jobs of a selection with their states.

    Parameters
    ----------
    galleries, inputs, methods
        The selection.
    results
        The results folder.
    scorer
        Scorer of the forms; None for that of the tables.
    seed
        Base seed of all methods.
    again
        Which jobs with a record run again.
    plugins
        Plugin files that define data sets.
    """
    planning = _Planning(results.absolute(), scorer or select_one("cm-bof", kind="scorer"), seed, again, tuple(plugins))
    chosen, taken = list[Any](methods), list(inputs)
    jobs = [
        planning.job(gallery, input_, method)
        for gallery in galleries
        for rows in [gallery.rows(chosen, results / "models")]
        for input_ in taken
        if input_ in gallery.inputs
        for method in rows
    ]
    return list({job.job.key: job for job in jobs}.values())


@dataclass
class _Planning:
    """What all jobs of a plan share."""

    results: Path
    scorer: Component
    seed: int
    again: Again
    plugins: tuple[Path, ...]
    _preparations: dict[tuple[str, str], Preparation] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._key = cache(Component.key)

    @cached_property
    def _scorer_code(self) -> dict[str, str]:
        return self.scorer.code()

    @cached_property
    def _records(self) -> dict[Place, Record]:
        return {record.place: record for record in read_records(self.results, published=False)}

    def job(self, gallery: Gallery, input_: Input, method: Component) -> Planned:
        """Return the job of a row with its state."""
        missing = method.missing_packages()
        scores = not missing and not method.describes
        facts = self._facts(gallery, input_, method, scores=scores)
        place = Place(gallery.name, input_, method.name, self.seed, facts["scorer"])
        facts["key"] = digest(["unavailable", place])
        planned = Planned(self._job(gallery, input_, method, facts["key"], ""), gallery, facts)
        before = self._records.get(place)
        planned = replace(planned, replaces=before.key if before else "")
        if missing:
            reason = f"needs {', '.join(missing)}: pip install {' '.join(missing)}"
            return replace(planned, state="unavailable", reason=reason)
        if input_ not in method.info.inputs:
            return replace(planned, state="unsupported", reason=f"does not take the {input_} input")
        try:
            models = find_models(method, gallery, self.results / "models")
        except MissingModel as error:
            return replace(planned, state="unavailable", reason=str(error))
        except (NoFolds, TooNear) as error:
            return replace(planned, state="unsupported", reason=str(error))
        planned = replace(planned, models=models)
        if (seen := planned.seen) and gallery.table.all_unseen:
            reason = f"{len(seen)} shapes were seen in training, such as {seen[0]}; take a model of another training"
            return replace(planned, state="unsupported", reason=reason)
        planned = self._with_keys(planned, scores=scores)
        state, reason = _state(planned, before)
        runs = state in ("missing", "stale") or self.again == "all" or (state == "failed" and self.again == "failed")
        return replace(planned, state=state, reason=reason, to_run=runs)

    def _with_keys(self, planned: Planned, *, scores: bool) -> Planned:
        """Return the job with the keys of its record and its files."""
        job, gallery, models = planned.job, planned.gallery, planned.models
        preparation = self._preparation(gallery, job.input)
        method, scorer = self._key(job.method), self._key(self.scorer)
        digests = {name: model.digest for name, model in models.items()}
        keys = [
            keys_of(preparation.key(e), method, self.seed, digests.get(e.identifier, ""), scorer if scores else None)
            for e in gallery.entries
        ]
        measures = code_of_modules([MEASURES])
        code = {**preparation.code, **job.method.code(), **measures}
        parts = {
            **code,
            **(self._scorer_code if scores else {}),
            "the data": planned.facts["gallery_digest"],
            "the camera": preparation.camera_key,
            "its parameters": json.dumps(method["parameters"], sort_keys=True, default=str),
            "the scorer's parameters": json.dumps(scorer["parameters"], sort_keys=True, default=str),
            **{f"the model {model.training}": model.digest for model in models.values()},
        }
        content = [place_of(planned.facts), planned.facts["gallery_digest"], keys, measures]
        key = digest(content)
        facts = {**planned.facts, "key": key, "parts": parts}
        job = replace(job, key=key, code=digest([method, scorer]))
        return replace(planned, job=job, facts=facts, keys=tuple(keys))

    def _preparation(self, gallery: Gallery, input_: Input) -> Preparation:
        place = (gallery.source, input_)
        if place not in self._preparations:
            self._preparations[place] = Preparation(gallery.dataset, input_)
        return self._preparations[place]

    def _job(self, gallery: Gallery, input_: Input, method: Component, key: str, code: str) -> Job:
        source = gallery.source
        if is_path(source) and not is_known(source):  # workers may have another working directory
            source = str(Path(source).absolute())
        by = "" if self.scorer.name == "cm-bof" else f" by {self.scorer.name}"
        return Job(
            key, f"{gallery.name} {input_} {method.name}{by}", source,
            gallery.data_root and gallery.data_root.absolute(),
            self.plugins, input_, method, self.scorer, self.seed, self.results, code,
        )  # fmt: skip

    def _facts(self, gallery: Gallery, input_: Input, method: Component, *, scores: bool) -> dict[str, Any]:
        """Return the fields of a record that are known in advance."""
        return {
            **gallery_facts(gallery, input_),
            "status": "ok",
            "method": method.name,
            "title": method.title,
            "family": method.info.family,
            "parameters": json.loads(json.dumps(dict(method.parameters), default=str)),
            "seed": self.seed,
            "scorer": self.scorer.name if scores else "",
            "scorer_title": self.scorer.title if scores else "",
        }


def gallery_facts(gallery: Gallery, input_: Input) -> dict[str, Any]:
    """Return the fields of a record that describe the shapes of a gallery."""
    shapes = gallery.dataset
    content = [(entry.identifier, entry.subject, _key_of(shapes, entry)) for entry in gallery.entries]
    return {
        "gallery": gallery.name,
        "gallery_digest": digest(content),
        "input": input_,
        "data": {
            "name": shapes.name,
            "title": shapes.title,
            "source": gallery.source,
            "stand_in_for": shapes.stand_in_for,
            "quick": gallery.quick,
        },
        "shapes": [entry.identifier for entry in gallery.entries],
        "labels": [entry.subject for entry in gallery.entries],
    }


def place_of(facts: Mapping[str, Any]) -> Place:
    """Return the place of the record with these facts."""
    return Place(facts["gallery"], facts["input"], facts["method"], facts["seed"], facts["scorer"])


def _key_of(shapes: Any, entry: Any) -> str:
    try:
        return str(shapes.key(entry))
    except ConfigurationError:
        raise
    except Exception as error:  # an unreadable file, which is refused when it is prepared
        return type(error).__name__


def _state(planned: Planned, record: Record | None) -> tuple[State, str]:
    """Return the state of a job and the reason for it, from the record of its place."""
    if record is None:
        return "missing", "never run"
    if record.key != planned.job.key:
        return "stale", describe_change(record.parts, planned.facts["parts"])
    if record.status != "ok":
        return "failed", f"{record.status}: {record.reason}"
    return "finished", ""
