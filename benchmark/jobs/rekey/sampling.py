"""Stages of a few shapes of each row, made by the code of one tree, with the digest of all that came out.

The verb ``sample`` reads a request from a file and answers in another one, so that two commits can be asked the same,
however their insides are called. A request is a JSON object:

- ``rows``: what :class:`Row` holds, each with the ``sample`` of its shapes; without one, recipes alone are asked for;
- ``results``: folder whose models are used; ``store``: folder of the arrays of the samples;
- ``data_root``, ``plugins``;
- ``regions``: parts of the code whose execution is to be told, by file; see :mod:`benchmark.jobs.rekey.reached`;
- ``small``: whether shapes and views are small enough for kernels that are not compiled; ``meshes``: store of an
  earlier request whose meshes are taken then, "" to read or generate them.

The answer has one JSON object a line: the root of the tree; for each row its ``key``, ``recipe`` and either the keys of
its ``artefacts`` or its ``stages``; and after each shape the ``steps`` that were made and the regions that were
``reached``.
"""

from __future__ import annotations

import copy
import hashlib
import json
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, cast

from benchmark.api.contracts import Input, Mesh
from benchmark.api.learning import CARD, WEIGHTS, TrainingData, TrainingPair, read_card
from benchmark.api.streaming import StreamedData
from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.parts import Part
from benchmark.errors import ConfigurationError, ShapeError, one_line
from benchmark.jobs.execution.runner import ranked
from benchmark.jobs.job_specs import from_json, to_json
from benchmark.jobs.method_run import MethodRun
from benchmark.jobs.pairs import training_data
from benchmark.jobs.plan import Job, data_recipe, description, job_recipe
from benchmark.jobs.preparation import REFUSED, Preparation
from benchmark.jobs.recipes import distances_recipe, draws_of, source_recipe, training_code
from benchmark.jobs.rekey.reached import Reached
from benchmark.methods.registry import MethodSpec, methods, variant
from benchmark.methods.scorers import DEFAULT, ScorerSpec, scorer_of, scorers
from benchmark.protocols.galleries import Gallery
from benchmark.protocols.models import MissingModel, Model, find_models
from benchmark.protocols.tables import Table
from benchmark.protocols.trainings import find_training
from benchmark.storage.keys import digest
from benchmark.storage.records import answered_labels, answered_shapes, scorer_name
from benchmark.storage.store import Artefact, Store
from benchmark.system.arrays import digest_of

#: Stages in their order, as an answer names them.
STAGES = ("mesh", "prepared", "form", "signature", "distances", "measures", "training")

#: Parts of the content of a record that are measures.
_MEASURES = (
    "status", "scores", "codebook_deviation", "per_query", "tied_queries", "lone_queries", "splits", "shapes", "labels",
)  # fmt: skip

#: Vertices of a prepared shape, and pixels of a view, where kernels are not compiled.
SMALL_SHAPE, SMALL_VIEW = 60, 32

#: Options of a training of three steps.
_PAIR_STEPS = {"epochs": 3, "batch": 2, "resolution": 128, "device": "cpu", "threads": 1}
_STREAM_STEPS = {"steps": 3, "bodies": 2, "device": "cpu", "threads": 1}

#: What came out of a stage of a shape: its digest, and the key of its arrays; "" where none were kept.
Outcome = tuple[str, str]


