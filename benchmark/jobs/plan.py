"""What would run and why: protocols x methods -> jobs. Nothing is computed here, records are only read."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from benchmark.contracts import Input
from benchmark.jobs import stages
from benchmark.methods.registry import MethodSpec
from benchmark.protocols.models import MissingModel, Model, find_models
from benchmark.protocols.tables import Gallery
from benchmark.protocols.trainings import NoFolds
from benchmark.storage import keys
from benchmark.storage.store import Store

State = Literal["cached", "failed", "stale", "missing", "unavailable", "unsupported"]

#: Recipe parts in the order in which a change is worth telling.
PARTS = ("gallery", "parameters", "models", "seed", "scorer", "view", "code")


@dataclass(frozen=True)
class Job:
    """One method on one gallery under one input.

    Parameters
    ----------
    key
        Names the recipe; the record of the job is kept under it.
    gallery
        The shapes.
    input
        What the method is given.
    method
        The method.
    recipe
        Everything that determines the scores.
    state
        ``cached``: a record is there. ``failed``: it failed before and is not repeated unasked. ``stale``: there is a
        record of another recipe. ``missing``: there is none. ``unavailable``: a package or a trained model is missing.
    reason
        Why it is in this state.
    models
        Trained model of each shape by identifier; empty for a method that does not learn.
    """

    key: str
    gallery: Gallery
    input: Input
    method: MethodSpec
    recipe: Mapping[str, Any]
    state: State
    reason: str
    models: Mapping[str, Model] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Data set, input and method, as people name a job."""
        return f"{self.gallery.name} {self.input} {self.method.name}"

    @property
    def to_run(self) -> bool:
        """Whether a run would compute it."""
        return self.state in ("missing", "stale")


def make_plan(
    galleries: Iterable[Gallery],
    inputs: Iterable[Input],
    methods: Iterable[MethodSpec],
    store: Store,
    seed: int = 0,
    retry: frozenset[str] = frozenset(),
) -> list[Job]:
    """List the jobs of a selection with their states.

    Parameters
    ----------
    galleries, inputs, methods
        The selection.
    store
        Where finished jobs are looked up.
    seed
        Base seed.
    retry
        Kinds of failure to run again: ``failed``, ``timeout``, ``crashed``, ``memory``, or ``all``.
    """
    latest = {_place(record): record for record in store.records()}
    specs, wanted_inputs = list(methods), list(inputs)
    jobs: list[Job] = []
    for gallery in galleries:
        rows = gallery.rows(specs, store.models)
        for input_ in wanted_inputs:
            if rows and input_ in gallery.table.inputs:
                data = _data_recipe(gallery, input_)
                jobs += [_job(gallery, input_, spec, data, latest, store, seed, retry) for spec in rows]
    return jobs


def _job(
    gallery: Gallery,
    input_: Input,
    spec: MethodSpec,
    data: Mapping[str, Any],
    latest: Mapping[tuple[Any, ...], Mapping[str, Any]],
    store: Store,
    seed: int,
    retry: frozenset[str],
) -> Job:
    models: dict[str, Model] = {}

    def job(state: State, reason: str, recipe: Mapping[str, Any] | None = None) -> Job:
        return Job(keys.digest(recipe) if recipe else "", gallery, input_, spec, recipe or {}, state, reason, models)

    missing = spec.missing_packages()
    if missing:
        return job("unavailable", f"needs {', '.join(missing)}: pip install {' '.join(missing)}")
    if input_ not in spec.info.inputs:
        return job("unsupported", f"does not take the {input_} input")
    try:
        models = find_models(spec, gallery, store.models)
    except MissingModel as error:
        return job("unavailable", str(error))
    except NoFolds as error:
        return job("unsupported", str(error))
    recipe = {
        **data,
        "method": spec.name,
        "input": input_,
        "parameters": spec.resolved_parameters(),
        "seed": seed,
        "scorer": {**dataclasses.asdict(stages.CMBOF()), "codebooks": stages.CODEBOOK_SEEDS},
        "code": {
            "method": _portable(keys.code_of(spec.module), spec.module),
            "preparation": keys.code_of(stages.PREPARATION if input_ == "mesh" else stages.VIEW),
            "scorer": keys.code_of(stages.SCORER) | keys.code_of("retrieval.metrics"),
        },
    }
    if models:
        recipe["models"] = {model.training: model.digest for model in models.values()}
    key = keys.digest(recipe)
    record = store.read_record(key)
    if record is not None:
        status = record["status"]
        if status == "ok" or status not in retry | ({status} if "all" in retry else set()):
            return job("cached" if status == "ok" else "failed", _told(record), recipe)
        return job("stale", f"{status} before, asked to retry", recipe)
    before = latest.get((gallery.name, input_, spec.name, seed))
    if before is None:
        return job("missing", "never run", recipe)
    return job("stale", difference(before["recipe"], recipe), recipe)


def difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Name the parts of a recipe that changed.

    Parameters
    ----------
    before, now
        Recipes of two jobs with the same place in the plan.
    """
    plain = keys.plain(now)
    changes = []
    for part in PARTS:
        old, new = before.get(part), plain.get(part)
        if old == new:
            continue
        if part == "code":
            old_modules = {name: print_ for group in (old or {}).values() for name, print_ in group.items()}
            new_modules = {name: print_ for group in new.values() for name, print_ in group.items()}
            changed = sorted(
                n for n in old_modules.keys() | new_modules.keys() if old_modules.get(n) != new_modules.get(n)
            )
            changes.append(f"code of {', '.join(changed[:3])}{' and others' if len(changed) > 3 else ''} changed")
        elif isinstance(old, dict) and isinstance(new, dict):
            changed = sorted(name for name in old.keys() | new.keys() if old.get(name) != new.get(name))
            changes.append(f"{part} changed: {', '.join(f'{n} {old.get(n)} -> {new.get(n)}' for n in changed[:3])}")
        elif part in ("gallery", "view"):
            changes.append("the data changed" if part == "gallery" else "the camera's frame changed")
        else:
            changes.append(f"{part} changed from {old} to {new}")
    return "; ".join(changes) or "the recipe changed"


def _data_recipe(gallery: Gallery, input_: Input) -> dict[str, Any]:
    """Digest of the shapes and their labels, and of the camera's frame for the view input."""
    dataset = gallery.dataset
    shapes = [(entry.identifier, entry.subject, stages.source_recipe(dataset, entry)) for entry in gallery.entries]
    recipe: dict[str, Any] = {"gallery": keys.digest(shapes)}
    if input_ == "view":
        whole = [
            (entry.identifier, stages.source_recipe(dataset, entry), repr(dataset.camera(entry)))
            for entry in dataset.entries
        ]
        recipe["view"] = keys.digest([dataset.half_width, whole])
    return recipe


def _portable(code: dict[str, str], module: str) -> dict[str, str]:
    """Name a plugin by its file name: where it lies does not change what it does."""
    return {
        Path(name).name if name == module and name.endswith(".py") else name: print_ for name, print_ in code.items()
    }


def _place(record: Mapping[str, Any]) -> tuple[Any, ...]:
    return record["gallery"], record["input"], record["method"], record["recipe"].get("seed")


def _told(record: Mapping[str, Any]) -> str:
    if record["status"] == "ok":
        return "finished"
    return f"{record['status']}: {record.get('reason', '')}"
