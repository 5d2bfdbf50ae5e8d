"""Plan a run: the jobs of galleries and methods, which of them have a record, and what changed since for the others."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

import msgspec

from benchmark.api.contracts import Input
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.code_digest import code_of_modules, digest
from benchmark.datasets.catalogue import is_known, is_path
from benchmark.errors import ConfigurationError
from benchmark.pipeline.cache import Cache, Keys
from benchmark.pipeline.records import Record, Row, read_records
from benchmark.pipeline.stages import Preparation
from benchmark.protocols.galleries import Gallery
from benchmark.protocols.models import MissingModel, Model, TooNear
from benchmark.protocols.trainings import NoFolds
from benchmark.registry import Component, select_one
from benchmark.runs.tasks import Job, Step

#: Module with the code of all measures.
MEASURES = "benchmark.pipeline.measures"

State = Literal["finished", "failed", "missing", "stale", "unavailable", "unsupported"]

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
    keys: tuple[Keys, ...] = field(repr=False)
    models: Mapping[str, Model] = field(repr=False)
    state: State
    reason: str
    replaces: str
    to_run: bool

    @property
    def name(self) -> str:
        """Gallery, input and method, for messages."""
        return self.job.name

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the shapes, in the order of the distance matrix."""
        return tuple(self.facts["shapes"])

    def steps(self) -> Iterator[tuple[Entry, Step]]:
        """Yield each shape with its step."""
        for entry, keys in zip(self.gallery.entries, self.keys, strict=True):
            model = self.models.get(entry.identifier)
            yield entry, Step(self.job, keys, model.folder if model else None)

    def record(self, **facts: Any) -> Record:
        """Return the record of the job with further facts."""
        files = dict(zip(("prepared", "forms", "signatures"), map(list, zip(*self.keys, strict=True)), strict=False))
        models = {model.training: model.summary() for model in self.models.values()}
        known = {**self.facts, "models": [*models.values()], "seen": _seen(self.gallery, self.models)}
        return msgspec.convert({**known, "files": files or None, **facts}, Record)


def _seen(gallery: Gallery, models: Mapping[str, Model]) -> list[str]:
    """Return the names of the shapes that the model for them was trained on."""
    pairs = [(entry, models.get(entry.identifier)) for entry in gallery.entries]
    return [entry.identifier for entry, model in pairs if model and model.has_seen(entry, gallery.dataset.name)]


