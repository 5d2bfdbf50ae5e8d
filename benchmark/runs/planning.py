"""Plan a run: the jobs of galleries and methods, which of them have a record, and what changed since for the others."""

from __future__ import annotations

import json
import statistics
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from itertools import chain
from pathlib import Path
from typing import Any, Literal, NamedTuple

from benchmark.api.contracts import Input
from benchmark.code_digest import code_of_modules, definitions_of, digest
from benchmark.datasets.catalogue import is_known, is_path
from benchmark.defaults import DEFAULT_SCORER
from benchmark.errors import ConfigurationError, DatasetError
from benchmark.pipeline.cache import Stage
from benchmark.pipeline.code_store import Definitions, changed_definitions, read_definitions
from benchmark.pipeline.data_names import path_of
from benchmark.pipeline.gallery_digest import digest_of_both, digest_of_shapes
from benchmark.pipeline.prepared import PreparedShapes
from benchmark.pipeline.ranking import STAGES
from benchmark.pipeline.records import (
    SUITE_RESULTS,
    RankedShapes,
    Record,
    RowId,
    key_at,
    newer_record_at,
    read_records,
    record_of,
)
from benchmark.protocols.galleries import Gallery, galleries
from benchmark.protocols.models import MissingModel, Model, TooNear
from benchmark.protocols.trainings import NoFolds
from benchmark.registry import Component, are_named, select, select_one
from benchmark.runs.tasks import STAGE_MODULES, Job, Step, code_of_step
from benchmark.runs.unchanged import PlannedCode
from benchmark.text import clean_text, listed

State = Literal[
    "finished", "failed", "missing", "stale", "incomplete", "unavailable", "unsupported"
]

#: Trained model of each view of a gallery; None for a method that does not learn.
Models = Sequence[Model | None]


