"""Plan a run: the jobs of galleries and methods, which of them have a record, and what changed."""

from __future__ import annotations

import json
import statistics
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import chain
from pathlib import Path
from typing import Any, Literal, NamedTuple

from benchmark.api.contracts import Input
from benchmark.code_digest import code_of_modules, definitions_of, digest
from benchmark.datasets.catalogue import is_known, is_path
from benchmark.defaults import DEFAULT_SCORER
from benchmark.errors import ConfigurationError, DatasetError, with_hint
from benchmark.pipeline.cache import Stage
from benchmark.pipeline.code_store import Definitions, changed_definitions, read_definitions
from benchmark.pipeline.data_names import path_of
from benchmark.pipeline.gallery_digest import digest_of_both, digest_of_shapes
from benchmark.pipeline.prepared import PreparedShapes
from benchmark.pipeline.ranking import STAGES
from benchmark.pipeline.record_files import SUITE_RESULTS, newer_record_at, read_records
from benchmark.pipeline.records import RankedShapes, Record, RowId, ShapeView, key_at, record_of
from benchmark.protocols.galleries import Gallery, galleries
from benchmark.protocols.models import MissingModel, Model, TooNear
from benchmark.protocols.trainings import NoFolds
from benchmark.registry import Component, are_named, select, select_one
from benchmark.runs.tasks import STAGE_MODULES, Job, ShapeSource, Step, code_of_step
from benchmark.runs.unchanged import PlannedCode
from benchmark.text import clean_text, listed

State = Literal[
    "finished", "failed", "missing", "stale", "incomplete", "unavailable", "unsupported"
]

#: States of the jobs that a run does without being asked to.
_PENDING: frozenset[State] = frozenset({"missing", "stale", "incomplete"})

#: Most classes that a message names.
_MOST_CLASSES_NAMED = 3

#: Trained model of each view of a gallery; None for a method that does not learn.
Models = Sequence[Model | None]


@dataclass(frozen=True)
class PlannedSide:
    """Shapes on one side of a ranking: the queries, or the gallery that they are ranked in.

    Parameters
    ----------
    gallery
        The shapes.
    source
        Where workers get them.
    frame_key
        Key of the camera's frame that is fitted to all shapes; "" if none is.
    models
        Trained model of each view of a shape.
    """

    gallery: Gallery
    source: ShapeSource
    frame_key: str
    models: tuple[Model | None, ...]