@dataclass(frozen=True)
class Row:
    """A record as both trees of a comparison can be asked for it.

    Parameters
    ----------
    source, identifiers
        The data set by the name under which it is opened, and the shapes of the gallery.
    input, method, scorer, seed, split_size
        The job.
    sample
        The shapes to make; none to be told recipes alone.
    last
        Last stage that is made, of :data:`STAGES`.
    train
        Whether three steps of the training of its models are made as well.
    models
        Name of the training and digest of each model; where they are not here, another one of the method stands in.
    has_artefacts
        Whether the keys of its arrays are asked for.
    """

    source: str
    identifiers: tuple[str, ...]
    input: str
    method: str
    scorer: str = DEFAULT
    seed: int = 0
    split_size: int = 0
    sample: tuple[str, ...] = ()
    last: str = "measures"
    train: bool = False
    models: tuple[tuple[str, str], ...] = ()
    has_artefacts: bool = False

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Row:
        """Return the row of a record that has scores."""
        return cls(
            source=record["data"]["source"],
            identifiers=tuple(dict.fromkeys([*record["shapes"], *(name for name, _ in record["unsupported"])])),
            input=record["input"],
            method=record["method"],
            scorer=scorer_name(record) or DEFAULT,
            seed=int(record["recipe"].get("seed", 0)),
            split_size=int(record["recipe"].get("split_size", 0)),
            models=tuple(sorted(record["recipe"].get("models", {}).items())),
            has_artefacts=bool(record.get("artefacts")),
        )

    @classmethod
    def read(cls, told: Mapping[str, Any]) -> Row:
        """Return a row that travelled as JSON; fields of later versions are of no account."""
        known = {name: told[name] for name in cls.__dataclass_fields__ if name in told}
        return cls(**known | {name: tuple(known.get(name, ())) for name in ("identifiers", "sample")})

    def plain(self) -> dict[str, Any]:
        """Return the row as it travels."""
        return asdict(self)


