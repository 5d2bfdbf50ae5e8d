"""The street that every shape walks: prepared shape -> canonical form -> features, each stage kept by its recipe.

A new method pays only for its own stages, and scores are made anew from stored features without running a method again.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.contracts import Input, Mesh, Shape
from benchmark.datasets.base import Dataset, Entry
from benchmark.errors import ShapeError
from benchmark.protocols.models import Maker
from benchmark.storage import keys
from benchmark.storage.store import Artefact, Store
from retrieval.cmbof import CMBOF, Features

Arrays = Mapping[str, NDArray[Any]]
Recipe = dict[str, Any]

#: The codebook is drawn at random, so scores are the mean over these seeds.
CODEBOOK_SEEDS = (0, 1, 2)

#: Vertices of the prepared mesh; customary for canonical forms (Lian et al. 2013, Pickup et al. 2018).
N_VERTICES = 2000

PREPARATION = "benchmark.geometry.preparation"
VIEW = "benchmark.geometry.depth"
GEODESICS = "benchmark.geometry.geodesics"
SCORER = "retrieval.cmbof"


@dataclass
class Clock:
    """Seconds spent per phase; what came from the store counts with the time that it originally took."""

    seconds: dict[str, float] = field(default_factory=dict)
    cached: dict[str, int] = field(default_factory=dict)

    def add(self, phase: str, artefact: Artefact) -> Arrays:
        """Book an artefact under a phase and hand on its arrays."""
        self.seconds[phase] = self.seconds.get(phase, 0.0) + artefact.seconds
        self.cached[phase] = self.cached.get(phase, 0) + artefact.was_cached
        return artefact.arrays


@dataclass(frozen=True)
class _ShapeCache:
    """What a :class:`Shape` keeps geodesics in."""

    store: Store
    shape: Recipe
    clock: Clock

    def get_or_compute(self, stage: str, parameters: Mapping[str, Any], compute: Callable[[], Arrays]) -> Arrays:
        recipe = {"stage": stage, "shape": self.shape, "parameters": parameters, "code": keys.code_digest(GEODESICS)}
        return self.clock.add(stage, self.store.get_or_compute(recipe, compute))


@dataclass
class Stages:
    """Stages of the shapes of one data set under one input.

    Parameters
    ----------
    store
        Where stages are kept.
    dataset
        Source of the meshes.
    input
        ``"mesh"`` for the complete surface, ``"view"`` for what the depth camera sees.
    seed
        Base seed of all methods.
    scorer
        Parameters of CM-BOF.
    """

    store: Store
    dataset: Dataset
    input: Input
    seed: int
    scorer: CMBOF
    clock: Clock = field(default_factory=Clock)

    def shape(self, entry: Entry) -> Shape:
        """Prepare a shape, or raise a ``ShapeError``."""
        recipe = self.shape_recipe(entry)
        compute = self._prepare_mesh if self.input == "mesh" else self._prepare_view
        arrays = self.clock.add("prepare", self.store.get_or_compute(recipe, lambda: compute(entry)))
        return Shape(
            identifier=entry.identifier,
            mesh=Mesh(arrays["vertices"], arrays["faces"]),
            depth=arrays.get("depth"),
            source_area=float(arrays["source_area"]),
            seed=self.seed,
            cache=_ShapeCache(self.store, recipe, self.clock),
        )

    def form(self, entry: Entry, maker: Maker) -> tuple[Mesh, dict[str, float | str]]:
        """Canonical form of a shape, and the notes of the method."""

        def compute() -> Arrays:
            form = maker.method_for(entry).canonicalise(self.shape(entry))
            mesh = form.mesh  # raises when the method returned NaN
            notes = {f"note:{name}": np.asarray(value) for name, value in form.notes.items()}
            return {"vertices": mesh.vertices, "faces": mesh.faces, **notes}

        arrays = self.clock.add("canonicalise", self.store.get_or_compute(self.form_recipe(entry, maker), compute))
        return Mesh(arrays["vertices"], arrays["faces"]), _notes(arrays)

    def features(self, entry: Entry, maker: Maker, form: Mesh) -> Features:
        """Local features of the 66 views of the canonical form of a shape."""
        recipe = {
            "stage": "features",
            "form": self.form_recipe(entry, maker),
            "scorer": dataclasses.asdict(self.scorer),
            "code": keys.code_digest(SCORER),
        }
        artefact = self.store.get_or_compute(recipe, lambda: self.scorer.extract(form).to_arrays())
        return Features.from_arrays(self.clock.add("features", artefact))

    def preparation_notes(self, entry: Entry) -> dict[str, float | str]:
        """What the preparation of a shape did: components dropped, pieces bridged."""
        found = self.store.find(self.shape_recipe(entry))
        return _notes(found.arrays) if found else {}

    # Recipes -----------------------------------------------------------------------------------------------------

    def shape_recipe(self, entry: Entry) -> Recipe:
        """What determines the prepared shape."""
        recipe: Recipe = {"stage": self.input, "source": self.dataset.recipe(entry)}
        if self.input == "mesh":
            return recipe | {"n_vertices": N_VERTICES, "code": keys.code_digest(PREPARATION)}
        return recipe | {
            "camera": repr(self.dataset.camera(entry)),
            "frame": self._frame,
            "code": keys.code_digest(VIEW),
        }

    def form_recipe(self, entry: Entry, maker: Maker) -> Recipe:
        """What determines the canonical form."""
        spec = maker.spec
        return {
            "stage": "form",
            "shape": self.shape_recipe(entry),
            "identifier": entry.identifier,  # seeds depend on it
            "method": spec.name,
            "parameters": spec.resolved_parameters(),
            "seed": self.seed,
            "code": keys.code_digest(spec.module),
            **maker.recipe_for(entry),
        }

    # Preparation -------------------------------------------------------------------------------------------------

    def _prepare_mesh(self, entry: Entry) -> Arrays:
        from benchmark.geometry.preparation import prepare

        prepared = prepare(self._source(entry), N_VERTICES)
        report = {f"note:{name}": np.asarray(value) for name, value in prepared.report.items()}
        return {
            "vertices": prepared.mesh.vertices,
            "faces": prepared.mesh.faces,
            "source_area": np.asarray(prepared.source_area),
            **report,
        }

    def _prepare_view(self, entry: Entry) -> Arrays:
        from benchmark.geometry.depth import depth_surface

        view = depth_surface(self._surface(entry), self.dataset.camera(entry), self.half_width)
        area = view.surface.area
        return {
            "vertices": view.surface.vertices / np.sqrt(area),
            "faces": view.surface.faces,
            "depth": view.depth,
            "source_area": np.asarray(area),
            **{f"note:{name}": np.asarray(value) for name, value in dataclasses.asdict(view.report).items()},
        }

    def _source(self, entry: Entry) -> Mesh:
        """The mesh of the data set; generated ones are kept, for some take seconds to make."""
        if entry.path is not None:
            return self.dataset.load(entry)

        def compute() -> Arrays:
            mesh = self.dataset.load(entry)
            return {"vertices": mesh.vertices, "faces": mesh.faces}

        recipe = {"stage": "source", "source": self.dataset.recipe(entry)}
        arrays = self.store.get_or_compute(recipe, compute).arrays
        return Mesh(arrays["vertices"], arrays["faces"])

    def _surface(self, entry: Entry) -> Mesh:
        """The mesh without vertices that no face names: they would move the centre and the frame of the camera."""
        from benchmark.geometry.cleaning import clean

        return clean(self._source(entry))[0]

    @cached_property
    def _frame(self) -> str:
        """What determines the scale of the depth images: a constant, or all shapes of the set."""
        if self.dataset.half_width is not None:
            return f"half width {self.dataset.half_width}"
        return keys.digest([(entry.identifier, source_recipe(self.dataset, entry)) for entry in self.dataset.entries])

    @cached_property
    def half_width(self) -> float:
        """Half the width of the camera's frame in file units, the same for all shapes of the data set."""
        if self.dataset.half_width is not None:
            return self.dataset.half_width
        recipe = {"stage": "half width", "frame": self._frame, "code": keys.code_digest(VIEW)}
        return float(self.store.get_or_compute(recipe, self._fit_half_width).arrays["half_width"])

    def _fit_half_width(self) -> Arrays:
        from benchmark.geometry.depth import fit_half_width

        widths = []
        for entry in self.dataset.entries:
            try:
                widths.append(fit_half_width([self._surface(entry)], self.dataset.camera(entry)))
            except ShapeError:
                continue  # this shape is counted as unsupported when its turn comes
        return {"half_width": np.asarray(max(widths, default=1.0))}


def source_recipe(dataset: Dataset, entry: Entry) -> str:
    """What determines the mesh of a shape; for one that cannot be read, the reason."""
    try:
        return dataset.recipe(entry)
    except ShapeError as error:
        return str(error)


def _notes(arrays: Arrays) -> dict[str, float | str]:
    return {name[5:]: value.item() for name, value in arrays.items() if name.startswith("note:")}