@dataclass(frozen=True)
class Planned:
    """A job with its galleries, and what is known of it.

    Parameters
    ----------
    job
        Method, scorer and place of its record, as workers get them.
    sides
        Its queries, and the shapes of the gallery if these are others.
    codes
        The code that makes files of a stage.
    galleries
        The shapes, once for each table that shows them.
    record
        Its record without the outcome.
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

    job: Job
    sides: tuple[PlannedSide, ...]
    codes: Mapping[Stage, PlannedCode | None] = field(repr=False)
    galleries: tuple[Gallery, ...]
    record: Record = field(repr=False)
    state: State
    reason: str
    before: Record | None = field(repr=False)
    is_pending: bool

    @property
    def models(self) -> tuple[Path | None, ...]:
        """Folder of the trained model of each query; None for a method that does not learn."""
        return tuple(map(_folder_of, self.sides[0].models))

    def steps(self) -> list[tuple[Step, ...]]:
        """Return the steps at each view of a shape, first those of the queries."""
        steps: list[tuple[Step, ...]] = []
        for side, shapes in zip(self.sides, self.record.sides, strict=True):
            views = zip(shapes.views_of_shapes, side.models, strict=True)
            steps += [self._steps_of_view(side, view, model) for view, model in views]
        return steps

    def _steps_of_view(
        self, side: PlannedSide, view: ShapeView, model: Model | None
    ) -> tuple[Step, ...]:
        """Return the steps that make the files of one view: prepared shape, form, signature.

        Parameters
        ----------
        side
            Queries or gallery, to which the view belongs.
        view
            The view, with the keys of its files.
        model
            Trained model of the method for this shape, if it learns.
        """
        steps = []
        if side.frame_key:  # first, the camera's frame is fitted to all views
            steps.append(Step(self.job, side.source, "prepared", side.frame_key))
        card = model.card_digest if model else ""
        for stage, key in view.keys.items():
            step = Step(
                self.job,
                side.source,
                stage,
                key,
                view=view.name,
                shape=view.shape,
                keys=view.keys,
                model=_folder_of(model),
                card=card,
                code=self.codes.get(stage),
            )
            steps.append(step)
        return tuple(steps)

    def ranking(self) -> Step:
        """Return the step that ranks the gallery."""
        source = self.sides[0].source
        return Step(self.job, source, "records", self.record.key, code=self.codes["records"])


def _folder_of(model: Model | None) -> Path | None:
    """Return the folder of a model; None for a method that does not learn."""
    return model.folder if model else None


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
    """List the selected jobs, each a method on a data set, with their states.

    Parameters
    ----------
    results
        The results folder.
    methods
        Names of methods, or objects from Python; all methods by default.
    plugins
        Plugin files that may define methods and scorers.
    scorer
        Name of the scorer, or an object from Python.
    input
        ``"mesh"`` or ``"view"``; both by default.
    seed
        Base seed of all methods.
    rerun
        States of jobs that run again: ``"failed"``, ``"finished"``.
    records
        Records of the results folder; by default they are read.
    in_this_process
        Whether plugins run in this process; their results are then not used again.
    **data
        Tables and data sets, as for :func:`~benchmark.protocols.galleries.galleries`.

    Raises
    ------
    ConfigurationError
        If a name is unknown, or nothing is selected.
    """
    selected_methods = select(methods, plugins)
    selected_scorer = select_one(scorer, plugins, "scorer")
    if in_this_process:
        selected_methods = [method.in_this_process() for method in selected_methods]
        selected_scorer = selected_scorer.in_this_process()
    if records is None:
        records = read_records(results, published=False)

    planning = _Planning(results.absolute(), selected_scorer, seed, rerun, records)
    is_named = are_named(methods)
    planned: dict[str, Planned] = {}
    for gallery in galleries(input=input, **data):
        for input_ in gallery.inputs:
            rows = gallery.rows(input_, selected_methods, results / "models", named=is_named)
            for job in planning.jobs(gallery, input_, rows):
                key = job.record.key
                if key in planned:  # two tables show the same job, which runs once
                    known = planned[key]
                    planned[key] = replace(known, galleries=(*known.galleries, gallery))
                else:
                    planned[key] = job
    if not planned:
        problem = "no selected method belongs to a selected table"
        raise ConfigurationError(problem, "drop -m, -t or --input")
    return list(planned.values())


def _check_pair(record: Record) -> None:
    """Check that queries have something to find in a gallery of other shapes.

    Raises
    ------
    DatasetError
        If the gallery has one class alone, or no shape of the class of any query.
    """
    gallery = record.gallery_of_queries
    if gallery is None:  # shapes rank each other, which was checked before
        return
    has_classes = len({*gallery.labels}) >= 2
    has_matches = any(record.are_queries)
    if has_classes and has_matches:
        return
    of_queries = _first_classes(record.labels)
    of_gallery = _first_classes(gallery.labels)
    raise DatasetError(
        f"nothing can be retrieved: queries are of {of_queries}, "
        f"and shapes of {gallery.gallery} of {of_gallery}",
        "name the classes of both alike, and give the gallery two or more",
    )


def _first_classes(labels: Iterable[str]) -> str:
    """Return the first few names of classes, joined by commas."""
    return ", ".join(sorted({*labels})[:_MOST_CLASSES_NAMED])


@dataclass(frozen=True)
class _ShapesOfSide:
    """Shapes on one side of a ranking, for all methods: keys of prepared shapes are the same.

    Parameters
    ----------
    gallery
        The queries, or the gallery that they are ranked in.
    shapes
        The data set under its input.
    prepared_keys
        Key of the prepared shape of each view.
    source
        Where workers get the shapes.
    """

    gallery: Gallery
    shapes: PreparedShapes
    prepared_keys: list[str]
    source: ShapeSource


def _shapes_of_side(gallery: Gallery, input_: Input, data_root: Path | None) -> _ShapesOfSide:
    """Return the shapes of a gallery under an input, with their keys."""
    rendered = gallery.seen
    shapes = PreparedShapes(rendered.dataset, input_)
    keys = [shapes.key(entry) for entry in rendered.entries]
    source = ShapeSource(_absolute(rendered.source), data_root, input_)
    return _ShapesOfSide(gallery, shapes, keys, source)


def _planned_side(side: _ShapesOfSide, models: Models) -> PlannedSide:
    """Return the shapes on one side of a job, with the models of its method."""
    return PlannedSide(side.gallery, side.source, side.shapes.frame_key, tuple(models))


class _Trained(NamedTuple):
    """Models of the views on one side of a ranking, or why a job cannot run at these shapes.

    Parameters
    ----------
    models
        Model of each view; None for a method that does not learn, or cannot run.
    state, reason
        State of a job that cannot run, and why; None for one that can.
    """

    models: Models
    state: State | None = None
    reason: str = ""


@dataclass
class _Planning:
    """What all jobs of a plan share."""

    results: Path
    scorer: Component
    seed: int
    rerun: Collection[str]
    records: Iterable[Record]

    def __post_init__(self) -> None:
        self._component_key = cache(Component.key)
        self._key_of_signatures = cache(Component.key_of_signatures)
        self._component_code = cache(Component.code)
        self._code_of_step = cache(code_of_step)
        self._code_of_forms = code_of_modules([STAGE_MODULES["forms"]])
        self._code_of_ranking = code_of_modules([STAGE_MODULES["records"]])
        self._records = {record.row: record for record in self.records if not record.published}

    def jobs(
        self, gallery: Gallery, input_: Input, methods: Sequence[Component]
    ) -> Iterator[Planned]:
        """Yield a job for each method on one gallery, with its state: finished, missing, stale ...

        Parameters
        ----------
        gallery
            The shapes. They rank each other, or are queries to another gallery that it names.
        input_
            ``"mesh"`` or ``"view"``.
        methods
            The methods.
        """
        if not methods:
            return
        # All methods get the same shapes, whose keys take long to compute.
        fields_of_shapes = gallery_facts(gallery, input_)
        data_root = gallery.data_root.absolute() if gallery.data_root else None
        sides = [_shapes_of_side(gallery, input_, data_root)]
        other = gallery.gallery_of_queries
        if other:
            sides.append(_shapes_of_side(other, other.inputs[0], data_root))
        for method in methods:
            planned = self._job(fields_of_shapes, sides, method)
            _check_pair(planned.record)
            yield planned

    def _job(
        self, fields_of_shapes: dict[str, Any], sides: Sequence[_ShapesOfSide], method: Component
    ) -> Planned:
        """Return the job of one method, with its state.

        Parameters
        ----------
        fields_of_shapes
            Fields of its record that say which shapes it ranks; see :func:`gallery_facts`.
        sides
            The queries, and the gallery if its shapes are others.
        method
            The method.
        """
        gallery = sides[0].gallery
        scorer = None if method.describes else self.scorer
        row = self._row(fields_of_shapes["input"], sides, method, scorer)

        # Find the trained models, some of which may be missing.
        trained_here = self.results / "models"
        is_pair = len(sides) > 1
        trained = [_find_models(side, method, trained_here, is_of_pair=is_pair) for side in sides]
        models = [side.models for side in trained]
        seen = _seen_shapes(gallery, models[0])

        # The fields of its record, without an outcome.
        content = fields_of_shapes | self._describe(method, scorer)
        content["key"] = digest(["unavailable", row])
        content["seen"] = seen
        content["models"] = [model.summary() for model in _different_models(models)]

        # A job that can run has a key of its code and data, which tells whether it has run already.
        before = self._records.get(row)
        codes: dict[Stage, PlannedCode | None] = {}
        state, reason = _obstacle(gallery, trained, seen)
        if state is None:
            codes = self._codes(method, scorer)
            content |= self._keys(row, fields_of_shapes, sides, models, method, scorer)
            state, reason = self._state(before, content["key"], content["parts"])

        job = Job(
            key=content["key"], row=row, method=method, scorer=self.scorer, results=self.results
        )
        return Planned(
            job=job,
            sides=tuple(map(_planned_side, sides, models)),
            codes=codes,
            galleries=(gallery,),
            record=record_of(content),
            state=state,
            reason=reason,
            before=before,
            is_pending=state in _PENDING or state in self.rerun,
        )

    def _row(
        self,
        input_: Input,
        sides: Sequence[_ShapesOfSide],
        method: Component,
        scorer: Component | None,
    ) -> RowId:
        """Return what the record of a job is the result of."""
        scorer_name = scorer.name if scorer else ""
        paths = tuple(path_of(side.gallery.source) for side in sides)
        gallery = sides[0].gallery
        return RowId(gallery.name, input_, method.name, self.seed, scorer_name, paths)

    def _keys(
        self,
        row: RowId,
        fields_of_shapes: Mapping[str, Any],
        sides: Sequence[_ShapesOfSide],
        models: Sequence[Models],
        method: Component,
        scorer: Component | None,
    ) -> dict[str, Any]:
        """Return the fields of a record that say what its scores are computed from.

        Parameters
        ----------
        row
            Identifies the row of a table; results of one row replace each other.
        fields_of_shapes
            Fields that say which shapes are ranked.
        sides
            The queries, and the gallery if its shapes are others.
        models
            For each side, the trained model of each view, or None.
        method
            The method.
        scorer
            The scorer; None for a descriptor, which compares shapes itself.

        Returns
        -------
        dict
            ``key`` of the record; ``result_key``, the same without the places of folders on the
            disk; ``files``, keys of the cached files by stage; ``parts``, digests of code, data,
            models and parameters by name, which tell later why a key changed; and, for queries to
            another gallery, ``against``, the fields of that.
        """
        # For each side, the keys of the files by stage; for each view, the keys of all its stages.
        files_of_sides = []
        keys_of_views: list[tuple[str, ...]] = []
        for side, models_of_side in zip(sides, models, strict=True):
            files = self._files(side.prepared_keys, models_of_side, method, scorer)
            files_of_sides.append(files)
            keys_of_views += zip(*files.values(), strict=True)

        # All that determines the record is in its key, titles too, but no place on the disk.
        titles = [method.title, scorer.title if scorer else ""]
        ingredients = [
            row._replace(paths=()),
            titles,
            fields_of_shapes["gallery_digest"],
            keys_of_views,
            self._code_of_ranking,
        ]
        if scorer and scorer.info.comparing:  # this code is in no key of a view
            ingredients.append(self._component_key(scorer))
        result_key = digest(ingredients)

        parts = self._parts(sides, models, method, scorer)
        parts["the data"] = fields_of_shapes["gallery_digest"]
        fields = {
            "key": key_at(result_key, row.paths),
            "result_key": result_key,
            "parts": parts,
            "files": files_of_sides[0],
        }
        if len(sides) > 1:
            fields["against"] = fields_of_shapes["against"] | {"files": files_of_sides[1]}
        return fields

    def _state(
        self, record: Record | None, key: str, parts: Mapping[str, str]
    ) -> tuple[State, str]:
        """Return the state of a job that can run, from the last record of its row.

        Parameters
        ----------
        record
            The last record; None if the row never ran.
        key
            Key that the record would have now. If the last one has another key, the job is stale.
        parts
            Digests of what the key is computed from, by name.

        Returns
        -------
        state : str
            ``"finished"``, ``"failed"``, ``"incomplete"``, ``"stale"``, ``"missing"``, or
            ``"unavailable"`` if the record was written by a newer version.
        reason : str
            Why, in words; of a stale job, what changed.
        """
        if record is not None and record.key == key:
            if record.status == "incomplete":
                return "incomplete", record.reason
            if record.status == "ok":
                return "finished", record.refusals
            return "failed", f"{record.status}: {record.reason}"
        newer_record = newer_record_at(self.results, key)
        if newer_record:
            return "unavailable", with_hint(newer_record, "update the suite")
        if record is None:
            return "missing", "never run"
        if record.parts.get("its code"):  # code of which no digest is known
            reason = "it ran in the process of a program, or with -j 0, of which nothing is reused"
            return "stale", reason
        known = {**self._definitions, **definitions_of(parts.items())}
        return "stale", describe_change(record.parts, parts, known)

    @cached_property
    def _definitions(self) -> Definitions:
        """Definitions in the code of earlier runs."""
        return read_definitions(self.results)

    def _describe(self, method: Component, scorer: Component | None) -> dict[str, Any]:
        """Return the fields of a record that describe a method and a scorer.

        The status is that of a job that cannot run; a run replaces it.
        """
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
        """Return the code that makes the files of each stage behind preparation."""
        makers: dict[Stage, Component] = {"forms": method, "records": scorer or method}
        if scorer:
            makers["signatures"] = scorer
        return {stage: self._code_of_step(maker, stage) for stage, maker in makers.items()}

    def _files(
        self,
        prepared_keys: list[str],
        models: Models,
        method: Component,
        scorer: Component | None,
    ) -> dict[str, list[str]]:
        """Return the keys of the cached files of each view, by stage.

        The key of a file is a digest of all that it is computed from.

        Parameters
        ----------
        prepared_keys
            Key of the prepared shape of each view.
        models
            Trained model for each view; None for a method that does not learn.
        method
            The method.
        scorer
            The scorer; None for a descriptor, whose files have no signatures ("").
        """
        forms = []
        for prepared_key, model in zip(prepared_keys, models, strict=True):
            ingredients = [
                prepared_key,
                self._component_key(method),
                self._code_of_forms,
                self.seed,
                model.digest if model else "",
            ]
            forms.append(digest(ingredients))
        if scorer:
            scorer_key = self._key_of_signatures(scorer)
            signatures = [digest([form_key, scorer_key]) for form_key in forms]
        else:
            signatures = [""] * len(forms)
        return {"prepared": prepared_keys, "forms": forms, "signatures": signatures}

    def _parts(
        self,
        sides: Sequence[_ShapesOfSide],
        models: Sequence[Models],
        method: Component,
        scorer: Component | None,
    ) -> dict[str, str]:
        """Return everything that determines the scores, as digests and texts by name.

        The names are those that users see when a result is stale: "gps.py, the camera changed".

        Parameters
        ----------
        sides
            The queries, and the gallery if its shapes are others.
        models
            For each side, the trained model of each view, or None.
        method
            The method.
        scorer
            The scorer; None for a descriptor, which compares shapes itself.
        """
        parts = self._component_code(method) | self._code_of_forms | self._code_of_ranking
        if scorer:
            parts |= self._component_code(scorer)
        # The queries come last: of two cameras, theirs is kept.
        for side in reversed(sides):
            parts = side.shapes.code | parts | {"the camera": side.shapes.camera_key}
        for owner, component in (("its", method), ("the scorer's", self.scorer)):
            parts[f"{owner} title"] = component.info.title
            parts[f"{owner} parameters"] = json.dumps(
                dict(component.parameters), sort_keys=True, default=str
            )
        for model in _different_models(models):
            parts[f"the model {model.training}"] = model.digest
        return parts


def _as_json(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters as they are read from a record."""
    return dict(json.loads(json.dumps(dict(values), default=str)))


