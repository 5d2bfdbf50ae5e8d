"""Plan a run: list the jobs of galleries and methods, and compare them with existing records."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Input
from benchmark.api.datasets import Entry
from benchmark.datasets.catalogue import is_known, is_path
from benchmark.execution.job_specs import LARGE_FILE, Job, State
from benchmark.execution.processes.opened_files import changed_files
from benchmark.pipeline import recipes
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.lock import edited, key_of, words_of_edit
from benchmark.pipeline.storage.record_schema import chance_of_labels
from benchmark.pipeline.storage.records import NO_SCORER, Place, Record, by_place
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.scorers import DEFAULT, ScorerSpec
from benchmark.protocols.galleries import Gallery
from benchmark.protocols.models import MissingModel, Model, TooNear, find_models
from benchmark.protocols.trainings import NoFolds

#: Parts of a recipe, in the order in which changes are reported.
PARTS = ("gallery", "parameters", "models", "seed", "scorer", "view", "versions", "plugin")

#: Status of a job that was stopped because the code was edited; the next run repeats it.
CHANGED = "changed"

#: Status of a job whose results could not be written; the next run repeats it.
UNSAVED = "unsaved"


def _large_files(gallery: Gallery) -> dict[str, int]:
    sizes = {entry.identifier: _size(entry.path) for entry in gallery.entries if entry.path is not None}
    return {identifier: size for identifier, size in sizes.items() if size > LARGE_FILE}


@cache
def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _facts(gallery: Gallery, input_: Input, spec: MethodSpec, scorer: ScorerSpec) -> dict[str, Any]:
    """Return the entries of a record that describe gallery and method; tables then need neither data nor plugin."""
    facts = {
        "gallery": gallery.name,
        "input": input_,
        "method": spec.name,
        "title": spec.title,
        "family": spec.info.family,
        "parameters": dict(spec.parameters),
        "data": data_facts(gallery),
        # The path of a plugin file is meaningless on other machines.
        "target": "" if any(m.endswith(".py") for m in (spec.module, scorer.module)) else spec.target,
    }
    if spec.describes:
        facts["scorer"] = NO_SCORER
    elif scorer.name != DEFAULT:  # the default one is not recorded
        facts |= {"scorer": scorer.name, "scorer_title": scorer.title}
    return dict(keys.plain(facts))


def data_facts(gallery: Gallery) -> dict[str, Any]:
    """Return the entries of a record that describe the shapes of a gallery."""
    dataset, subjects = gallery.dataset, tuple(entry.subject for entry in gallery.entries)
    return {
        "name": dataset.name,
        "title": dataset.title,
        "stand_in_for": dataset.stand_in_for,
        "source": gallery.source,
        "module": recipes.dataset_module(dataset),
        "quick": gallery.quick,
        "n_shapes": len(subjects),
        "n_classes": len(set(subjects)),
        "chance": chance_of_labels(subjects),
    }


def make_plan(
    galleries: Iterable[Gallery],
    inputs: Iterable[Input],
    methods: Iterable[MethodSpec],
    store: Store,
    *,
    seed: int = 0,
    retry: Collection[str] = (),
    scorer: ScorerSpec | None = None,
) -> list[Job]:
    """List the jobs of a selection with their states.

    Parameters
    ----------
    galleries, inputs, methods
        The selection.
    store
        Store with the records of finished jobs.
    seed
        Base seed.
    retry
        Kinds of failure to run again: ``failed``, ``timeout``, ``crashed``, ``killed``, ``memory``, or ``all``.
    scorer
        Scorer that compares the forms; None for the default.
    """
    planning = _Planning(store, seed, frozenset(retry), scorer or ScorerSpec())
    specs, chosen_inputs = list(methods), list(inputs)
    jobs: list[Job] = []
    known: dict[tuple[str, str], str] = {}
    for gallery in galleries:
        rows = gallery.rows(specs, store.models)
        for input_ in chosen_inputs:
            if rows and input_ in gallery.inputs:
                data = data_recipe(gallery, input_, known)
                jobs += [planning.job(gallery, input_, spec, data) for spec in rows]
    return jobs


@dataclass
class _Planning:
    """Records to compare with the jobs of a plan."""

    store: Store
    seed: int
    retry: frozenset[str]
    scorer: ScorerSpec

    @cached_property
    def _here(self) -> Mapping[str, Record]:
        return {record["key"]: record for record in self.store.records}

    @cached_property
    def _before(self) -> Mapping[Place, list[Record]]:
        return by_place(record for key, record in self._here.items() if not keys.is_edited(key))

    @cached_property
    def _published(self) -> Mapping[str, Record]:
        return {record["key"]: record for record in self.store.published}

    @cached_property
    def _published_before(self) -> Mapping[Place, list[Record]]:
        return by_place(self._published.values())

    def job(self, gallery: Gallery, input_: Input, spec: MethodSpec, data: Mapping[str, Any]) -> Job:
        """Return the job of a row with its state."""
        missing = spec.missing_packages()
        # A descriptor compares its own descriptors: one job serves all scorers.
        scorer = ScorerSpec() if not missing and spec.describes else self.scorer
        source = gallery.source
        if is_path(source) and not is_known(source):  # workers may have another working directory
            source = str(Path(source).absolute())
        job = Job(
            key="", facts=_facts(gallery, input_, spec, scorer), table=gallery.table.identifier, dataset=source,
            data_root=gallery.data_root and gallery.data_root.absolute(),
            identifiers=tuple(entry.identifier for entry in gallery.entries), input=input_, method=spec,
            seed=self.seed, results=self.store.root.parent.absolute(), recipe={},
            all_unseen=gallery.table.all_unseen, scorer=scorer,
            large_files=_large_files(gallery),
        )  # fmt: skip
        if missing:
            reason = f"needs {', '.join(missing)}: pip install {' '.join(missing)}"
            return replace(job, state="unavailable", reason=reason)
        if input_ not in spec.info.inputs:
            return replace(job, state="unsupported", reason=f"does not take the {input_} input")
        try:
            models = find_models(spec, gallery, self.store.models.absolute())
        except MissingModel as error:
            return replace(job, state="unavailable", reason=str(error))
        except (NoFolds, TooNear) as error:
            return replace(job, state="unsupported", reason=str(error))
        recipe = _job_recipe(gallery, job, data, models)
        job = replace(
            job, key=key_of(recipe), recipe=recipe, models={model.training: model for model in models.values()},
            trainings={identifier: model.training for identifier, model in models.items()},
        )  # fmt: skip
        place = Place(gallery.name, input_, spec.name, job.seed, scorer.name)
        state, reason = self._state(job, place, is_quick=gallery.quick)
        older = self._before.get(place) if state == "stale" else None
        return replace(job, state=state, reason=reason, ranks_again=bool(older and self._has_distances(older[-1], job)))

    def _state(self, job: Job, place: Place, *, is_quick: bool) -> tuple[State, str]:
        """Return the state of a job and the reason for it."""
        record, folders = self._here.get(job.key), edited(job.recipe["versions"])
        edit = words_of_edit(folders) if folders else ""
        if record is not None and (changed := changed_files(record.get("files", {}))):
            return "stale", f"{', '.join(changed[:3])} changed"
        if record is not None and record["status"] not in (CHANGED, UNSAVED):
            return self._state_of(record, edit)
        if edit:
            return "stale", edit
        if job.key in self._published:
            return "published", "finished elsewhere; a run repeats it here"
        if older := self._before.get(place):
            return "stale", difference(older[-1]["recipe"], job.recipe)
        if not is_quick and (elsewhere := self._published_before.get(place)):
            changes = difference(elsewhere[-1]["recipe"], job.recipe)
            return "missing", f"never run here; finished elsewhere: {changes}"
        return "missing", "never run"

    def _state_of(self, record: Record, edit: str) -> tuple[State, str]:
        """Return the state of a job that has a record, and the reason for it."""
        status = record["status"]
        if status == "ok":
            return "cached", "; ".join(filter(None, ("finished", edit)))
        if self.retry & {status, "all"}:
            return "stale", f"{status} before, asked to retry"
        return "failed", "; ".join(filter(None, (f"{status}: {record.get('reason', '')}", edit)))

    def _has_distances(self, older: Record, job: Job) -> bool:
        """Return whether a record differs from a job only in its measures, and its artefacts still exist."""
        if older["status"] != "ok" or not older.get("artefacts"):
            return False
        before, now = (
            {**recipe, "versions": {**recipe.get("versions", {}), "measures": ""}}
            for recipe in (older["recipe"], job.recipe)
        )
        return before == now and all(map(self.store.has, older["artefacts"]))


def _job_recipe(gallery: Gallery, job: Job, data: Mapping[str, Any], models: Mapping[str, Model]) -> dict[str, Any]:
    """Return everything that determines the scores of a job; see also :func:`data_recipe`."""
    recipe = {
        **data,
        "method": job.method.base_name,
        "parameters": job.method.key_parameters(),
        "seed": job.seed,
        "scorer": recipes.scorer_recipe(job.scorer),
        "versions": recipes.job_versions(gallery.dataset, job.input, job.method, job.scorer),
        **recipes.job_plugins(gallery.dataset, job.method, job.scorer),
    }
    if models:
        recipe["models"] = {model.training: model.digest for model in models.values()}
    return dict(keys.plain(recipe))


def data_recipe(gallery: Gallery, input_: Input, known: dict[tuple[str, str], str] | None = None) -> dict[str, Any]:
    """Return the input and a digest of the shapes and labels, and for the view input a digest of the cameras.

    Parameters
    ----------
    gallery, input_
        Source of the shapes.
    known
        Cache of the data of shapes by source and identifier; new data are added. None for no cache.
    """
    dataset, texts = gallery.dataset, {} if known is None else known

    def data(entry: Entry) -> str:
        name = (gallery.source, entry.identifier)
        if name not in texts:
            texts[name] = str(recipes.source_data(dataset, entry))
        return texts[name]

    recipe: dict[str, Any] = {
        "input": input_,
        "gallery": recipes.gallery_digest(gallery.entries, data),
    }
    if input_ == "view":
        frame = dataset.half_width or [(e.identifier, data(e), repr(dataset.camera(e))) for e in dataset.shapes]
        cameras = [repr(dataset.camera(entry)) for entry in gallery.entries]
        sensors = [repr(sensor) for entry in gallery.entries if (sensor := recipes.sensor_of(dataset, entry))]
        recipe["view"] = keys.digest([frame, cameras, *([sensors] if sensors else [])])
    return recipe


def difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Describe the difference between two recipes.

    Parameters
    ----------
    before
        Recipe of an older job.
    now
        Recipe, or parts of it, of the job that replaces it in the plan.
    """
    plain = keys.plain(now)
    changes: list[str] = []
    for part in PARTS:
        old, new = before.get(part), plain.get(part)
        if part not in plain or old == new:
            continue
        if part == "versions" and not old:
            changes.append("made by version 0.2 or older")
        elif isinstance(old, dict) and isinstance(new, dict):
            changes.append(changed_names(part, old, new))
        elif part in ("gallery", "view"):
            changes.append("the data changed" if part == "gallery" else "the camera's frame changed")
        else:
            changes.append(f"{part} changed from {old} to {new}")
    return "; ".join(changes) or "the recipe changed"


def changed_names(part: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Describe the first three differences in a part of a recipe."""
    changed = sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name))
    if part == "versions":  # digests mean nothing to a reader
        return f"versions changed: {', '.join(changed)}"
    return f"{part} changed: {', '.join(f'{name} {before.get(name)} -> {now.get(name)}' for name in changed[:3])}"


def unavailable_record(job: Job) -> Record:
    """Return the record of a job that cannot run here because a package or a model is missing."""
    recipe = {"unavailable": job.reason, "gallery": job.gallery, "input": job.input, "method": job.method.name}
    if job.scorer.name != DEFAULT:
        recipe["scorer"] = job.scorer.name
    return {**job.facts, "key": keys.digest(recipe), "recipe": recipe, "status": job.state, "reason": job.reason}
