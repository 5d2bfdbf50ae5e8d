"""Stages of a shape, stored under their recipes: the prepared shape, its form or descriptor, and its signature."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from benchmark.api.contracts import Descriptor, Input, Mesh, Method, Shape
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.api.scoring import Scorer
from benchmark.arrays import Arrays
from benchmark.errors import ShapeError, UnsupportedShape
from benchmark.execution.processes.opened_files import with_files
from benchmark.pipeline import recipes
from benchmark.pipeline.recipes import Recipe
from benchmark.pipeline.stages import shapes
from benchmark.pipeline.storage.costs import Cost, Meter
from benchmark.pipeline.storage.environment import environment_text
from benchmark.pipeline.storage.lock import key_of
from benchmark.pipeline.storage.store import Artefact, StorageError, Store
from benchmark.plugins.output_checks import REFUSED, signature_of
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.remote import Foreign, SharedStages
from benchmark.plugins.scorers import ScorerSpec
from benchmark.protocols.models import Model


class Preparation:
    """Prepared shapes of one data set for one input.

    Parameters
    ----------
    dataset
        Source of the meshes.
    input_
        ``"mesh"`` for the complete surface, ``"view"`` for the part visible to the depth camera.
    store
        Store of the shapes; None to store nothing.
    """

    def __init__(self, dataset: ShapeSet, input_: Input, store: Store | None = None) -> None:
        self.dataset = dataset
        self.input = input_
        self.store = store
        self._meter = store.meter if store else Meter()
        self._latest: tuple[str, int, Shape] | None = None
        self._recipes: dict[str, Recipe] = {}

    def shape(self, entry: Entry, seed: int = 0) -> Shape:
        """Prepare a shape; the latest one stays in memory with its geodesics, which all methods share.

        Raises
        ------
        ShapeError
            If it cannot be read or prepared.
        """
        if self._latest is None or self._latest[:2] != (entry.identifier, seed):
            arrays = require_arrays(self.artefact(entry))
            shape = shape_of(arrays, entry.identifier, seed, SharedStages(self._meter))
            self._latest = (entry.identifier, seed, shape)
        return self._latest[2]

    def artefact(self, entry: Entry) -> Artefact:
        """Return the arrays of a prepared shape, or the reason why there are none; see :func:`require_arrays`."""
        source = self.dataset
        return self._stored(
            self.recipe(entry), lambda: attempted(lambda: self._compute(entry), source), f"prepare {self.input}"
        )

    def recipe(self, entry: Entry) -> Recipe:
        """Return the recipe of the prepared shape."""
        if entry.identifier not in self._recipes:
            frame = self._frame if self.input == "view" else {}
            self._recipes[entry.identifier] = recipes.shape_recipe(self.dataset, entry, self.input, frame)
        return self._recipes[entry.identifier]

    @cached_property
    def half_width(self) -> float:
        """Half the width of the camera's frame in file units, the same for all shapes of the data set."""
        if self.dataset.half_width is not None:
            return self.dataset.half_width
        return float(self._stored(self._frame, self._fit_frame, "frame").arrays["half_width"])

    @property
    def frame_key(self) -> str:
        """Key of the artefact that holds a frame fitted to the data set; "" if there is none."""
        return key_of(self._frame) if self.input == "view" and self.dataset.half_width is None else ""

    def mesh(self, entry: Entry) -> Mesh:
        """Return the mesh of a shape; generated meshes, which may take seconds, are stored during a run."""
        if entry.path is not None:
            return self.dataset.load(entry)

        def compute() -> Arrays:
            mesh = self.dataset.load(entry)
            return {"vertices": mesh.vertices, "faces": mesh.faces}

        recipe = recipes.source_recipe(self.dataset, entry)
        loaded = self._stored(recipe, lambda: attempted(compute), f"load {self.dataset.name}", scratch=True)
        return Mesh(require_arrays(loaded)["vertices"], loaded.arrays["faces"])

    def _compute(self, entry: Entry) -> Arrays:
        if self.input == "mesh":
            return shapes.complete(self.mesh(entry))
        if self.dataset.observe:
            frame = self.dataset.observe(entry)
            source, frame_notes = frame.surface, frame.notes
        else:
            source, frame_notes = self.mesh(entry), {}
        view = shapes.seen(source, self.dataset.camera(entry), self.half_width, recipes.sensor_of(self.dataset, entry))
        return {**view, **{f"note:{name}": np.asarray(note) for name, note in frame_notes.items()}}

    @cached_property
    def _frame(self) -> Recipe:
        return recipes.frame_recipe(self.dataset)

    def _fit_frame(self) -> Arrays:
        widths = []
        for entry in self.dataset.shapes:
            with suppress(ShapeError):  # this shape is counted as unsupported when it is processed
                widths.append(shapes.half_width_of(self.mesh(entry), self.dataset.camera(entry)))
        return {"half_width": np.asarray(shapes.frame_of(widths))}

    def _stored(self, recipe: Recipe, compute: Callable[[], Arrays], work: str, *, scratch: bool = False) -> Artefact:
        if self.store is not None:
            return self.store.get_or_compute(recipe, compute, work=work, scratch=scratch)
        return Artefact("", compute(), Cost(), environment_text(), was_cached=False)