def _absolute(source: str) -> str:
    """Return a source for workers, which may have another working directory."""
    if is_path(source) and not is_known(source):
        return str(Path(source).absolute())
    return source


def _different_models(models: Iterable[Models]) -> list[Model]:
    """Return the models of all views, each once."""
    return [model for model in dict.fromkeys(chain(*models)) if model]


def gallery_facts(gallery: Gallery, input_: Input) -> dict[str, Any]:
    """Return the fields of a record that describe the shapes that it ranks.

    If they are queries to another gallery, ``against`` has the same fields of that gallery.

    Parameters
    ----------
    gallery
        The shapes.
    input_
        ``"mesh"`` or ``"view"``.
    """
    shapes = gallery.dataset
    path = path_of(gallery.source)  # "" for a set that is no folder of the user
    contents = [
        (entry.identifier, entry.subject, str(shapes.key(entry))) for entry in gallery.entries
    ]
    # Cameras in a folder of the user are not in the keys of its shapes.
    settings: list[object] = []
    if path:
        settings.append(shapes.half_width)
        settings += [
            (repr(shapes.camera(entry)), repr(shapes.sensor(entry))) for entry in gallery.entries
        ]
    facts = {
        "gallery": gallery.name,
        "gallery_digest": digest_of_shapes(contents, settings),
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
    if gallery.gallery_of_queries:
        facts |= _facts_of_both(facts, gallery, gallery.gallery_of_queries)
    return facts


def _facts_of_both(queries: Mapping[str, Any], gallery: Gallery, other: Gallery) -> dict[str, Any]:
    """Return the further fields of a record whose queries are ranked in another gallery.

    Parameters
    ----------
    queries
        Fields that describe the queries.
    gallery
        The queries.
    other
        The gallery in which they are ranked.

    Returns
    -------
    dict
        ``against``, the fields of the other gallery; ``keeps_same_names``, whether a query may
        match a shape of its own name; ``gallery_digest`` of both together.
    """
    against = gallery_facts(other, other.inputs[0])
    both = digest_of_both(
        queries["gallery_digest"],
        against["gallery_digest"],
        against["input"],
        keeps_same_names=gallery.table.keeps_same_names,
        cameras=other.cameras,
    )
    return {
        "against": against | {"views": other.n_views},
        "keeps_same_names": gallery.table.keeps_same_names,
        "gallery_digest": both,
    }


def _find_models(
    side: _ShapesOfSide, method: Component, trained_here: Path, *, is_of_pair: bool
) -> _Trained:
    """Return the trained model of a method for each view, or why the method cannot run.

    Parameters
    ----------
    side
        Queries or gallery.
    method
        The method; one that does not learn has None for each view.
    trained_here
        Folder of models that the user trained. They are preferred to those of the suite.
    is_of_pair
        Whether queries are ranked in another gallery, which may be shown from several cameras.
    """
    gallery = side.gallery
    no_models: Models = [None] * len(side.prepared_keys)
    if side.shapes.input not in method.info.inputs:
        reason = f"does not take the {side.shapes.input} input"
        if is_of_pair and side.shapes.input == "mesh":
            reason = with_hint(reason, "pass --gallery-views 12 to see meshes as views")
        return _Trained(no_models, "unsupported", reason)
    missing = method.missing_packages()
    if missing:
        reason = f"needs {', '.join(missing)}: pip install {' '.join(missing)}"
        return _Trained(no_models, "unavailable", reason)
    try:
        model_by_shape = gallery.models(method, trained_here)
    except MissingModel as error:
        return _Trained(no_models, "unavailable", str(error))
    except (NoFolds, TooNear) as error:
        return _Trained(no_models, "unsupported", str(error))
    models: list[Model | None] = []
    for entry in gallery.entries:
        model = model_by_shape.get(entry.identifier)
        models += [model] * gallery.n_views  # all views of a shape have one model
    return _Trained(models)


def _obstacle(
    gallery: Gallery, trained: Iterable[_Trained], seen: Sequence[str]
) -> tuple[State | None, str]:
    """Return the state of a job that cannot run, and why; None if it can."""
    if seen and gallery.table.all_unseen:
        reason = f"{len(seen)} shapes were seen in training, such as {seen[0]}"
        return "unsupported", with_hint(reason, "take a model of another training")
    for side in trained:
        if side.state:
            return side.state, side.reason
    return None, ""


def _seen_shapes(gallery: Gallery, models: Models) -> list[str]:
    """Return the names of the shapes that the model for them was trained on."""
    return [
        entry.identifier
        for entry, model in zip(gallery.entries, models, strict=True)
        if model and model.has_seen(entry, gallery.dataset.name)
    ]


def describe_change(
    before: Mapping[str, str], now: Mapping[str, str], known: Definitions | None = None
) -> str:
    """Say why the key of a result changed, such as ``gps.py (GPS.canonicalise), numpy changed``.

    Parameters
    ----------
    before, now
        Digests of what the key is computed from, by name: files of code, packages, data ...
    known
        Digests of functions, classes and constants in the files, by which those that changed can be
        named.
    """
    changed: dict[str, None] = {}  # an ordered set: two files may have one name
    for name in sorted(before.keys() | now.keys()):
        old = before.get(name, "")
        new = now.get(name, "")
        if old == new:
            continue
        file = Path(name).name
        definitions = listed(changed_definitions(old, new, known or {}))
        changed[f"{file} ({definitions})" if definitions else file] = None
    return f"{listed(changed) or 'the code'} changed"


# Time
# ------------------------------------------------------------------------------------------------


class Estimate(NamedTuple):
    """Upper bound for the work of a plan.

    Parameters
    ----------
    seconds
        Seconds on one core.
    unknown
        Number of jobs that are not in the seconds, as no job of their method has finished.
    uses_published
        Whether some of the seconds are those of the machine of published records.
    """

    seconds: float
    unknown: int
    uses_published: bool = False


def estimate(
    planned: Sequence[Planned], records: Iterable[Record], published: Path = SUITE_RESULTS
) -> Estimate:
    """Estimate how long the pending jobs of a plan take, as if nothing were in the cache.

    The estimate rests on the seconds a shape that earlier records of the same methods report. A
    file that several jobs need counts once.

    Parameters
    ----------
    planned
        The plan.
    records
        Records of jobs that ran here, which count before published ones.
    published
        Folder of the published records.

    Returns
    -------
    Estimate
        Seconds on one processor, the number of jobs that nothing is known of, and whether published
        records are used.
    """
    pending = [job.record for job in planned if job.is_pending]
    if not pending:
        return Estimate(0.0, 0)
    finished = _timed_records(records, published)
    unknown: set[str] = set()
    seconds_of_file: defaultdict[str, float] = defaultdict(float)  # several jobs may need a file
    seconds_of_ranking: dict[tuple[str, str], float] = {}
    uses_published = False
    for job in pending:
        for side in job.sides:
            similar = _similar_records(job, side, finished)
            uses_published |= any(record.published for record in similar)
            seconds = _seconds_per_shape(similar)
            if not seconds:
                unknown.add(job.key)
            for key, seconds_of_making in _seconds_of_files(side, seconds):
                seconds_of_file[key] = max(seconds_of_file[key], seconds_of_making)
            n_views = len(side.shapes) * side.views
            seconds_of_ranking[job.key, side.gallery] = seconds[STAGES["records"]] * n_views

    total = sum(seconds_of_file.values()) + sum(seconds_of_ranking.values())
    return Estimate(total, len(unknown), uses_published)


def _timed_records(records: Iterable[Record], published: Path) -> list[Record]:
    """Return records that say how long their jobs took, the published ones before those from here.

    Records of queries to another gallery are left out, as the time of these is not that of a shape.
    """
    known = read_records(published, local=False)
    known += [record for record in records if not record.published]
    return [record for record in known if record.seconds and not record.gallery_of_queries]


def _seconds_of_files(
    side: RankedShapes, seconds: Mapping[str, float]
) -> Iterator[tuple[str, float]]:
    """Yield the key of each file of some shapes, with the seconds that it takes to make it.

    Parameters
    ----------
    side
        The shapes, with the keys of their files by stage.
    seconds
        Seconds of each stage per shape. Geodesics, which are computed once for all methods, count
        for the prepared shape.
    """
    for stage, keys in side.files.items():
        seconds_of_stage = seconds[STAGES[stage]]
        if stage == "prepared":
            seconds_of_stage += seconds["geodesics"]
        for key in filter(None, keys):
            yield key, seconds_of_stage


def _similar_records(
    job: Record, side: RankedShapes, finished: Sequence[Record]
) -> Sequence[Record]:
    """Return the records from which the seconds of a job are estimated; none if nothing is known.

    It is the last one of the same method on the same gallery, or at least data set; otherwise, they
    are all of the method.

    Parameters
    ----------
    job
        Record of the job, which has not run.
    side
        Its queries or its gallery.
    finished
        Records of jobs that ran, the latest ones last.
    """
    same_input = [record for record in finished if record.input == side.input]
    similar = [record for record in same_input if record.method == job.method]
    if not similar:  # take the method with other parameters
        similar = [record for record in same_input if record.base_name == job.base_name]

    of_same_data = [record for record in similar if record.gallery == side.gallery]
    if not of_same_data:
        of_same_data = [record for record in similar if record.data.name == side.data.name]
    return of_same_data[-1:] or similar


def _seconds_per_shape(records: Iterable[Record]) -> defaultdict[str, float]:
    """Return the median seconds of each stage per shape; 0 for one that was not timed."""
    all_seconds = [record.seconds for record in records]
    median: defaultdict[str, float] = defaultdict(float)
    for stage in set[str]().union(*all_seconds):
        median[stage] = statistics.median(seconds.get(stage, 0.0) for seconds in all_seconds)
    return median
