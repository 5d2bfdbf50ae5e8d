"""The stages of each shape, kept by their recipes: prepared, its form or descriptor, and the signature of its form."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from benchmark.api.contracts import Descriptor, Input, Mesh, Method, Shape
from benchmark.api.scoring import Scorer
from benchmark.arrays import Arrays
from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.changed import ChangedDataset
from benchmark.datasets.depth_folder import DepthFolder
from benchmark.datasets.own import OwnDataset
from benchmark.errors import ShapeError, UnsupportedShape
from benchmark.execution.processes.opened_files import with_files
from benchmark.pipeline import recipes
from benchmark.pipeline.recipes import Recipe
from benchmark.pipeline.stages import form
from benchmark.pipeline.stages.complete import complete
from benchmark.pipeline.stages.view import frame_of, half_width_of, seen
from benchmark.pipeline.storage.costs import Cost, Meter
from benchmark.pipeline.storage.environment import environment_text
from benchmark.pipeline.storage.lock import key_of
from benchmark.pipeline.storage.store import Artefact, Store
from benchmark.plugins.output_checks import REFUSED, signature_of
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.remote import Foreign
from benchmark.plugins.scorers import ScorerSpec
from benchmark.plugins.serving import SharedStages
from benchmark.protocols.models import Model


class Preparation:
    """Prepared shapes of one data set under one input.

    Parameters
    ----------
    dataset
        Source of the meshes.
    input_
        ``"mesh"`` for the complete surface, ``"view"`` for what the depth camera sees.
    store
        Where shapes are kept; None keeps nothing.
    """

    def __init__(self, dataset: Dataset, input_: Input, store: Store | None = None) -> None:
        self.dataset = dataset
        self.input = input_
        self.store = store
        self._meter = store.meter if store else Meter()
        self._latest: tuple[str, int, Shape] | None = None
        self._recipes: dict[str, Recipe] = {}

    def shape(self, entry: Entry, seed: int = 0) -> Shape:
        """Prepare a shape; the latest one is kept with its geodesics, so that all methods of a shape share them.

        Raises
        ------
        ShapeError
            If it cannot be read or treated.
        """
        if self._latest is None or self._latest[:2] != (entry.identifier, seed):
            arrays = require_arrays(self.artefact(entry))
            shape = shape_of(arrays, entry.identifier, seed, SharedStages(self._meter))
            self._latest = (entry.identifier, seed, shape)
        return self._latest[2]

    def artefact(self, entry: Entry) -> Artefact:
        """The arrays of a prepared shape, or why there are none; see :func:`require_arrays`."""
        source = recipes.original_of(self.dataset)
        return self._stored(
            self.recipe(entry), lambda: attempted(lambda: self._compute(entry), source), f"prepare {self.input}"
        )

    def recipe(self, entry: Entry) -> Recipe:
        """Return what determines the prepared shape."""
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
        """Name of the artefact that holds a frame fitted to the data set; "" where there is none."""
        return key_of(self._frame) if self.input == "view" and self.dataset.half_width is None else ""

    def mesh(self, entry: Entry) -> Mesh:
        """The mesh of the data set; generated ones are kept for the while of a run, for some take seconds to make."""
        if isinstance(self.dataset, ChangedDataset):  # what is changed is quickly changed anew
            clean = Preparation(self.dataset.clean, self.input, self.store)
            return self.dataset.changed(clean.mesh(self.dataset.clean_entry(entry)), entry)
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
            return complete(self.mesh(entry))
        if isinstance(self.dataset, DepthFolder):
            frame = self.dataset.observed(entry)
            source, frame_notes = frame.surface, frame.notes
        else:
            source, frame_notes = self.mesh(entry), {}
        view = seen(source, self.dataset.camera(entry), self.half_width, recipes.sensor_of(self.dataset, entry))
        return {**view, **{f"note:{name}": np.asarray(note) for name, note in frame_notes.items()}}

    @cached_property
    def _frame(self) -> Recipe:
        return recipes.frame_recipe(self.dataset)

    def _fit_frame(self) -> Arrays:
        widths = []
        for entry in self.dataset.entries:
            with suppress(ShapeError):  # this shape is counted as unsupported when its turn comes
                widths.append(half_width_of(self.mesh(entry), self.dataset.camera(entry)))
        return {"half_width": np.asarray(frame_of(widths))}

    def _stored(self, recipe: Recipe, compute: Callable[[], Arrays], work: str, *, scratch: bool = False) -> Artefact:
        if self.store is not None:
            return self.store.get_or_compute(recipe, compute, work=work, scratch=scratch)
        return Artefact("", compute(), Cost(), environment_text(), was_cached=False)


def files_of(part: object) -> dict[str, str]:
    """Files that a data set, method or scorer of a plugin has read, with their digests."""
    return part.files if isinstance(part, OwnDataset | Foreign) else {}


def shape_of(arrays: Arrays, identifier: str, seed: int = 0, cache: SharedStages | None = None) -> Shape:
    """The shape that methods are given, from the arrays of its preparation."""
    return Shape(
        identifier=identifier,
        mesh=Mesh(arrays["vertices"], arrays["faces"]),
        depth=arrays.get("depth"),
        source_area=float(arrays["source_area"]),
        seed=seed,
        cache=cache,
    )


def attempted(compute: Callable[[], Arrays], by: object = None) -> Arrays:
    """Arrays of a stage, with the files that a plugin read for them; of a refused shape the reason, which stays."""
    try:
        arrays = compute()
    except ShapeError as error:
        arrays = {REFUSED: np.array([error.problem, error.hint, type(error).__name__])}
    return with_files(arrays, files_of(by))


def require_arrays(artefact: Artefact) -> Arrays:
    """Arrays of a stage that was attempted; raises ``UnsupportedShape`` with the reason where there are none."""
    if REFUSED in artefact.arrays:
        problem, hint = artefact.arrays[REFUSED].tolist()[:2]
        raise UnsupportedShape(problem, hint)
    return artefact.arrays


T = TypeVar("T")

#: Begins the names of arrays that note something about a shape.
_NOTE = "note:"

#: Note of a form of a plugin that came out otherwise when it was made again.
RUNS_DIFFER = f"{_NOTE}runs_differ"

#: Largest difference of two runs, relative to the largest number, that single precision explains.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class ShapeResult:
    """What a method made of one shape.

    Parameters
    ----------
    prepared, answer, signature
        Artefacts of the shape, of the form or descriptor, and of the signature of the form; None without one.
    """

    prepared: Artefact
    answer: Artefact
    signature: Artefact | None = None

    @property
    def artefacts(self) -> list[Artefact]:
        """All of them."""
        return [self.prepared, self.answer, *([self.signature] if self.signature else [])]

    @property
    def notes(self) -> dict[str, float | str]:
        """What preparation and method noted."""
        arrays = {**self.prepared.arrays, **self.answer.arrays}
        return {name.removeprefix(_NOTE): note.item() for name, note in arrays.items() if name.startswith(_NOTE)}


@dataclass
class MethodRun:
    """A method with its parameters, seed and models, and the prepared shapes that it treats.

    Parameters
    ----------
    preparation
        The shapes.
    store
        Where forms are kept.
    spec
        The method.
    seed
        Base seed.
    models
        Trained model of each shape by identifier; empty for a method that does not learn.
    scorer_spec
        What compares the forms.
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
        """The method itself; a learner without its model."""
        return self._metered(self.spec.create())

    @cached_property
    def scorer(self) -> Scorer:
        """The scorer itself."""
        return self._metered(self.scorer_spec.create())

    def _metered(self, plugin: T) -> T:
        """Let what works in a process of its own report what its work costs."""
        return replace(plugin, book=self.store.meter.replace) if isinstance(plugin, Foreign) else plugin

    @property
    def describes(self) -> bool:
        """Return whether shapes are described without a form."""
        return not isinstance(self.method, Method)

    def recipe(self, entry: Entry) -> Recipe:
        """Return what determines the form or the descriptor."""
        model = self.models.get(entry.identifier)
        shape = self.preparation.recipe(entry)
        return recipes.form_recipe(self.spec, shape, entry.identifier, self.seed, model.digest if model else "")

    def treat(self, entry: Entry) -> ShapeResult:
        """Make, or find, all that ranking needs of a shape; raises ``ShapeError`` if it cannot be treated."""
        prepared = self.preparation.artefact(entry)
        surface = require_arrays(prepared)
        answer = self.answer(entry)
        arrays = require_arrays(answer)
        if self.describes:
            return ShapeResult(prepared, answer)
        shape = form.form_mesh(arrays, Mesh(surface["vertices"], surface["faces"]))
        stays = isinstance(self.preparation.dataset, DepthFolder)  # 'retrieve' asks for those of frames
        return ShapeResult(prepared, answer, self.signature(entry, lambda: shape, stays=stays))

    def result(self, entry: Entry, *, signed: bool) -> ShapeResult:
        """The same as :meth:`treat`, of which nothing large is read but descriptors.

        Parameters
        ----------
        entry
            The shape.
        signed
            Whether it is to have a signature.
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
        """Make, or find, the signature of a form; raises ``ShapeError`` if it has none."""
        scorer = self.scorer
        signature = self.store.get_or_compute(
            self._signature_recipe(entry),
            lambda: attempted(lambda: signature_of(scorer, shape()), scorer),
            work="features",
            scratch=not stays,
        )
        require_arrays(signature)
        return signature

    def signature_arrays(self, entry: Entry) -> Arrays:
        """Read the signature of a form, or make it again where it is gone."""
        signature = self.store.find(self._signature_recipe(entry)) or self.treat(entry).signature
        assert signature is not None  # noqa: S101
        return require_arrays(signature)

    def _signature_recipe(self, entry: Entry) -> Recipe:
        return recipes.features_recipe(self.recipe(entry), self.scorer_spec)

    def found_form(self, entry: Entry) -> Mesh | None:
        """Canonical form of a shape if it has been made; raises ``ShapeError`` if the shape cannot be treated."""
        answer = self.store.find(self.recipe(entry))
        return None if answer is None else self.form_from(require_arrays(answer), entry)

    def form_from(self, answer: Arrays, entry: Entry) -> Mesh:
        """Canonical form of a shape from the arrays that are kept of it."""
        return form.form_mesh(answer, self.preparation.shape(entry, self.seed).mesh)

    def seen(self, entries: Iterable[Entry]) -> list[str]:
        """Shapes that their model was trained on, or whose subject was."""
        dataset = self.preparation.dataset.name
        pairs = [(entry, self.models.get(entry.identifier)) for entry in entries]
        return [entry.identifier for entry, model in pairs if model and model.has_seen(entry, dataset)]

    def answer(self, entry: Entry) -> Artefact:
        """Make, or find, the form or the descriptor of a shape, or why there is none; see :func:`require_arrays`."""
        method = self.method_for(entry)

        def once() -> Arrays:
            shape = self.preparation.shape(entry, self.seed)
            return form.canonicalise(method, shape) if isinstance(method, Method) else form.describe(method, shape)

        def compute() -> Arrays:
            arrays = once()
            if self.spec.is_foreign and entry == self.preparation.dataset.entries[0]:
                return {**arrays, **_difference_of_runs(arrays, once())}
            return arrays

        return self.store.get_or_compute(
            self.recipe(entry),
            lambda: attempted(compute, method),
            work=f"canonicalise {self.preparation.input} {self.spec.base_name}",
        )

    def method_for(self, entry: Entry) -> Method | Descriptor:
        """The method that treats a shape; each model is loaded once."""
        model = self.models.get(entry.identifier)
        method: Any = self.method
        if model is None:
            return self.method
        if model.folder not in self._loaded:
            self._loaded[model.folder] = method.load(model.folder)
        return self._loaded[model.folder]


def _difference_of_runs(first: Arrays, again: Arrays) -> Arrays:
    """Return a note of how far two runs on one shape differ, relative to the largest number; none if they do not."""
    (name,) = {"vertices", "descriptor"} & first.keys()
    one, other = first[name], again[name]
    if one.shape != other.shape:
        return {RUNS_DIFFER: np.array(1.0)}
    difference = float(np.abs(one - other).max() / (np.abs(one).max() or 1.0))
    return {RUNS_DIFFER: np.array(difference)} if difference > _ROUNDING else {}


def _is_small(name: str) -> bool:
    return name.startswith(_NOTE) or name == REFUSED


def _without_large_arrays(artefact: Artefact) -> Artefact:
    return replace(artefact, arrays={name: array for name, array in artefact.arrays.items() if _is_small(name)})