def files_of(part: object) -> dict[str, str]:
    """Return the digests of the files that a data set, method or scorer of a plugin has read, by path."""
    return part.files if isinstance(part, Foreign) else {}


def shape_of(arrays: Arrays, identifier: str, seed: int = 0, cache: SharedStages | None = None) -> Shape:
    """Return the shape passed to methods, from its prepared arrays."""
    return Shape(
        identifier=identifier,
        mesh=Mesh(arrays["vertices"], arrays["faces"]),
        depth=arrays.get("depth"),
        source_area=float(arrays["source_area"]),
        seed=seed,
        cache=cache,
    )


def attempted(compute: Callable[[], Arrays], by: object = None) -> Arrays:
    """Return the arrays of a stage, and the files that a plugin read for them; for a refused shape, the reason."""
    try:
        arrays = compute()
    except ShapeError as error:
        arrays = {REFUSED: np.array([error.problem, error.hint, type(error).__name__])}
    return with_files(arrays, files_of(by))


def require_arrays(artefact: Artefact) -> Arrays:
    """Return the arrays of an attempted stage; raise ``UnsupportedShape`` with the reason if there are none."""
    if REFUSED in artefact.arrays:
        problem, hint = artefact.arrays[REFUSED].tolist()[:2]
        raise UnsupportedShape(problem, hint)
    return artefact.arrays


T = TypeVar("T")


def in_random_order(compute: Callable[[Entry], T], entries: Sequence[Entry]) -> list[T]:
    """Return a result for each shape, in their order; foreign code must not learn the order of a gallery."""
    order = secrets.SystemRandom().sample(range(len(entries)), len(entries))
    results = {place: compute(entries[place]) for place in order}
    return [results[place] for place in range(len(entries))]


#: Prefix of the names of arrays that are notes on a shape.
_NOTE = "note:"

#: Note on a form or descriptor of a plugin that differed when recomputed.
RUNS_DIFFER = f"{_NOTE}runs_differ"

#: Largest difference between two runs attributed to single precision, relative to the largest value.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class ShapeResult:
    """Artefacts of one shape by one method.

    Parameters
    ----------
    prepared, answer, signature
        The prepared shape, its form or descriptor, and the signature of the form (None if there is none).
    """

    prepared: Artefact
    answer: Artefact
    signature: Artefact | None = None

    @property
    def artefacts(self) -> list[Artefact]:
        """Existing artefacts."""
        return [self.prepared, self.answer, *([self.signature] if self.signature else [])]

    @property
    def notes(self) -> dict[str, float | str]:
        """Notes of the preparation and the method, by name."""
        arrays = {**self.prepared.arrays, **self.answer.arrays}
        return {name.removeprefix(_NOTE): note.item() for name, note in arrays.items() if name.startswith(_NOTE)}


