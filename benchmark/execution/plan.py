"""Plan of a run, with reasons: protocols x methods -> jobs. Nothing is computed here, records are only read."""

from __future__ import annotations

import itertools
import re
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Input
from benchmark.datasets.base import Entry
from benchmark.datasets.catalogue import is_known, is_path
from benchmark.errors import ConfigurationError
from benchmark.execution.job_specs import LARGE_FILE, Job, State
from benchmark.execution.processes.opened_files import changed_files
from benchmark.pipeline import recipes
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.lock import edited, key_of, words_of_edit
from benchmark.pipeline.storage.records import NO_SCORER, Place, Record, by_place, models_proven_by
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.scorers import DEFAULT, ScorerSpec
from benchmark.protocols.galleries import Gallery
from benchmark.protocols.models import MissingModel, Model, TooNear, find_models
from benchmark.protocols.trainings import NoFolds
from retrieval.chance import chance_levels

#: Recipe parts in the order in which a change is worth telling.
PARTS = ("gallery", "parameters", "models", "seed", "scorer", "view", "versions", "plugin")

#: Status of a job that was stopped because somebody edited the code; it is run again without being asked.
CHANGED = "changed"

#: Status of a job whose results could not be written; it is run again without being asked.
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
    """Return what a record tells of gallery and method, so that tables need neither the data nor the plugin."""
    facts = {
        "gallery": gallery.name,
        "input": input_,
        "method": spec.name,
        "title": spec.title,
        "family": spec.info.family,
        "parameters": dict(spec.parameters),
        "data": data_facts(gallery),
        # Only what is built in, or installed, means something to others.
        "target": "" if any(m.endswith(".py") for m in (spec.module, scorer.module)) else spec.target,
    }
    if spec.describes:
        facts["scorer"] = NO_SCORER
    elif scorer.name != DEFAULT:  # the default one goes without saying
        facts |= {"scorer": scorer.name, "scorer_title": scorer.title}
    return dict(keys.plain(facts))


def data_facts(gallery: Gallery) -> dict[str, Any]:
    """Return what a record tells of the shapes of a gallery."""
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
        "chance": _chance(subjects),
    }


@cache
def _chance(subjects: tuple[str, ...]) -> dict[str, float]:
    return chance_levels(subjects)


@dataclass(frozen=True)
class JobSettings:
    """Settings that all jobs of a plan share.

    Parameters
    ----------
    seed
        Base seed.
    retry
        Kinds of failure to run again: ``failed``, ``timeout``, ``crashed``, ``killed``, ``memory``, or ``all``.
    scorer
        What compares the forms.
    """

    seed: int = 0
    retry: frozenset[str] = frozenset()
    scorer: ScorerSpec = field(default_factory=ScorerSpec)


def make_plan(
    galleries: Iterable[Gallery],
    inputs: Iterable[Input],
    methods: Iterable[MethodSpec],
    store: Store,
    settings: JobSettings | None = None,
) -> list[Job]:
    """List the jobs of a selection with their states.

    Parameters
    ----------
    galleries, inputs, methods
        The selection.
    store
        Where finished jobs are looked up.
    settings
        Of all jobs; None for the usual ones.
    """
    planning = _Planning(store, settings or JobSettings())
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


