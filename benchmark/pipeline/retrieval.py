"""The shapes of a gallery that was run which are nearest to a new one: its forms and signatures are read."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Descriptor, Input, Mesh, Method, Shape
from benchmark.api.learning import Learner
from benchmark.datasets.base import Dataset, Entry
from benchmark.depth.frame import FrameFiles
from benchmark.depth.projection import HALF_WIDTH, UPRIGHT
from benchmark.depth.reading import READERS
from benchmark.errors import ConfigurationError
from benchmark.geometry.camera import FRONT
from benchmark.geometry.io import read_mesh
from benchmark.pipeline.preparation import Preparation, attempted, require_arrays, shape_of
from benchmark.pipeline.recipes import Recipe, draws_of, features_recipe, form_recipe
from benchmark.pipeline.stages import form
from benchmark.pipeline.stages.complete import complete
from benchmark.pipeline.stages.view import seen
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.output_checks import REFUSED, distances_of, form_distances, signature_of
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.scorers import ScorerSpec
from benchmark.protocols.models import Model

__all__ = ["Found", "GallerySearch", "Hit", "input_for"]

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Hit:
    """A shape of the gallery.

    Parameters
    ----------
    entry
        The shape.
    distance
        From the query, mean over the draws of the scorer.
    """

    entry: Entry
    distance: float


@dataclass(frozen=True, eq=False)
class Found:
    """Result of a search.

    Parameters
    ----------
    hits
        All shapes of the gallery with a form but the query itself, the nearest first.
    query
        What the method was given.
    form
        Canonical form of the query; None for a descriptor.
    read, made
        Signatures of the gallery that were read, and that had to be made from its forms.
    """

    hits: tuple[Hit, ...]
    query: Shape
    form: Mesh | None
    read: int
    made: int

    @property
    def margin(self) -> float:
        """By how much the first class is nearer than the second, as a share of the distance of the second."""
        first = self.hits[0]
        other = next((hit for hit in self.hits if hit.entry.subject != first.entry.subject), None)
        return 0.0 if other is None or not other.distance > 0 else 1 - first.distance / other.distance


def input_for(query: Path, dataset: Dataset, spec: MethodSpec) -> Input:
    """Return the input under which a query meets a gallery: a view where either is a depth image, or the method's only.

    Raises
    ------
    ConfigurationError
        If the method does not take it.
    """
    is_view = query.suffix.lower() in READERS or "mesh" not in getattr(dataset, "inputs", ("mesh",))
    input_: Input = "view" if is_view or "mesh" not in spec.info.inputs else "mesh"
    if input_ not in spec.info.inputs:
        raise ConfigurationError(
            f"method '{spec.name}' reads complete surfaces, and {query} meets views", "choose a method that reads views"
        )
    return input_


@dataclass(frozen=True, eq=False)
class GallerySearch:
    """A gallery that was run by one method under one input.

    Parameters
    ----------
    dataset, input, spec, scorer
        Which shapes, seen how, treated by which method, and compared by what.
    store
        Where its forms are.
    models
        Trained model of each shape by identifier; empty for a method that does not learn.
    seed
        Base seed.
    source
        What the data set is called on the command line; "" for its name.
    """

    dataset: Dataset
    input: Input
    spec: MethodSpec
    scorer: ScorerSpec
    store: Store
    models: Mapping[str, Model] = field(default_factory=dict)
    seed: int = 0
    source: str = ""

    def search(self, query: Path, frame: Callable[[Path], FrameFiles] = FrameFiles) -> Found:
        """Return the shapes in the order of their distance from a depth image or a mesh.

        Parameters
        ----------
        query
            The file.
        frame
            Says how a depth image is read.

        Raises
        ------
        ConfigurationError
            If no form of the gallery is here.
        ShapeError
            If the query cannot be treated.
        """
        method = self.spec.create()
        shape = self._shape(query, frame)
        model = next(iter(self.models.values()), None)
        loaded = method.load(model.folder) if model and isinstance(method, Learner) else method
        entries, signatures, n_read, n_made = self._signatures(method, query)
        if not isinstance(method, Method):
            vectors = [each["descriptor"] for each in (*signatures, form.describe(loaded, shape))]  # type: ignore[arg-type]
            rows = distances_of(loaded, vectors)[-1, :-1]  # type: ignore[arg-type]
            return Found(_ordered(entries, rows), shape, None, n_read, n_made)
        made = form.form_mesh(form.canonicalise(loaded, shape), shape.mesh)  # type: ignore[arg-type]
        scorer = self.scorer.create()
        all_signatures = [*signatures, signature_of(scorer, made)]
        matrices = [form_distances(scorer, all_signatures, draw or 0) for draw in draws_of(self.spec, self.scorer)]
        return Found(_ordered(entries, np.mean(matrices, axis=0)[-1, :-1]), shape, made, n_read, n_made)

    def form(self, entry: Entry) -> Mesh | None:
        """Return the canonical form of a shape of the gallery; None where it is not kept, or there is none."""
        found, prepared = self.store.find(self._recipe(entry)), self.store.find(self._preparation.recipe(entry))
        if found is None or prepared is None or "vertices" not in found.arrays or REFUSED in prepared.arrays:
            return None
        return form.form_mesh(found.arrays, Mesh(prepared.arrays["vertices"], prepared.arrays["faces"]))

    @property
    def _preparation(self) -> Preparation:
        return Preparation(self.dataset, self.input, self.store)

    def _recipe(self, entry: Entry, preparation: Preparation | None = None) -> Recipe:
        model = self.models.get(entry.identifier)
        shape = (preparation or self._preparation).recipe(entry)
        return form_recipe(self.spec, shape, entry.identifier, self.seed, model.digest if model else "")

    def _shape(self, query: Path, frame: Callable[[Path], FrameFiles]) -> Shape:
        """The query as the method is given it, in the frame of the gallery."""
        if query.suffix.lower() in READERS:
            observed = frame(query).observe()
            arrays = seen(observed.surface, UPRIGHT, getattr(self.dataset, "half_width", None) or HALF_WIDTH)
        elif self.input == "mesh":
            arrays = complete(read_mesh(query))
        else:
            arrays = seen(read_mesh(query), FRONT, self._preparation.half_width)
        return shape_of(arrays, query.stem, self.seed)

    def _signatures(self, method: Method | Descriptor, query: Path) -> tuple[list[Entry], list[Arrays], int, int]:
        """Shapes that have a form, their signatures, and how many of these were read and made."""
        entries, signatures, n_made = [], [], 0
        for entry, arrays, was_read in self._answered(method, query):
            entries.append(entry)
            signatures.append(arrays)
            n_made += not was_read
        if not entries:
            words = ["run", "-m", self.spec.name, "-d", self.source or self.dataset.name, "--input", self.input]
            raise ConfigurationError(
                f"no form of '{self.dataset.name}' by '{self.spec.name}' under the {self.input} input is kept here, "
                "as this code makes it",
                f"run `python -m benchmark {shlex.join(words)}`",
            )
        return entries, signatures, len(entries) - n_made, n_made

    def _answered(self, method: Method | Descriptor, query: Path) -> Iterator[tuple[Entry, Arrays, bool]]:
        """Yield the shapes with a form, or a descriptor, that is kept; a signature that is made stays for the next."""
        preparation, scorer = self._preparation, self.scorer.create()
        for entry in self.dataset.entries:
            if _is_file(entry, query):
                continue
            recipe = self._recipe(entry, preparation)
            answer = self.store.find(recipe)
            if answer is None or REFUSED in answer.arrays:
                continue
            if not isinstance(method, Method):
                yield entry, answer.arrays, True
                continue
            wanted = features_recipe(recipe, self.scorer)
            kept = self.store.find_anywhere(wanted)
            if kept is None:
                made = form.form_mesh(answer.arrays, preparation.shape(entry, self.seed).mesh)
                signed = partial(attempted, partial(signature_of, scorer, made))
                kept = self.store.get_or_compute(wanted, signed, work="features")
            if REFUSED not in kept.arrays:
                yield entry, require_arrays(kept), kept.was_cached


def _is_file(entry: Entry, query: Path) -> bool:
    return entry.path is not None and entry.path.exists() and entry.path.samefile(query)


def _ordered(entries: Sequence[Entry], found: NDArray[np.float64]) -> tuple[Hit, ...]:
    return tuple(Hit(entries[place], float(found[place])) for place in np.argsort(found, kind="stable"))
