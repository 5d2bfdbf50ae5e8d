"""Retrieve the shapes of a finished gallery nearest to a new shape, from stored forms and signatures."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Input, Mesh, Shape
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.arrays import Arrays
from benchmark.depth.frame import HALF_WIDTH, UPRIGHT, FrameFiles
from benchmark.depth.reading import EXTENSIONS
from benchmark.errors import ConfigurationError, ShapeError
from benchmark.geometry.camera import FRONT
from benchmark.geometry.io import read_mesh
from benchmark.pipeline.method_run import MethodRun, in_random_order, require_arrays, shape_of
from benchmark.pipeline.recipes import draws_of
from benchmark.pipeline.stages.shapes import canonicalise, complete, describe, form_mesh, seen
from benchmark.pipeline.storage.store import Artefact
from benchmark.plugins.output_checks import distances_of, form_distances, signature_of
from benchmark.plugins.registry import MethodSpec


@dataclass(frozen=True)
class Hit:
    """A retrieved shape.

    Parameters
    ----------
    entry
        The shape.
    distance
        Distance from the query: the mean over the draws of the scorer.
    """

    entry: Entry
    distance: float


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Result of a search.

    Parameters
    ----------
    hits
        All shapes of the gallery that have a form, without the query itself, nearest first.
    query
        The query as passed to the method.
    form
        Canonical form of the query; None for a descriptor.
    n_read, n_computed
        Number of gallery signatures that were read, and that were computed from forms.
    """

    hits: tuple[Hit, ...]
    query: Shape
    form: Mesh | None
    n_read: int
    n_computed: int

    @property
    def margin(self) -> float:
        """Margin between the nearest class and the second nearest, relative to the distance of the second."""
        first = self.hits[0]
        other = next((hit for hit in self.hits if hit.entry.subject != first.entry.subject), None)
        return 0.0 if other is None or not other.distance > 0 else 1 - first.distance / other.distance


def input_for(query: Path, dataset: ShapeSet, spec: MethodSpec) -> Input:
    """Return the input for a query and a gallery: a view if either is a depth image, or the method's only input.

    Raises
    ------
    ConfigurationError
        If the method does not accept it.
    """
    is_view = query.suffix.lower() in EXTENSIONS or "mesh" not in getattr(dataset, "inputs", ("mesh",))
    input_: Input = "view" if is_view or "mesh" not in spec.info.inputs else "mesh"
    if input_ not in spec.info.inputs:
        raise ConfigurationError(
            f"method '{spec.name}' needs complete surfaces, and {query} is compared with views",
            "choose a method that accepts views",
        )
    return input_


def search(run: MethodRun, query: Path, frame: FrameFiles | None, source: str) -> SearchResult:
    """Rank the shapes of a finished gallery by their distance from a depth image or a mesh.

    Parameters
    ----------
    run
        The method, the scorer, and the prepared gallery.
    query
        File of the query.
    frame
        Files and settings of the depth image; None for a mesh.
    source
        Name of the data set on the command line.

    Raises
    ------
    ConfigurationError
        If no form of the gallery is stored.
    ShapeError
        If the query is refused.
    """
    shape = _shape(run, query, frame)
    entries, signatures, n_read = _signatures(run, query)
    if not entries:
        words = ["run", "-m", run.spec.name, "-d", source, "--input", run.preparation.input]
        raise ConfigurationError(
            f"no form of '{run.preparation.dataset.name}' by '{run.spec.name}' under the {run.preparation.input} input "
            "by the current code is stored here",
            f"run `python -m benchmark {shlex.join(words)}`",
        )
    method: Any = run.method_for(entries[0])
    n_computed = len(entries) - n_read
    if run.describes:
        vectors = [arrays["descriptor"] for arrays in (*signatures, describe(method, shape))]
        return SearchResult(_ordered(entries, distances_of(method, vectors)[-1, :-1]), shape, None, n_read, n_computed)
    query_form = form_mesh(canonicalise(method, shape), shape.mesh)
    all_signatures = [*signatures, signature_of(run.scorer, query_form)]
    matrices = [form_distances(run.scorer, all_signatures, draw or 0) for draw in draws_of(run.spec, run.scorer_spec)]
    return SearchResult(_ordered(entries, np.mean(matrices, axis=0)[-1, :-1]), shape, query_form, n_read, n_computed)


def _shape(run: MethodRun, query: Path, frame: FrameFiles | None) -> Shape:
    """Return the query as passed to the method, in the frame of the gallery."""
    preparation = run.preparation
    if frame:
        width = getattr(preparation.dataset, "half_width", None) or HALF_WIDTH
        arrays = seen(frame.observe().surface, UPRIGHT, width)
    elif preparation.input == "mesh":
        arrays = complete(read_mesh(query))
    else:
        arrays = seen(read_mesh(query), FRONT, preparation.half_width)
    return shape_of(arrays, query.stem, run.seed)


def _signatures(run: MethodRun, query: Path) -> tuple[list[Entry], list[Arrays], int]:
    """Return the shapes that have a form, their signatures or descriptors, and how many of these were read.

    Computed signatures are stored for the next query.
    """

    def signature(entry: Entry) -> Artefact | None:
        answer = None if _is_file(entry, query) else run.store.find(run.recipe(entry))
        if answer is None:
            return None
        with suppress(ShapeError):
            form = partial(run.form_from, require_arrays(answer), entry)
            return answer if run.describes else run.signature(entry, form, stays=True)
        return None

    entries = run.preparation.dataset.shapes
    pairs = zip(entries, in_random_order(signature, entries), strict=True)
    known = [(entry, artefact) for entry, artefact in pairs if artefact]
    signatures = [artefact.arrays for _, artefact in known]
    return [entry for entry, _ in known], signatures, sum(artefact.was_cached for _, artefact in known)


def _is_file(entry: Entry, query: Path) -> bool:
    return entry.path is not None and entry.path.exists() and entry.path.samefile(query)


def _ordered(entries: Sequence[Entry], distances: NDArray[np.float64]) -> tuple[Hit, ...]:
    return tuple(Hit(entries[place], float(distances[place])) for place in np.argsort(distances, kind="stable"))