class _Planning:
    """The records that all jobs of a plan are compared with."""

    def __init__(self, store: Store, settings: JobSettings) -> None:
        self.store, self.settings = store, settings
        here = list(store.records)
        self._here = {record["key"]: record for record in here}
        self._before = by_place(record for record in here if "-" not in record["key"])

    @cached_property
    def _published(self) -> Mapping[str, Record]:
        return {record["key"]: record for record in self.store.published}

    @cached_property
    def _published_before(self) -> Mapping[Place, list[Record]]:
        return by_place(self._published.values())

    def job(self, gallery: Gallery, input_: Input, spec: MethodSpec, data: Mapping[str, Any]) -> Job:
        """Return the job of a row, and whether a run would make it."""
        missing = spec.missing_packages()
        # A descriptor compares its descriptors itself: one job, whatever compares the forms.
        scorer = ScorerSpec() if not missing and spec.describes else self.settings.scorer
        source = gallery.source
        if is_path(source) and not is_known(source):  # to be understood from any working directory
            source = str(Path(source).absolute())
        job = Job(
            key="", facts=_facts(gallery, input_, spec, scorer), table=gallery.table.identifier, dataset=source,
            data_root=gallery.data_root and gallery.data_root.absolute(),
            identifiers=tuple(entry.identifier for entry in gallery.entries), input=input_, method=spec,
            seed=self.settings.seed, results=self.store.root.parent.absolute(), recipe={},
            all_unseen=gallery.table.all_unseen, split_size=gallery.table.split_size, scorer=scorer,
            large_files=_large_files(gallery),
        )  # fmt: skip
        if missing:
            reason = f"needs {', '.join(missing)}: pip install {' '.join(missing)}"
            return replace(job, state="unavailable", reason=reason)
        if input_ not in spec.info.inputs:
            return replace(job, state="unsupported", reason=f"does not take the {input_} input")
        try:
            proven = self._proven(spec.name) if spec.learns else ()
            models = find_models(spec, gallery, self.store.models.absolute(), proven)
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

    def _proven(self, method: str) -> set[str]:
        """Digests of the models by which a method has made results, here or else elsewhere."""
        for places in (self._before, self._published_before):
            of_method = (records for place, records in places.items() if place.method == method)
            if proven := {digest for records in of_method for record in records for digest in models_proven_by(record)}:
                return proven
        return set()

    def _state(self, job: Job, place: Place, *, is_quick: bool) -> tuple[State, str]:
        """Return whether a run would make a job, and why."""
        record, edit = (
            self._here.get(job.key),
            words_of_edit(folders) if (folders := edited(job.recipe["versions"])) else "",
        )
        if record is not None and (changed := changed_files(record.get("files", {}))):
            return "stale", f"{', '.join(changed[:3])} changed"
        if record is not None and record["status"] not in (CHANGED, UNSAVED):
            return self._state_of(record, edit)
        if edit:
            return "stale", edit
        if job.key in self._published:
            return "published", "finished elsewhere; a run makes it anew here"
        if older := self._before.get(place):
            return "stale", difference(older[-1]["recipe"], job.recipe)
        if not is_quick and (elsewhere := self._published_before.get(place)):
            changes = difference(elsewhere[-1]["recipe"], job.recipe)
            return "missing", f"never run here; finished elsewhere: {changes}"
        return "missing", "never run"

    def _state_of(self, record: Record, edit: str) -> tuple[State, str]:
        """The same of a job that has a record."""
        status = record["status"]
        if status == "ok":
            return "cached", "; ".join(filter(None, ("finished", edit)))
        if self.settings.retry & {status, "all"}:
            return "stale", f"{status} before, asked to retry"
        return "failed", "; ".join(filter(None, (f"{status}: {record.get('reason', '')}", edit)))

    def _has_distances(self, older: Record, job: Job) -> bool:
        """Return whether a record differs from a job in its measures alone, and all that it was made from is kept."""
        if older["status"] != "ok" or not older.get("artefacts"):
            return False
        before, now = (
            {**recipe, "versions": {**recipe.get("versions", {}), "measures": ""}}
            for recipe in (older["recipe"], job.recipe)
        )
        return before == now and all(map(self.store.has, older["artefacts"]))


def _job_recipe(gallery: Gallery, job: Job, data: Mapping[str, Any], models: Mapping[str, Model]) -> dict[str, Any]:
    """Everything that determines the scores of a job, with :func:`data_recipe`."""
    recipe = {
        **data,
        "method": job.method.base_name,
        "parameters": job.method.key_parameters(),
        "seed": job.seed,
        "scorer": recipes.scorer_recipe(job.scorer),
        "versions": recipes.job_versions(gallery.dataset, job.input, job.method, job.scorer),
        **recipes.job_plugins(gallery.dataset, job.method, job.scorer),
    }
    if job.split_size:
        recipe["split_size"] = job.split_size
    if models:
        recipe["models"] = {model.training: model.digest for model in models.values()}
    return dict(keys.plain(recipe))