def sample_of(record: Mapping[str, Any], size: int) -> tuple[str, ...]:
    """Choose the shapes of a record that are made by both trees: a rule that looks at classes and refusals alone.

    Two shapes of the first class, which makes a relevant pair, then one of each further class, the last class first,
    from the first to the last pose in turn; beside them the first and the last shape that was refused.

    Parameters
    ----------
    record
        A record with scores.
    size
        Shapes besides those that were refused.
    """
    classes: dict[str, list[str]] = {}
    answered, refused = answered_shapes(record), [name for name, _ in record["unsupported"]]
    for name, label in zip(answered, answered_labels(record), strict=True):
        classes.setdefault(label, []).append(name)
    pairs = [members for members in classes.values() if len(members) > 1]
    chosen = [pairs[0][0], pairs[0][-1]] if pairs else []
    others = [members for members in reversed(classes.values()) if members not in pairs[:1]]
    places = [members[(k * len(members)) // max(len(others), 1)] for k, members in enumerate(others)]
    rest = [name for name in answered if name not in {*chosen, *places}]
    chosen += [*places, *rest][: max(size - len(chosen), 0)]
    return tuple(dict.fromkeys([*chosen, *refused[:1], *refused[-1:]]))


def answer(request: Mapping[str, Any], out: Path) -> None:
    """Answer a request; groups of rows that the file answers already are passed over.

    Parameters
    ----------
    request
        See the top of this module.
    out
        File to which the answer is appended.
    """
    rows = [Row.read(told) for told in request["rows"]]
    known = _known_lines(out)
    done = {line["row"] for line in known if "row" in line}
    if request.get("small"):
        make_small()
    root = Path(__file__).parents[3]
    reached = Reached(request.get("regions", {}), root)
    with out.open("a", encoding="utf-8") as file, reached.watching():  # methods are made of parameters, too

        def tell(**line: Any) -> None:
            file.write(json.dumps(line, allow_nan=True) + "\n")
            file.flush()

        tell(root=str(root))
        tools = _Tools.of(request)
        groups: dict[tuple[Any, ...], list[int]] = {}
        for number, row in enumerate(rows):
            if number not in done:
                groups.setdefault((row.source, row.input, row.seed), []).append(number)
        for group in groups.values():
            tell(begun=group)
            for number, found in tools.group([rows[number] for number in group], reached, tell):
                tell(row=group[number], **found)


def _known_lines(out: Path) -> list[dict[str, Any]]:
    """Lines of an answer that was begun, without the last one if it is cut off."""
    if not out.exists():
        return []
    lines = []
    for text in out.read_text(encoding="utf-8").splitlines():
        try:
            lines.append(json.loads(text))
        except ValueError:
            break
    out.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    return lines


@dataclass
class _Tools:
    """Objects that the rows of a request share."""

    methods: Mapping[str, MethodSpec]
    scorers: Mapping[str, ScorerSpec]
    data_root: Path | None
    models: Path
    store: Store
    small: bool
    meshes: Store | None
    _datasets: dict[str, Dataset] = field(default_factory=dict)
    _data: dict[tuple[Any, ...], dict[str, Any]] = field(default_factory=dict)
    _preparations: dict[tuple[str, Input], Preparation] = field(default_factory=dict)

    @classmethod
    def of(cls, request: Mapping[str, Any]) -> _Tools:
        files = [Path(name) for name in request.get("plugins", ())]
        root = request.get("data_root")
        return cls(
            methods(files),
            scorers(files),
            Path(root) if root else None,
            Path(request["results"]) / "models",
            Store.open(Path(request["store"])),
            bool(request.get("small")),
            Store(Path(request["meshes"]) / "runs") if request.get("meshes") else None,
        )

    def group(
        self, rows: Sequence[Row], reached: Reached, tell: Callable[..., None]
    ) -> Iterator[tuple[int, dict[str, Any]]]:
        """Answer rows of one data set, input and seed; shapes are prepared once for all of them."""
        jobs: dict[int, Job] = {}
        for number, row in enumerate(rows):
            try:
                jobs[number] = self.job(row)
            except Exception as error:  # a plug-in may raise anything
                yield number, {"error": one_line(error)}
        asked = {number: rows[number] for number in jobs if rows[number].sample}
        for number, job in jobs.items():
            if number not in asked:
                artefacts = list(self.artefacts(job)) if rows[number].has_artefacts else []
                names = {"module": job.facts["data"]["module"], "target": job.facts["target"]}
                found = {"key": job.key, "recipe": job.recipe, "artefacts": artefacts, **names}
                yield number, found | ({"training": training_code(job.method)} if job.models else {})
        if not asked:
            return
        stages = self._made(asked, jobs, lambda steps: tell(steps=steps, reached=sorted(reached.found)))
        for number, found in stages.items():
            yield number, {"key": jobs[number].key, "recipe": jobs[number].recipe, "stages": found}

    def job(self, row: Row) -> Job:
        """Return the job of a row; it belongs to no table of the paper."""
        dataset = self._dataset(row.source)
        names = frozenset(row.identifiers)
        entries = tuple(entry for entry in dataset.entries if entry.identifier in names)
        if len(entries) < len(names):
            raise ConfigurationError(f"{len(names) - len(entries)} shapes of {row.source} are not here", "--data-root")
        gallery = self._gallery(row, dataset, entries)
        spec, input_ = variant(row.method, self.methods), cast(Input, row.input)
        scorer = ScorerSpec() if spec.describes else scorer_of(row.scorer, self.scorers)
        place = (row.source, input_, row.identifiers)
        if place not in self._data:
            self._data[place] = data_recipe(gallery, input_)
        named = {}
        try:
            models = find_models(spec, gallery, self.models)
        except MissingModel:
            models, named = self._standing_in(spec, entries), {"models": dict(row.models)}
        recipe = job_recipe(gallery, spec, self._data[place], models, row.seed, scorer) | named
        return Job(
            **description(gallery, input_, spec, scorer, models), key=digest(recipe), recipe=recipe, seed=row.seed,
            results=self.store.root.parent,
        )  # fmt: skip

    def _standing_in(self, spec: MethodSpec, entries: Iterable[Entry]) -> dict[str, Model]:
        """Return a model of the same network for shapes whose own is not here; raises ``MissingModel`` without one."""
        learner: Any = spec.create()
        for card in sorted(learner.shipped_models.glob(f"*/{learner.model_name}/{CARD}")):
            model = Model(card.parent.parent.name, card.parent, read_card(card.parent))
            return {entry.identifier: model for entry in entries}
        raise MissingModel(f"{spec.name} has no model here", "bring the model that made the row")

    def artefacts(self, job: Job) -> Iterator[str]:
        """Return the keys of all arrays that stay of a job, in an order that depends on its shapes alone."""
        place = (job.gallery.source, job.input)
        if place not in self._preparations:
            self._preparations[place] = Preparation(job.gallery.dataset, job.input, self.store)
        method_run = self._method_run(job, self._preparations[place])
        forms = []
        for entry in job.gallery.entries:
            forms.append(method_run.recipe(entry))
            yield digest(method_run.preparation.recipe(entry))
            yield digest(forms[-1])
        yield from (digest(distances_recipe(forms, job.scorer, draw)) for draw in draws_of(job.method, job.scorer))
        yield method_run.preparation.frame_key

    def _dataset(self, source: str) -> Dataset:
        if source not in self._datasets:
            found = open_dataset(source, self.data_root)
            self._datasets[source] = _smaller(found, self.meshes) if self.small else found
        return self._datasets[source]

    def _gallery(self, row: Row, dataset: Dataset, entries: tuple[Entry, ...]) -> Gallery:
        table = Table("sample", "", dataset.name, all_unseen=False, split_size=row.split_size)
        return Gallery(table, row.source, dataset, entries, data_root=self.data_root)

    def _method_run(self, job: Job, preparation: Preparation) -> MethodRun:
        return MethodRun(preparation, self.store, job.method, job.seed, job.model_of, job.scorer)

    def _made(
        self, rows: Mapping[int, Row], jobs: Mapping[int, Job], tell: Callable[[int], None]
    ) -> dict[int, dict[str, Any]]:
        """Make the samples of rows of one data set, input and seed: outcomes by row, stage and shape."""
        first = jobs[next(iter(rows))]
        preparation = Preparation(first.gallery.dataset, first.input, self.store)
        method_runs = {number: self._method_run(jobs[number], preparation) for number in rows}
        found: dict[int, dict[str, dict[str, Outcome]]] = {number: {} for number in rows}
        wanted = dict.fromkeys(name for row in rows.values() for name in row.sample)
        by_identifier = {entry.identifier: entry for entry in first.gallery.dataset.entries}
        for name in wanted:
            entry = by_identifier[name]
            shared = {
                "mesh": self._mesh(preparation, entry),
                "prepared": _attempt(partial(preparation.artefact, entry)),
            }
            for number, row in rows.items():
                if name in row.sample:
                    for stage, outcome in _until(row.last, shared, method_runs[number], entry):
                        found[number].setdefault(stage, {})[name] = outcome
            tell(sum(name in row.sample for row in rows.values()))
        for number, row in rows.items():
            if STAGES.index(row.last) >= STAGES.index("distances"):
                found[number] |= self._ranked(row, jobs[number])
            if row.train:
                found[number]["training"] = self._trained(jobs[number])
        tell(0)
        return found

    def _trained(self, job: Job) -> dict[str, Outcome]:
        """Train each model of a job for three steps on two pairs, or bodies: the digest of its weights."""
        learner: Any = job.method.create()
        found: dict[str, Outcome] = {}
        for name in job.models:
            training = find_training(name)
            few = Part(training.trained.subjects[:1], (training.trained.poses or (0, 1))[:2])
            whole = training_data(replace(training, trained=few), self.store, self.data_root, lambda said: None, 2)

            def pairs(start: int = 0, data: TrainingData = whole) -> Iterator[TrainingPair]:
                return islice(data.pairs(start), 2 - start)

            data = replace(whole, n_pairs=2, pairs=pairs, unseen=pairs)
            options = _STREAM_STEPS if isinstance(data, StreamedData) else _PAIR_STEPS
            with suppress(ConfigurationError):
                learner.check_options(options | {"workers": 0})
                options = options | {"workers": 0}
            with tempfile.TemporaryDirectory() as folder:
                error = "no weights"
                try:
                    learner.train(data, Path(folder), options, lambda said: None)
                except Exception as raised:  # of what comes after the steps, too
                    error = f"raises {type(raised).__name__}"
                weights = Path(folder) / WEIGHTS
                found[name] = hashlib.sha256(weights.read_bytes()).hexdigest()[:16] if weights.is_file() else error, ""
        return found

    def _mesh(self, preparation: Preparation, entry: Entry) -> Outcome:
        def compute() -> dict[str, Any]:
            mesh = preparation.mesh(entry)
            return {"vertices": mesh.vertices, "faces": mesh.faces}

        recipe = _mesh_recipe(preparation.dataset, entry)
        return _attempt(lambda: self.store.get_or_compute(recipe, compute, scratch=True))

    def _ranked(self, row: Row, job: Job) -> dict[str, dict[str, Outcome]]:
        """Rank the gallery of the sample: its distances and measures."""
        entries = tuple(entry for entry in job.gallery.entries if entry.identifier in row.sample)
        names = tuple(entry.identifier for entry in entries)
        n_classes = len({entry.subject for entry in entries})
        try:
            small = self.job(replace(row, identifiers=names, split_size=n_classes if row.split_size else 0))
            content = ranked(from_json(to_json(small)), self.store)
        except Exception as error:  # a plug-in may raise anything
            return {"measures": {"": (f"raises {type(error).__name__}", "")}}
        method_run = self._method_run(small, Preparation(small.gallery.dataset, small.input, self.store))
        refused = {name for name, _ in content["unsupported"]}
        forms = [method_run.recipe(entry) for entry in entries if entry.identifier not in refused]
        draws = draws_of(small.method, small.scorer)
        keys = {str(draw): digest(distances_recipe(forms, small.scorer, draw)) for draw in draws}
        measures = {name: content[name] for name in _MEASURES if name in content}
        kept = {draw: self.store.digest_under(key) for draw, key in keys.items()} if content["status"] == "ok" else {}
        return {
            "distances": {draw: (found, keys[draw]) for draw, found in kept.items()},
            "measures": {"": (digest(measures), "")},
        }


def _until(
    last: str, shared: Mapping[str, Outcome], method_run: MethodRun, entry: Entry
) -> Iterator[tuple[str, Outcome]]:
    """Outcomes of the stages of one shape, up to the last one that is wanted, or the first that refuses it."""
    made: dict[str, Callable[[], Outcome]] = {
        "mesh": lambda: shared["mesh"],
        "prepared": lambda: shared["prepared"],
        "form": lambda: _attempt(lambda: method_run.answer(entry)),
        "signature": lambda: _attempt(lambda: cast(Artefact, method_run.treat(entry).features)),
    }
    for stage, make in made.items():
        outcome = make()
        yield stage, outcome
        if stage == last or not outcome[1] or (stage == "form" and method_run.describes):
            return


def _attempt(make: Callable[[], Artefact]) -> Outcome:
    """Digest and key of what a stage makes; of what it refuses, the kind of error."""
    try:
        made = make()
    except ShapeError as error:
        return f"refuses with {type(error).__name__}", ""
    except Exception as error:  # a plug-in may raise anything
        return f"raises {type(error).__name__}", ""
    if REFUSED in made.arrays:
        return f"refuses with {made.arrays[REFUSED].tolist()[-1]}", ""
    return made.digest or digest_of(made.arrays), made.key


def _mesh_recipe(dataset: Dataset, entry: Entry) -> dict[str, Any]:
    return {"stage": "sampled mesh", "source": source_recipe(dataset, entry)}


def make_small(vertices: int = SMALL_SHAPE, pixels: int = SMALL_VIEW) -> None:
    """Let shapes and views of this process be small enough for kernels that are not compiled.

    Parameters
    ----------
    vertices
        Of a prepared shape.
    pixels
        Per side of a view of the scorer.
    """
    from benchmark.geometry import depth
    from benchmark.jobs.stages import complete
    from retrieval.cmbof import CMBOF

    complete.N_VERTICES = vertices
    depth.SAMPLES = 2 * vertices
    settings: Any = CMBOF.__init__
    settings.__kwdefaults__.update({"image_size": pixels, "n_words": 20})


def decimated(mesh: Mesh, vertices: int = SMALL_SHAPE) -> Mesh:
    """Return a mesh that is small enough for shapes of so many vertices, for kernels that are not compiled."""
    from benchmark.geometry.preparation import decimate

    return decimate(mesh, 2 * vertices) if mesh.n_vertices > 4 * vertices else mesh


def _smaller(dataset: Dataset, meshes: Store | None) -> Dataset:
    """The data set with decimated meshes, those of an earlier request where they are there."""
    kind: Any = type(dataset)

    def load(self: Any, entry: Entry) -> Mesh:
        found = meshes and meshes.find(_mesh_recipe(dataset, entry), scratch=True)
        return decimated(Mesh(found.arrays["vertices"], found.arrays["faces"]) if found else kind.load(self, entry))

    smaller = copy.copy(dataset)
    object.__setattr__(
        smaller, "__class__", type(kind.__name__, (kind,), {"load": load, "__module__": kind.__module__})
    )
    return smaller
