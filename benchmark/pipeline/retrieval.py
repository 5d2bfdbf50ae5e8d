"""The shapes of a gallery that was run which are nearest to a new one: its forms and signatures are read."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Input, Mesh, Shape
from benchmark.datasets.base import Dataset, Entry
from benchmark.depth.frame import FrameFiles
from benchmark.depth.projection import HALF_WIDTH, UPRIGHT
from benchmark.depth.reading import READERS
from benchmark.errors import ConfigurationError, ShapeError
from benchmark.geometry.camera import FRONT
from benchmark.geometry.io import read_mesh
from benchmark.pipeline.method_run import MethodRun
from benchmark.pipeline.preparation import Arrays, Preparation, require_arrays, shape_of
from benchmark.pipeline.recipes import draws_of
from benchmark.pipeline.stages import form
from benchmark.pipeline.stages.complete import complete
from benchmark.pipeline.stages.view import seen
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.output_checks import distances_of, form_distances, signature_of
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.scorers import ScorerSpec
from benchmark.protocols.models import Model


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
        run = self._run
        shape = self._shape(query, frame)
        entries, signatures, n_read = self._signatures(query)
        method: Any = run.method_for(entries[0])
        n_made = len(entries) - n_read
        if self.spec.describes:
            vectors = [each["descriptor"] for each in (*signatures, form.describe(method, shape))]
            return Found(_ordered(entries, distances_of(method, vectors)[-1, :-1]), shape, None, n_read, n_made)
        made = form.form_mesh(form.canonicalise(method, shape), shape.mesh)
        all_signatures = [*signatures, signature_of(run.scorer, made)]
        matrices = [form_distances(run.scorer, all_signatures, draw or 0) for draw in draws_of(self.spec, self.scorer)]
        return Found(_ordered(entries, np.mean(matrices, axis=0)[-1, :-1]), shape, made, n_read, n_made)

    def form(self, entry: Entry) -> Mesh | None:
        """Return the canonical form of a shape of the gallery; None where it is not kept, or there is none."""
        with suppress(ShapeError):
            return None if self.spec.describes else self._run.found_form(entry)
        return None

    @cached_property
    def _run(self) -> MethodRun:
        preparation = Preparation(self.dataset, self.input, self.store)
        return MethodRun(preparation, self.store, self.spec, self.seed, self.models, self.scorer)

    def _shape(self, query: Path, frame: Callable[[Path], FrameFiles]) -> Shape:
        """The query as the method is given it, in the frame of the gallery."""
        if query.suffix.lower() in READERS:
            observed = frame(query).observe()
            arrays = seen(observed.surface, UPRIGHT, getattr(self.dataset, "half_width", None) or HALF_WIDTH)
        elif self.input == "mesh":
            arrays = complete(read_mesh(query))
        else:
            arrays = seen(read_mesh(query), FRONT, self._run.preparation.half_width)
        return shape_of(arrays, query.stem, self.seed)

    def _signatures(self, query: Path) -> tuple[list[Entry], list[Arrays], int]:
        """Shapes that have a form, their signatures or descriptors, and how many of these were read.

        A signature that is made stays for the next query.
        """
        run, entries, signatures, n_read = self._run, list[Entry](), list[Arrays](), 0
        for entry in self.dataset.entries:
            answer = None if _is_file(entry, query) else self.store.find(run.recipe(entry))
            if answer is None:
                continue
            with suppress(ShapeError):
                arrays = require_arrays(answer)
                if not self.spec.describes:
                    answer = run.signature(entry, partial(run.form_from, arrays, entry), stays=True)
                signatures.append(answer.arrays)
                entries.append(entry)
                n_read += answer.was_cached
        if not entries:
            words = ["run", "-m", self.spec.name, "-d", self.source or self.dataset.name, "--input", self.input]
            raise ConfigurationError(
                f"no form of '{self.dataset.name}' by '{self.spec.name}' under the {self.input} input is kept here, "
                "as this code makes it",
                f"run `python -m benchmark {shlex.join(words)}`",
            )
        return entries, signatures, n_read


def _is_file(entry: Entry, query: Path) -> bool:
    return entry.path is not None and entry.path.exists() and entry.path.samefile(query)


def _ordered(entries: Sequence[Entry], found: NDArray[np.float64]) -> tuple[Hit, ...]:
    return tuple(Hit(entries[place], float(found[place])) for place in np.argsort(found, kind="stable"))