def data_recipe(gallery: Gallery, input_: Input, known: dict[tuple[str, str], str] | None = None) -> dict[str, Any]:
    """Input, digest of the shapes and their labels, and of the camera's frame for the view input.

    Parameters
    ----------
    gallery, input_
        The shapes.
    known
        What is known of the data of shapes, by source and identifier, to which this adds; None for nothing.
    """
    dataset, texts = gallery.dataset, {} if known is None else known

    def data(entry: Entry) -> str:
        name = (gallery.source, entry.identifier)
        if name not in texts:
            texts[name] = str(recipes.source_data(dataset, entry))
        return texts[name]

    recipe: dict[str, Any] = {
        "input": input_,
        "gallery": keys.digest([(entry.identifier, entry.subject, data(entry)) for entry in gallery.entries]),
    }
    if input_ == "view":
        frame = dataset.half_width or [(e.identifier, data(e), repr(dataset.camera(e))) for e in dataset.entries]
        cameras = [repr(dataset.camera(entry)) for entry in gallery.entries]
        sensors = [repr(sensor) for entry in gallery.entries if (sensor := recipes.sensor_of(dataset, entry))]
        recipe["view"] = keys.digest([frame, cameras, *([sensors] if sensors else [])])
    return recipe


def difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Name the parts of a recipe that changed.

    Parameters
    ----------
    before
        Recipe of a job.
    now
        That of another one with the same place in the plan, or those parts of it that are known.
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
    """Name the first of the entries in which a part of a recipe differs."""
    changed = sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name))
    if part == "versions":  # digests, which tell nobody anything
        return f"versions changed: {', '.join(changed)}"
    return f"{part} changed: {', '.join(f'{name} {before.get(name)} -> {now.get(name)}' for name in changed[:3])}"


def unavailable_record(job: Job) -> Record:
    """Return what tables know of a job that cannot be done here: a package or a model is missing."""
    recipe = {"unavailable": job.reason, "gallery": job.gallery, "input": job.input, "method": job.method.name}
    if job.scorer.name != DEFAULT:
        recipe["scorer"] = job.scorer.name
    return {**job.facts, "key": keys.digest(recipe), "recipe": recipe, "status": job.state, "reason": job.reason}


def require_jobs(jobs: list[Job]) -> list[Job]:
    """Return the jobs; raises ``ConfigurationError`` if there are none."""
    if not jobs:
        raise ConfigurationError("no selected method belongs to a selected table", "drop -m, -t or --input")
    return jobs


#: Phases that all methods of a shape share: one pays for them.
SHARED = ("prepare", "geodesics")

#: Files whose mean size stands for that of all.
_SAMPLE = 500

#: Stands behind the name of a method for whatever parameters it has.
_ANY = "[...]"


@dataclass(frozen=True)
class Estimate:
    """Cost of the jobs of a plan that are to run, if none of their stages were done already.

    Parameters
    ----------
    seconds
        Of work, on one core.
    unknown
        Jobs whose method never finished under their input, so that nobody can tell.
    mebibytes
        Of what stays on the disk; None where nothing is there to measure.
    """

    seconds: float
    unknown: int
    mebibytes: float | None

    def lines(self, n_jobs: int, workers: int) -> list[str]:
        """In words, for a plan with so many jobs to run."""
        if not n_jobs:
            return []
        lines = []
        if self.seconds or not self.unknown:
            shared = f", {_duration(self.seconds / workers)} with {workers} jobs at a time" if workers > 1 else ""
            lines.append(f"at most about {_duration(self.seconds)} of work{shared}, by the costs of finished jobs")
        if self.unknown:
            lines.append(f"{self.unknown} of them cannot be estimated: no job of their method has finished")
        room = "unknown before the first job here" if self.mebibytes is None else f"about {self.mebibytes:.0f} MiB"
        return [*lines, f"disk: {room}"]