@dataclass(frozen=True)
class Planned:
    """A job with its galleries, and what is known of it.

    Parameters
    ----------
    sides
        What it is at its queries, and at the shapes of the gallery if these are others.
    frames, codes
        Keys of the frames of the camera that are fitted to the sides, "" where none is; the code
        that makes files of a stage.
    galleries
        The shapes, once for each table that shows them.
    record
        Its record without the outcome.
    models, cards
        Folder of the trained model for each shape, and the digest of the card in each folder.
    state, reason
        ``finished``: it has a record. ``failed``: its record says that it failed. ``stale``: its
        record is of other code, data or parameters; the reason names them. ``incomplete``: shapes
        have no result for a reason that is not in their content. ``missing``: it has no record.
        ``unavailable``: a package or a trained model is missing, or its record has a newer layout.
        ``unsupported``: the method does not take the input.
    before
        The record that its own replaces.
    is_pending
        Whether ``run`` will execute this job.
    """

    sides: tuple[Job, ...]
    frames: tuple[str, ...]
    codes: Mapping[Stage, PlannedCode | None] = field(repr=False)
    galleries: tuple[Gallery, ...]
    record: Record = field(repr=False)
    models: tuple[Path | None, ...] = field(repr=False)
    cards: Mapping[Path, str] = field(repr=False)
    state: State
    reason: str
    before: Record | None = field(repr=False)
    is_pending: bool

    def steps(self) -> list[tuple[Step, ...]]:
        """Return the steps at each shape, in order, those at the gallery behind those at the queries."""
        models, chains = iter(self.models), list[tuple[Step, ...]]()
        for side, job, frame in zip(self.record.sides, self.sides, self.frames, strict=True):
            first = (Step(job, "prepared", frame),) if frame else ()
            for number, (shape, keys) in enumerate(zip(side.file_names, side.keys, strict=True)):
                source_shape, model = side.shapes[number // side.views], next(models)
                of_shape = partial(
                    Step,
                    job,
                    shape=shape,
                    keys=keys,
                    model=model,
                    card=self.cards[model] if model else "",
                    source_shape=source_shape,
                )
                steps = (of_shape(stage, keys[stage], code=self.codes.get(stage)) for stage in keys)
                chains.append((*first, *steps))
        return chains

    def ranking(self) -> Step:
        """Return the step that ranks the gallery."""
        return Step(self.sides[0], "records", self.record.key, code=self.codes["records"])


def plan_selection(
    results: Path,
    *,
    methods: Sequence[Any] = (),
    plugins: Sequence[Path] = (),
    scorer: str = DEFAULT_SCORER,
    input: Input | None = None,
    seed: int = 0,
    rerun: Collection[str] = (),
    records: Iterable[Record] | None = None,
    in_this_process: bool = False,
    **data: Any,
) -> list[Planned]:
    """List the jobs of what the command line, or a Python program, selects, with their states.

    Parameters
    ----------
    results
        The results folder.
    methods, plugins, scorer
        Names, or objects from Python; plugin files of methods and scorers.
    input
        ``"mesh"`` or ``"view"``; both by default.
    seed
        Base seed of all methods.
    rerun
        States of jobs that run again: ``"failed"``, ``"finished"``.
    records
        Records of the results folder; by default they are read.
    in_this_process
        Whether plugins run in this process, and nothing of them is known again.
    **data
        Tables and data sets, as for :func:`~benchmark.protocols.galleries.galleries`.

    Raises
    ------
    ConfigurationError
        If a name is unknown, or nothing is selected.
    """
    *selected, of_forms = [*select(methods, plugins), select_one(scorer, plugins, "scorer")]
    if in_this_process:
        *selected, of_forms = [component.in_this_process() for component in (*selected, of_forms)]
    known = read_records(results, published=False) if records is None else records
    planning = _Planning(results.absolute(), of_forms, seed, rerun, known)
    is_named = are_named(methods)
    jobs: dict[str, Planned] = {}
    for gallery in galleries(input=input, **data):
        for input_ in gallery.inputs:
            rows = gallery.rows(input_, selected, results / "models", named=is_named)
            for job in planning.jobs(gallery, input_, rows) if rows else ():
                _check_pair(job.record)
                first = jobs.setdefault(job.record.key, job)
                if first is not job:
                    jobs[job.record.key] = replace(first, galleries=(*first.galleries, gallery))
    if not jobs:
        raise ConfigurationError(
            "no selected method belongs to a selected table", "drop -m, -t or --input"
        )
    return list(jobs.values())


def _check_pair(record: Record) -> None:
    """Raise ``DatasetError`` unless another gallery has two classes, and a query another shape of its own in it."""
    gallery = record.gallery_of_queries
    if gallery and (len({*gallery.labels}) < 2 or not any(record.are_queries)):
        shown, there = (
            ", ".join(sorted({*labels})[:3]) for labels in (record.labels, gallery.labels)
        )
        problem = f"nothing can be retrieved: queries are of {shown}, and shapes of {gallery.gallery} of {there}"
        raise DatasetError(
            problem, "name the classes of both alike, and give the gallery two or more"
        )


class _Side(NamedTuple):
    """Queries, or the gallery that they are ranked in, with the keys of prepared shapes."""

    gallery: Gallery
    source: str
    shapes: PreparedShapes
    prepared: list[str]


def _side_of(gallery: Gallery, input_: Input) -> _Side:
    seen = gallery.seen
    shapes = PreparedShapes(seen.dataset, input_)
    return _Side(
        gallery, _absolute(seen.source), shapes, [shapes.key(entry) for entry in seen.entries]
    )


@dataclass
class _Planning:
    """What all jobs of a plan share."""

    results: Path
    scorer: Component
    seed: int
    rerun: Collection[str]
    records: Iterable[Record]

    def __post_init__(self) -> None:
        self._key, self._code = cache(Component.key), cache(Component.code)
        self._forms, self._ranking = (
            code_of_modules([STAGE_MODULES[stage]]) for stage in ("forms", "records")
        )
        self._code_of_step = cache(code_of_step)
        self._records = {record.row: record for record in self.records if not record.published}

    def jobs(
        self, gallery: Gallery, input_: Input, methods: Iterable[Component]
    ) -> Iterator[Planned]:
        """Yield the job of each method with its state."""
        facts, sides = gallery_facts(gallery, input_), [_side_of(gallery, input_)]
        if other := gallery.gallery_of_queries:
            sides.append(_side_of(other, other.inputs[0]))
        for method in methods:
            yield self._job(facts, sides, method)

    def _job(self, facts: dict[str, Any], sides: Sequence[_Side], method: Component) -> Planned:
        gallery, paths = sides[0].gallery, tuple(path_of(side.gallery.source) for side in sides)
        scorer = None if method.missing_packages() or method.describes else self.scorer
        row = RowId(
            gallery.name,
            facts["input"],
            method.name,
            self.seed,
            scorer.name if scorer else "",
            paths,
        )
        before = self._records.get(row)
        state, reason, models, seen = self._models(sides, method)
        content = facts | self._facts(method, scorer)
        content |= {"key": digest(["unavailable", row]), "seen": seen}
        content["models"] = [
            model.summary() for model in dict.fromkeys(filter(None, chain(*models)))
        ]
        codes: dict[Stage, PlannedCode | None] = {}
        if state is None:
            codes = self._codes(method, scorer)
            files = [
                self._files(side.prepared, of, method, scorer)
                for side, of in zip(sides, models, strict=True)
            ]
            keys = [keys for of_side in files for keys in zip(*of_side.values(), strict=True)]
            titles = [method.title, scorer.title if scorer else ""]
            result_key = digest(
                [row._replace(paths=()), titles, facts["gallery_digest"], keys, self._ranking]
            )
            parts = self._parts(sides, models, method, scorer) | {
                "the data": facts["gallery_digest"]
            }
            content |= {
                "key": key_at(result_key, paths),
                "result_key": result_key,
                "parts": parts,
                "files": files[0],
            }
            if sides[1:]:
                content["against"] = facts["against"] | {"files": files[1]}
            state, reason = self._state(before, content["key"], parts)
            if state in ("missing", "stale") and (
                problem := newer_record_at(self.results, content["key"])
            ):
                state, reason = "unavailable", f"{problem}; update the suite"
        data_root = gallery.data_root and gallery.data_root.absolute()
        job = Job(
            content["key"], row, sides[0].source, data_root, method, self.scorer, self.results
        )
        return Planned(
            tuple(
                replace(job, source=side.source, row=row._replace(input=side.shapes.input))
                for side in sides
            ),
            tuple(side.shapes.frame_key for side in sides),
            codes,
            (gallery,),
            record_of(content),
            tuple(model.folder if model else None for model in chain(*models)),
            {model.folder: model.card_digest for model in chain(*models) if model},
            state,
            reason,
            before,
            is_pending=state in ("missing", "stale", "incomplete", *self.rerun),
        )

    def _state(
        self, record: Record | None, key: str, parts: Mapping[str, str]
    ) -> tuple[State, str]:
        """Return the state of a job that can run and the reason for it, from the record of its row."""
        if record is None:
            return "missing", "never run"
        if record.key != key and record.parts.get("its code"):
            reason = "it ran in the process of a program, or with -j 0, of which nothing is reused"
            return "stale", reason
        if record.key != key:
            known = {**self._definitions, **definitions_of(parts.items())}
            return "stale", describe_change(record.parts, parts, known)
        if record.status == "incomplete":
            return "incomplete", record.reason
        if record.status == "ok":
            return "finished", record.refusals
        return "failed", f"{record.status}: {record.reason}"

    @cached_property
    def _definitions(self) -> Definitions:
        """Definitions in the code of earlier runs."""
        return read_definitions(self.results)

    def _models(
        self, sides: Sequence[_Side], method: Component
    ) -> tuple[State | None, str, list[Models], list[str]]:
        """Return why a job cannot run, the model of each view of each side, and the queries seen in training."""
        obstacles = [_obstacle(side, method, self.results / "models") for side in sides]
        state, reason = next(
            ((state, reason) for state, reason, _ in obstacles if state), (None, "")
        )
        gallery, models = sides[0].gallery, [of_side for *_, of_side in obstacles]
        seen = _seen(gallery, models[0])
        if seen and gallery.table.all_unseen:
            state, reason = (
                "unsupported",
                f"{len(seen)} shapes were seen in training, such as {seen[0]}",
            )
            reason += "; take a model of another training"
        return state, reason, models, seen

    def _facts(self, method: Component, scorer: Component | None) -> dict[str, Any]:
        """Return the fields of a record that describe a method and a scorer."""
        return {
            "status": "unavailable",
            "method": method.name,
            "title": method.title,
            "summary": "" if method.of_suite else method.summary,
            "family": method.info.family,
            "cite": method.info.cite,
            "parameters": _as_json(method.parameters),
            "defaults": _as_json(method.defaults),
            "seed": self.seed,
            "scorer": scorer.name if scorer else "",
            "scorer_title": scorer.title if scorer else "",
        }

    def _codes(
        self, method: Component, scorer: Component | None
    ) -> dict[Stage, PlannedCode | None]:
        of_stages: dict[Stage, Component] = {"forms": method, "records": scorer or method}
        of_stages |= {"signatures": scorer} if scorer else {}
        return {
            stage: self._code_of_step(component, stage) for stage, component in of_stages.items()
        }

    def _files(
        self, prepared: list[str], models: Models, method: Component, scorer: Component | None
    ) -> dict[str, list[str]]:
        """Return the keys of the cached files of each shape; those of signatures are "" for a descriptor."""
        forms = [
            digest([key, self._key(method), self._forms, self.seed, model.digest if model else ""])
            for key, model in zip(prepared, models, strict=True)
        ]
        signatures = [digest([key, self._key(scorer)]) if scorer else "" for key in forms]
        return {"prepared": prepared, "forms": forms, "signatures": signatures}

    def _parts(
        self,
        sides: Sequence[_Side],
        models: Sequence[Models],
        method: Component,
        scorer: Component | None,
    ) -> dict[str, str]:
        """Return what determines the scores, by names that a user understands."""
        parts = self._code(method) | self._forms | self._ranking
        parts |= self._code(scorer) if scorer else {}
        for side in reversed(sides):  # the camera is that of the queries
            parts = side.shapes.code | parts | {"the camera": side.shapes.camera_key}
        for name, component in (("its", method), ("the scorer's", self.scorer)):
            parts[f"{name} title"] = component.info.title
            parts[f"{name} parameters"] = json.dumps(
                dict(component.parameters), sort_keys=True, default=str
            )
        return parts | {
            f"the model {model.training}": model.digest for model in chain(*models) if model
        }


def _as_json(values: Mapping[str, Any]) -> dict[str, Any]:
    return dict(json.loads(json.dumps(dict(values), default=str)))


def _absolute(source: str) -> str:
    """Return a source for workers, which may have another working directory."""
    return str(Path(source).absolute()) if is_path(source) and not is_known(source) else source


def gallery_facts(gallery: Gallery, input_: Input) -> dict[str, Any]:
    """Return the fields of a record that describe the shapes of a gallery, or of queries and their gallery."""
    if gallery.gallery_of_queries:
        queries = gallery_facts(replace(gallery, gallery_of_queries=None), input_)
        against = gallery_facts(gallery.gallery_of_queries, gallery.gallery_of_queries.inputs[0])
        keeps = gallery.table.keeps_same_names
        both = digest_of_both(
            queries["gallery_digest"],
            against["gallery_digest"],
            against["input"],
            keeps_same_names=keeps,
            cameras=gallery.gallery_of_queries.cameras,
        )
        against |= {"views": gallery.gallery_of_queries.n_views}
        return queries | {"against": against, "keeps_same_names": keeps, "gallery_digest": both}
    shapes = gallery.dataset
    ranked = [
        (entry.identifier, entry.subject, str(shapes.key(entry))) for entry in gallery.entries
    ]
    settings: list[object] = []
    if path := path_of(gallery.source):
        cameras = [(repr(shapes.camera(of)), repr(shapes.sensor(of))) for of in gallery.entries]
        settings = [shapes.half_width, *cameras]
    return {
        "gallery": gallery.name,
        "gallery_digest": digest_of_shapes(ranked, settings),
        "input": input_,
        "data": {
            "name": shapes.name,
            "title": shapes.title,
            "source": clean_text(gallery.source),
            "stand_in_for": shapes.stand_in_for,
            "quick": gallery.quick,
            "path": path,
            "n_shapes": len(shapes.shapes),
        },
        "shapes": [entry.identifier for entry in gallery.entries],
        "labels": [entry.subject for entry in gallery.entries],
    }


def _obstacle(
    side: _Side, method: Component, trained_here: Path
) -> tuple[State | None, str, Models]:
    """Return why a job cannot run, as a state with the reason, or None with the model of each view."""
    gallery, input_, none = side.gallery, side.shapes.input, [None] * len(side.prepared)
    if missing := method.missing_packages():
        return "unavailable", f"needs {', '.join(missing)}: pip install {' '.join(missing)}", none
    if input_ not in method.info.inputs:
        hint = (
            "; pass --gallery-views 12 to see meshes as views" if gallery.gallery_of_queries else ""
        )
        return "unsupported", f"does not take the {input_} input{hint}", none
    try:
        model_of = gallery.models(method, trained_here)
    except MissingModel as error:
        return "unavailable", str(error), none
    except (NoFolds, TooNear) as error:
        return "unsupported", str(error), none
    return (
        None,
        "",
        [
            model_of.get(entry.identifier)
            for entry in gallery.entries
            for _ in range(gallery.n_views)
        ],
    )


def _seen(gallery: Gallery, models: Models) -> list[str]:
    """Return the names of the shapes that the model for them was trained on."""
    pairs = zip(gallery.entries, models, strict=True)
    return [
        entry.identifier
        for entry, model in pairs
        if model and model.has_seen(entry, gallery.dataset.name)
    ]


def describe_change(
    before: Mapping[str, str], now: Mapping[str, str], known: Definitions | None = None
) -> str:
    """Say which parts of a key changed: ``gps.py (GPS.canonicalise), numpy changed``.

    Functions, classes and constants of the suite are named where they are ``known``.
    """
    changed = []
    for name in sorted(before.keys() | now.keys()):
        parts = before.get(name, ""), now.get(name, "")
        if parts[0] != parts[1]:
            functions = listed(changed_definitions(*parts, known or {}))
            file = Path(name).name
            changed.append(f"{file} ({functions})" if functions else file)
    return f"{listed(dict.fromkeys(changed)) or 'the code'} changed"


# Time
# ------------------------------------------------------------------------------------------------


class Estimate(NamedTuple):
    """Upper bound for seconds on one core, and jobs without one, as no job of their method has finished."""

    seconds: float
    unknown: int


def estimate(
    planned: Sequence[Planned], records: Iterable[Record], published: Path = SUITE_RESULTS
) -> Estimate:
    """Estimate the work of a plan as if nothing were in the cache; a form that several galleries rank counts once.

    Seconds a shape are those of the same method and input on the same gallery or data set,
    otherwise the median over all galleries, of the method with any parameters if need be. Jobs
    here, in ``records``, count before published ones.
    """
    pending = [job.record for job in planned if job.is_pending]
    here = [record for record in records if not record.published]
    every = [*read_records(published, local=False), *here] if pending else []
    finished = [record for record in every if record.seconds and not record.gallery_of_queries]
    unknown, spent = (
        set[str](),
        dict[str, float](),
    )  # seconds of each file of the cache, which several jobs may take
    for job, side in [(one, of) for one in pending for of in one.sides]:
        seconds = _seconds_a_shape(job.method, side, finished)
        unknown |= set() if seconds else {job.key}
        for stage, keys in side.files.items():
            of_file = seconds.get(STAGES[stage], 0.0) + (
                seconds.get("geodesics", 0.0) if stage == "prepared" else 0.0
            )
            spent |= {key: max(spent.get(key, 0.0), of_file) for key in filter(None, keys)}
        spent[f"{job.key} {side.gallery}"] = seconds.get(STAGES["records"], 0.0) * len(
            side.file_names
        )
    return Estimate(sum(spent.values()), len(unknown))


def _seconds_a_shape(
    method: str, side: RankedShapes, finished: Sequence[Record]
) -> dict[str, float]:
    """Return seconds by stage; empty if they are unknown."""
    timed = [record for record in finished if record.input == side.input]
    alike = [record for record in timed if record.method == method]
    alike = alike or [
        record for record in timed if record.method.partition("[")[0] == method.partition("[")[0]
    ]
    of_gallery = [record for record in alike if record.gallery == side.gallery]
    of_data = of_gallery or [record for record in alike if record.data.name == side.data.name]
    seconds = [record.seconds for record in of_data[-1:] or alike]
    stages = set[str]().union(*seconds)
    return {
        stage: statistics.median(of_job.get(stage, 0.0) for of_job in seconds) for stage in stages
    }
