"""From the entry of a data set to the shape that methods are given, kept by its recipe."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Input, Mesh, Shape
from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.changed import ChangedDataset
from benchmark.datasets.depth_folder import DepthFolder
from benchmark.datasets.own import OwnDataset
from benchmark.errors import ShapeError, UnsupportedShape
from benchmark.execution.processes.opened_files import with_files
from benchmark.pipeline.recipes import Recipe, frame_recipe, original_of, sensor_of, shape_recipe, source_recipe
from benchmark.pipeline.stages.complete import complete
from benchmark.pipeline.stages.view import frame_of, half_width_of, seen
from benchmark.pipeline.storage.costs import Cost, Meter
from benchmark.pipeline.storage.environment import environment_text
from benchmark.pipeline.storage.lock import key_of
from benchmark.pipeline.storage.store import Artefact, Store
from benchmark.plugins.output_checks import REFUSED
from benchmark.plugins.remote import Foreign
from benchmark.plugins.serving import SharedStages

Arrays = Mapping[str, NDArray[Any]]


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
        source = original_of(self.dataset)
        return self._kept(
            self.recipe(entry), lambda: attempted(lambda: self._compute(entry), source), f"prepare {self.input}"
        )

    def recipe(self, entry: Entry) -> Recipe:
        """Return what determines the prepared shape."""
        if entry.identifier not in self._recipes:
            frame = self._frame if self.input == "view" else {}
            self._recipes[entry.identifier] = shape_recipe(self.dataset, entry, self.input, frame)
        return self._recipes[entry.identifier]

    @cached_property
    def half_width(self) -> float:
        """Half the width of the camera's frame in file units, the same for all shapes of the data set."""
        if self.dataset.half_width is not None:
            return self.dataset.half_width
        return float(self._kept(self._frame, self._fit_frame, "frame").arrays["half_width"])

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

        recipe = source_recipe(self.dataset, entry)
        loaded = self._kept(recipe, lambda: attempted(compute), f"load {self.dataset.name}", scratch=True)
        return Mesh(require_arrays(loaded)["vertices"], loaded.arrays["faces"])

    def _compute(self, entry: Entry) -> Arrays:
        if self.input == "mesh":
            return complete(self.mesh(entry))
        if isinstance(self.dataset, DepthFolder):
            frame = self.dataset.observed(entry)
            source, frame_notes = frame.surface, frame.notes
        else:
            source, frame_notes = self.mesh(entry), {}
        view = seen(source, self.dataset.camera(entry), self.half_width, sensor_of(self.dataset, entry))
        return {**view, **{f"note:{name}": np.asarray(note) for name, note in frame_notes.items()}}

    @cached_property
    def _frame(self) -> Recipe:
        return frame_recipe(self.dataset)

    def _fit_frame(self) -> Arrays:
        widths = []
        for entry in self.dataset.entries:
            with suppress(ShapeError):  # this shape is counted as unsupported when its turn comes
                widths.append(half_width_of(self.mesh(entry), self.dataset.camera(entry)))
        return {"half_width": np.asarray(frame_of(widths))}

    def _kept(self, recipe: Recipe, compute: Callable[[], Arrays], work: str, *, scratch: bool = False) -> Artefact:
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