def estimate(jobs: Sequence[Job], store: Store) -> Estimate:
    """Estimate the jobs of a plan that are to run.

    Seconds a shape are those of the same method and input on the same gallery, else the median over other galleries;
    what the methods of a shape share counts once.

    Parameters
    ----------
    jobs
        The plan.
    store
        Holds the records, and the files whose size tells that of others.
    """
    to_run = list({job.key: job for job in jobs if job.to_run}.values())
    if not to_run:
        return Estimate(0.0, 0, None)
    costs: dict[tuple[str, str], list[Record]] = {}
    for record in (*store.published, *store.records):
        if "cost" in record:
            for name in {record["method"], record["method"].partition("[")[0] + _ANY}:
                costs.setdefault((name, record["input"]), []).append(record)
    seconds, unknown, n_forms = 0.0, 0, 0
    shared: dict[tuple[str, str, str], dict[str, float]] = {}
    for job in to_run:
        phases = _phases(job, costs)
        n_forms += len(job.identifiers)
        unknown += not phases
        seconds += len(job.identifiers) * sum(value for phase, value in phases.items() if phase not in SHARED)
        for identifier in job.identifiers:
            place = shared.setdefault((job.facts["data"]["name"], job.input, identifier), {})
            for phase in SHARED:
                place[phase] = max(place.get(phase, 0.0), phases.get(phase, 0.0))
    seconds += sum(sum(phases.values()) for phases in shared.values())
    sizes = [path.stat().st_size for path in itertools.islice(store.artefact_files(), _SAMPLE)]
    room = (n_forms + len(shared)) * statistics.fmean(sizes) / 2**20 if sizes else None
    return Estimate(seconds, unknown, room)


def _phases(job: Job, costs: Mapping[tuple[str, str], list[Record]]) -> Mapping[str, float]:
    """Seconds a shape by phase: of the gallery itself, else the median over others; empty if there are none."""
    alike = costs.get((job.method.name, job.input)) or costs.get((job.method.base_name + _ANY, job.input), [])
    here = [record for record in alike if record["gallery"] == job.gallery]
    timed = [record["cost"]["seconds_per_shape"] for record in here[-1:] or alike]
    return {phase: statistics.median(row.get(phase, 0.0) for row in timed) for phase in set().union(*timed)}


def _duration(seconds: float) -> str:
    """A time in the unit that suits it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"


@dataclass(frozen=True)
class Shard:
    """One of several parts of a plan.

    The cut goes between jobs, never through one. A job leaves one record, whole and small, so shards need no common
    disk, no order in which they end, and nobody who ranks afterwards what others have treated; what joins records of
    several machines joins shards. The price is that shapes which jobs of several shards share are prepared in each.

    Parameters
    ----------
    number
        Which part, from 1.
    count
        How many parts there are.

    Raises
    ------
    ConfigurationError
        If there is no such part.
    """

    number: int
    count: int

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise ConfigurationError(f"there is no shard {self}", "write i/n with i from 1 to n, such as 2/3")

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Read ``"2/3"``.

        Raises
        ------
        ConfigurationError
            If it is anything else, or there is no such part.
        """
        numbers = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text.strip())
        if not numbers:
            raise ConfigurationError(f"'{text}' is no shard", "write i/n with i from 1 to n, such as 2/3")
        return cls(int(numbers[1]), int(numbers[2]))

    def of(self, jobs: Sequence[Job]) -> list[Job]:
        """The jobs of this part.

        What is done already plays no part in the cut, so that shards begun at different times, or begun again, still
        fit together. The largest galleries are dealt out first, each job to the shard that has the fewest shapes.

        Parameters
        ----------
        jobs
            The whole plan; a job that it names twice, for two tables, is in one shard.
        """
        distinct = {_identity(job): len(job.identifiers) for job in jobs}
        load, place = [0] * self.count, {}
        for identity, size in sorted(distinct.items(), key=lambda pair: -pair[1]):  # equal ones stay in plan order
            place[identity] = min(range(self.count), key=lambda number: load[number])
            load[place[identity]] += size
        return [job for job in jobs if place[_identity(job)] == self.number - 1]

    def told(self, jobs: Sequence[Job]) -> str:
        """A line on this part; shards fit together if they name the same plan.

        Parameters
        ----------
        jobs
            The whole plan.
        """
        own, of_all = ({_identity(job) for job in some} for some in (self.of(jobs), jobs))
        return f"shard {self} of plan {keys.digest(sorted(of_all))[:8]}: {len(own)} of {len(of_all)} jobs"


def _identity(job: Job) -> str:
    """Return what makes a job one: its key, or its name where it has none."""
    return job.key or job.name
