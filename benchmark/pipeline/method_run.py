"""One method at work on the shapes of a data set: forms and their features, or descriptors, kept by their recipes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from benchmark.api.contracts import Descriptor, Mesh, Method
from benchmark.api.scoring import Scorer
from benchmark.datasets.base import Entry
from benchmark.datasets.depth_folder import DepthFolder
from benchmark.execution.processes.opened_files import with_files
from benchmark.pipeline.preparation import Arrays, Preparation, attempted, notes, require_arrays
from benchmark.pipeline.recipes import Recipe, features_recipe, form_recipe
from benchmark.pipeline.stages import form
from benchmark.pipeline.storage.store import Artefact, Store
from benchmark.plugins.output_checks import REFUSED, signature_of
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.remote import Foreign
from benchmark.plugins.scorers import ScorerSpec
from benchmark.protocols.models import Model

T = TypeVar("T")

#: Note of a form of a plugin that came out otherwise when it was made again.
RUNS_DIFFER = "note:runs_differ"

#: Largest difference of two runs, relative to the largest number, that single precision explains.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class ShapeResult:
    """Result of a method for one shape.

    Parameters
    ----------
    prepared, answer, features
        Artefacts of the shape, of the form or descriptor, and of the features; None without such a stage.
    notes
        What preparation and method noted.
    """

    prepared: Artefact
    answer: Artefact
    features: Artefact | None
    notes: Mapping[str, float | str]


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
        return self._told_of(self.spec.create())

    @cached_property
    def scorer(self) -> Scorer:
        """The scorer itself."""
        return self._told_of(self.scorer_spec.create())

    def _told_of(self, made: T) -> T:
        """Let what works in a process of its own say what its work costs."""
        return replace(made, book=self.store.meter.replace) if isinstance(made, Foreign) else made

    @property
    def describes(self) -> bool:
        """Return whether shapes are described without a form."""
        return not isinstance(self.method, Method)

    def treat(self, entry: Entry) -> ShapeResult:
        """Make, or find, all that ranking needs of a shape.

        Raises
        ------
        ShapeError
            If the shape cannot be treated.
        """
        prepared = self.preparation.artefact(entry)
        arrays = require_arrays(prepared)
        answer = self.answer(entry)
        said = {**notes(arrays), **notes(require_arrays(answer))}
        if self.describes:
            return ShapeResult(prepared, answer, None, said)
        shape = form.form_mesh(answer.arrays, Mesh(arrays["vertices"], arrays["faces"]))
        stays = isinstance(self.preparation.dataset, DepthFolder)  # 'retrieve' asks for those of frames
        return ShapeResult(prepared, answer, self.signature(entry, lambda: shape, stays=stays), said)

    def signature(self, entry: Entry, shape: Callable[[], Mesh], *, stays: bool) -> Artefact:
        """Make, or find, the signature of a form; raises ``ShapeError`` if it has none."""
        recipe, scorer = features_recipe(self.recipe(entry), self.scorer_spec), self.scorer
        signature = self.store.find_anywhere(recipe) or self.store.get_or_compute(
            recipe,
            lambda: with_files(attempted(lambda: signature_of(scorer, shape())), files_of(scorer)),
            work="features",
            scratch=not stays,
        )
        require_arrays(signature)
        return signature

    def found(self, entry: Entry) -> ShapeResult:
        """The same as :meth:`treat` without a signature, reading no more than ranking needs of what is there already.

        Raises
        ------
        ShapeError
            If the shape cannot be treated.
        """
        prepared = self.store.find(self.preparation.recipe(entry), wanted=_is_small)
        answer = self.store.find(self.recipe(entry), wanted=None if self.describes else _is_small)
        if prepared is None or answer is None:
            return self.treat(entry)
        return ShapeResult(prepared, answer, None, {**notes(require_arrays(prepared)), **notes(require_arrays(answer))})

    def with_signature(self, entry: Entry, found: ShapeResult) -> ShapeResult:
        """Return what was found of a shape with the signature of its form; raises ``ShapeError`` if it has none."""
        if found.features is not None:
            return found
        recipe = features_recipe(self.recipe(entry), self.scorer_spec)
        signature = self.store.find_anywhere(recipe)
        if signature is None:
            return self.treat(entry)
        require_arrays(signature)
        return replace(found, features=signature)

    def found_form(self, entry: Entry) -> Mesh | None:
        """Canonical form of a shape if it has been made; raises ``ShapeError`` if the shape cannot be treated."""
        found = self.store.find(self.recipe(entry))
        return None if found is None else self.form_from(require_arrays(found), entry)

    def form_from(self, answer: Arrays, entry: Entry) -> Mesh:
        """Canonical form of a shape from the arrays that are kept of it."""
        return form.form_mesh(answer, self.preparation.shape(entry, self.seed).mesh)

    def recipe(self, entry: Entry) -> Recipe:
        """Return what determines the form or the descriptor."""
        model = self.models.get(entry.identifier)
        return form_recipe(
            self.spec,
            self.preparation.recipe(entry),
            entry.identifier,
            self.seed,
            model.digest if model else "",
        )

    def seen(self, entries: Iterable[Entry], dataset: str) -> list[str]:
        """Shapes that their model was trained on, or whose subject was."""
        return [
            entry.identifier
            for entry in entries
            if (model := self.models.get(entry.identifier)) and model.has_seen(entry, dataset)
        ]

    def answer(self, entry: Entry) -> Artefact:
        """Make, or find, the form or the descriptor of a shape, or why there is none; see :func:`require_arrays`."""

        def once() -> Arrays:
            shape = self.preparation.shape(entry, self.seed)
            if isinstance(method, Method):
                return form.canonicalise(method, shape)
            return form.describe(method, shape)

        def compute() -> Arrays:
            arrays = once()
            if self.spec.is_foreign and entry == self.preparation.dataset.entries[0]:
                return {**arrays, **difference_of_runs(arrays, once())}
            return arrays

        method, work = self.method_for(entry), f"canonicalise {self.preparation.input} {self.spec.base_name}"
        compute_kept = lambda: with_files(attempted(compute), files_of(method))  # noqa: E731
        return self.store.get_or_compute(self.recipe(entry), compute_kept, work=work)

    def method_for(self, entry: Entry) -> Method | Descriptor:
        """The method that treats a shape; each model is loaded once."""
        model = self.models.get(entry.identifier)
        method: Any = self.method
        if model is None:
            return self.method
        if model.folder not in self._loaded:
            self._loaded[model.folder] = method.load(model.folder)
        return self._loaded[model.folder]


def difference_of_runs(first: Arrays, again: Arrays) -> Arrays:
    """Return a note of how far two runs on one shape differ, relative to the largest number; none if they do not."""
    (name,) = {"vertices", "descriptor"} & first.keys()
    one, other = first[name], again[name]
    if one.shape != other.shape:
        return {RUNS_DIFFER: np.array(1.0)}
    difference = float(np.abs(one - other).max() / (np.abs(one).max() or 1.0))
    return {RUNS_DIFFER: np.array(difference)} if difference > _ROUNDING else {}


def _is_small(name: str) -> bool:
    """Return whether an array tells about a stage, rather than being its result."""
    return name.startswith("note:") or name == REFUSED


def files_of(plugin: object) -> dict[str, str]:
    """Files that foreign code has read, with their digests."""
    return plugin.files if isinstance(plugin, Foreign) else {}


def features_of(found: ShapeResult) -> Arrays:
    """Signature of a form that was treated; raises ``ValueError`` for a descriptor."""
    if found.features is None:
        raise ValueError("a descriptor has no signature")
    return found.features.arrays