@dataclass
class MethodRun:
    """A method with its parameters, seed and models, and the prepared shapes that it processes.

    Parameters
    ----------
    preparation
        Prepared shapes.
    store
        Store of the forms.
    spec
        The method.
    seed
        Base seed.
    models
        Trained model of each shape, by identifier; empty if the method does not learn.
    scorer_spec
        Scorer that compares the forms.
    """

    preparation: Preparation
    store: Store
    spec: MethodSpec
    seed: int = 0
    models: Mapping[str, Model] = field(default_factory=dict)
    scorer_spec: ScorerSpec = field(default_factory=ScorerSpec)
    _loaded: dict[Path, Method] = field(default_factory=dict, repr=False)

    @cached_property
    def method(self) -> Method | Descriptor:
        """The method; without a model if it is learned."""
        return self._metered(self.spec.create())

    @cached_property
    def scorer(self) -> Scorer:
        """The scorer."""
        return self._metered(self.scorer_spec.create())

    def _metered(self, plugin: T) -> T:
        """Let a method or scorer in a separate process report its costs."""
        return replace(plugin, book=self.store.meter.replace) if isinstance(plugin, Foreign) else plugin

    @property
    def describes(self) -> bool:
        """Whether the method returns descriptors instead of forms."""
        return not isinstance(self.method, Method)

    def recipe(self, entry: Entry) -> Recipe:
        """Return the recipe of the form or the descriptor."""
        model = self.models.get(entry.identifier)
        shape = self.preparation.recipe(entry)
        return recipes.form_recipe(self.spec, shape, entry.identifier, self.seed, model.digest if model else "")

    def treat(self, entry: Entry) -> ShapeResult:
        """Compute or read everything that ranking needs from a shape; raise ``ShapeError`` if the shape is refused."""
        prepared = self.preparation.artefact(entry)
        surface = require_arrays(prepared)
        answer = self.answer(entry)
        arrays = require_arrays(answer)
        if self.describes:
            return ShapeResult(prepared, answer)
        shape = shapes.form_mesh(arrays, Mesh(surface["vertices"], surface["faces"]))
        stays = self.preparation.dataset.observe is not None  # 'retrieve' needs those of frames
        return ShapeResult(prepared, answer, self.signature(entry, lambda: shape, stays=stays))

    def result(self, entry: Entry, *, signed: bool) -> ShapeResult:
        """Return the same as :meth:`treat`, but read no large arrays except descriptors.

        Parameters
        ----------
        entry
            The shape.
        signed
            Whether to compute its signature.
        """
        prepared = self.store.find(self.preparation.recipe(entry), wanted=_is_small)
        answer = self.store.find(self.recipe(entry), wanted=None if self.describes else _is_small)
        signature = self.store.find(self._signature_recipe(entry), wanted=_is_small) if signed else None
        if prepared is None or answer is None or (signed and signature is None):
            treated = self.treat(entry)
            return treated if self.describes else ShapeResult(*map(_without_large_arrays, treated.artefacts))
        result = ShapeResult(prepared, answer, signature)
        for artefact in result.artefacts:
            require_arrays(artefact)
        return result

    def signature(self, entry: Entry, shape: Callable[[], Mesh], *, stays: bool) -> Artefact:
        """Compute or read the signature of a form; raise ``ShapeError`` if it has none."""
        scorer = self.scorer
        signature = self.store.get_or_compute(
            self._signature_recipe(entry),
            lambda: attempted(lambda: signature_of(scorer, shape()), scorer),
            work="features",
            scratch=not stays,
        )
        require_arrays(signature)
        return signature

    def signature_arrays(self, entry: Entry, *, in_gallery_order: bool = False) -> Arrays:
        """Read the signature of a form, or recompute it if it is missing, unless this shows a plugin the order."""
        signature = self.store.find(self._signature_recipe(entry))
        if signature is None and in_gallery_order and (self.spec.is_foreign or self.scorer_spec.is_foreign):
            raise StorageError("a file that the plugin read changed while its forms were compared", "run again")
        signature = signature or self.treat(entry).signature
        assert signature is not None  # noqa: S101
        return require_arrays(signature)

    def _signature_recipe(self, entry: Entry) -> Recipe:
        return recipes.features_recipe(self.recipe(entry), self.scorer_spec)

    def stored_form(self, entry: Entry) -> Mesh | None:
        """Return the canonical form of a shape if it is stored; raise ``ShapeError`` if the shape was refused."""
        answer = self.store.find(self.recipe(entry))
        return None if answer is None else self.form_from(require_arrays(answer), entry)

    def form_from(self, answer: Arrays, entry: Entry) -> Mesh:
        """Return the canonical form of a shape from its stored arrays."""
        return shapes.form_mesh(answer, self.preparation.shape(entry, self.seed).mesh)

    def seen(self, entries: Iterable[Entry]) -> list[str]:
        """Return the shapes whose model was trained on them or on their subject."""
        dataset = self.preparation.dataset.name
        pairs = [(entry, self.models.get(entry.identifier)) for entry in entries]
        return [entry.identifier for entry, model in pairs if model and model.has_seen(entry, dataset)]

    def answer(self, entry: Entry) -> Artefact:
        """Compute or read the form or descriptor of a shape, or the reason for refusal; see :func:`require_arrays`."""
        method = self.method_for(entry)

        def once() -> Arrays:
            shape = self.preparation.shape(entry, self.seed)
            return shapes.canonicalise(method, shape) if isinstance(method, Method) else shapes.describe(method, shape)

        def compute() -> Arrays:
            arrays = once()
            if self.spec.is_foreign and entry == self.preparation.dataset.shapes[0]:
                return {**arrays, **_difference_of_runs(arrays, once())}
            return arrays

        return self.store.get_or_compute(
            self.recipe(entry),
            lambda: attempted(compute, method),
            work=f"canonicalise {self.preparation.input} {self.spec.base_name}",
        )

    def method_for(self, entry: Entry) -> Method | Descriptor:
        """Return the method for a shape, with its model; each model is loaded once."""
        model = self.models.get(entry.identifier)
        method: Any = self.method
        if model is None:
            return self.method
        if model.folder not in self._loaded:
            self._loaded[model.folder] = method.load(model.folder)
        return self._loaded[model.folder]


def _difference_of_runs(first: Arrays, second: Arrays) -> Arrays:
    """Return a note on the difference of two runs on a shape, relative to the largest value; empty if they agree."""
    (name,) = {"vertices", "descriptor"} & first.keys()
    one, other = first[name], second[name]
    if one.shape != other.shape:
        return {RUNS_DIFFER: np.array(1.0)}
    difference = float(np.abs(one - other).max() / (np.abs(one).max() or 1.0))
    return {RUNS_DIFFER: np.array(difference)} if difference > _ROUNDING else {}


def _is_small(name: str) -> bool:
    return name.startswith(_NOTE) or name == REFUSED


def _without_large_arrays(artefact: Artefact) -> Artefact:
    return replace(artefact, arrays={name: array for name, array in artefact.arrays.items() if _is_small(name)})