def plan(
    galleries: Iterable[Gallery],
    inputs: Iterable[Input],
    methods: Iterable[Component],
    results: Path,
    *,
    scorer: Component | None = None,
    seed: int = 0,
    again: Again = "",
    named: bool = False,
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
    named
        Whether the methods were selected by name.
    """
    scorer = scorer or select_one("cm-bof", kind="scorer")
    records = {record.row: record for record in read_records(results, published=False)}
    planning = _Planning(results.absolute(), scorer, seed, again, records)
    chosen, wanted = list[Any](methods), list(inputs)
    jobs = [
        planning.job(gallery, input_, method)
        for gallery in galleries
        for input_ in wanted
        if input_ in gallery.inputs
        for method in gallery.rows(input_, chosen, results / "models", named=named)
    ]
    return list({job.job.key: job for job in jobs}.values())


@dataclass
class _Planning:
    """What all jobs of a plan share."""

    results: Path
    scorer: Component
    seed: int
    again: Again
    records: Mapping[Row, Record]

    def __post_init__(self) -> None:
        self._key, self._code = cache(Component.key), cache(Component.code)
        self._preparations: dict[tuple[str, Input], Preparation] = {}
        self._measures = code_of_modules([MEASURES])

    def job(self, gallery: Gallery, input_: Input, method: Component) -> Planned:
        """Return the job of a row with its state."""
        scores = not method.missing_packages() and not method.describes
        facts = gallery_facts(gallery, input_) | {
            "status": "ok",
            "method": method.name,
            "title": method.title,
            "family": method.info.family,
            "parameters": json.loads(json.dumps(dict(method.parameters), default=str)),
            "seed": self.seed,
            "scorer": self.scorer.name if scores else "",
            "scorer_title": self.scorer.title if scores else "",
        }
        row = Row(gallery.name, input_, method.name, self.seed, facts["scorer"])
        before = self.records.get(row)
        state, reason, models = _obstacle(gallery, input_, method, self.results / "models")
        keys: list[Keys] = []
        if state is None:
            keys = self._keys(gallery, input_, method, models, scores=scores)
            facts["key"] = digest([row, facts["gallery_digest"], keys, self._measures])
            facts["parts"] = self._parts(gallery, input_, method, models, scores=scores)
            facts["parts"]["the data"] = facts["gallery_digest"]
            state, reason = _state(before, facts)
        else:
            facts["key"] = digest(["unavailable", row])
        source = gallery.source
        if is_path(source) and not is_known(source):  # workers may have another working directory
            source = str(Path(source).absolute())
        by = "" if self.scorer.name == "cm-bof" else f" by {self.scorer.name}"
        job = Job(
            facts["key"], f"{gallery.name} {input_} {method.name}{by}", source,
            gallery.data_root and gallery.data_root.absolute(), input_, method, self.scorer, self.seed, self.results,
            digest([self._key(method), self._key(self.scorer)]) if keys else "",
        )  # fmt: skip
        runs = state in ("missing", "stale") or (state in ("finished", "failed") and self.again in ("all", state))
        replaces = before.key if before else ""
        return Planned(job, gallery, facts, tuple(keys), models, state, reason, replaces, to_run=runs)

    def _keys(
        self, gallery: Gallery, input_: Input, method: Component, models: Mapping[str, Model], *, scores: bool
    ) -> list[Keys]:
        """Return the keys of the files of each shape."""
        preparation, keys = self._preparation(gallery, input_), []
        for entry in gallery.entries:
            prepared, model = preparation.key(entry), models.get(entry.identifier)
            form = digest([prepared, self._key(method), self.seed, model.digest if model else ""])
            keys.append(Keys(prepared, form, digest([form, self._key(self.scorer)]) if scores else ""))
        return keys

    def _parts(
        self, gallery: Gallery, input_: Input, method: Component, models: Mapping[str, Model], *, scores: bool
    ) -> dict[str, str]:
        """Return what determines the scores, by names that a user understands."""
        preparation = self._preparation(gallery, input_)
        parts = preparation.code | self._code(method) | self._measures | (self._code(self.scorer) if scores else {})
        parts["the camera"] = preparation.camera_key
        for name, component in (("its", method), ("the scorer's", self.scorer)):
            parts[f"{name} parameters"] = json.dumps(dict(component.parameters), sort_keys=True, default=str)
        return parts | {f"the model {model.training}": model.digest for model in models.values()}

    def _preparation(self, gallery: Gallery, input_: Input) -> Preparation:
        key = (gallery.source, input_)
        if key not in self._preparations:
            self._preparations[key] = Preparation(gallery.dataset, input_, Cache(self.results))
        return self._preparations[key]


def gallery_facts(gallery: Gallery, input_: Input) -> dict[str, Any]:
    """Return the fields of a record that describe the shapes of a gallery."""
    shapes = gallery.dataset
    content = [(entry.identifier, entry.subject, _content_key(shapes, entry)) for entry in gallery.entries]
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


def _content_key(shapes: ShapeSet, entry: Entry) -> str:
    try:
        return str(shapes.key(entry))
    except ConfigurationError:
        raise
    except Exception as error:  # an unreadable file, which is refused when it is prepared
        return type(error).__name__


def _obstacle(
    gallery: Gallery, input_: Input, method: Component, trained_here: Path
) -> tuple[State | None, str, dict[str, Model]]:
    """Return why a job cannot run, as a state with the reason, or None with the model of each shape."""
    if missing := method.missing_packages():
        return "unavailable", f"needs {', '.join(missing)}: pip install {' '.join(missing)}", {}
    if input_ not in method.info.inputs:
        return "unsupported", f"does not take the {input_} input", {}
    try:
        models = gallery.models(method, trained_here)
    except MissingModel as error:
        return "unavailable", str(error), {}
    except (NoFolds, TooNear) as error:
        return "unsupported", str(error), {}
    if gallery.table.all_unseen and (seen := _seen(gallery, models)):
        reason = f"{len(seen)} shapes were seen in training, such as {seen[0]}; take a model of another training"
        return "unsupported", reason, models
    return None, "", models


def _state(record: Record | None, facts: Mapping[str, Any]) -> tuple[State, str]:
    """Return the state of a job that can run and the reason for it, from the record of its row."""
    if record is None:
        return "missing", "never run"
    if record.key != facts["key"]:
        return "stale", describe_change(record.parts, facts["parts"])
    return ("finished", "") if record.status == "ok" else ("failed", f"{record.status}: {record.reason}")


def describe_change(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Say in words which parts of a key changed: ``gps.py changed; numpy 2.3 -> 2.4``; at most three of them."""
    changed = [name for name in sorted(before.keys() | now.keys()) if before.get(name) != now.get(name)]
    texts = list(dict.fromkeys(_in_words(name, before.get(name, ""), now.get(name, "")) for name in changed))
    return "; ".join(texts[:3]) + (f"; and {len(texts) - 3} more" if len(texts) > 3 else "") or "the code changed"


def _in_words(name: str, before: str, now: str) -> str:
    if name.startswith(("its ", "the ")):
        return f"{name} changed"
    if re.fullmatch("[0-9a-f]{16}", now or before):  # the digest of a file
        return f"{Path(name).name} {'changed' if before and now else 'is new' if now else 'is no longer used'}"
    return f"{name} {before or 'none'} -> {now or 'none'}"
