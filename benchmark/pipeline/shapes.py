"""Prepared shapes of a data set under one input, kept in the cache."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from benchmark.api.contracts import Input, Mesh
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.errors import InvalidForm, InvalidSignature, ShapeError, UnsupportedShape
from benchmark.pipeline.cache import Arrays, Cache
from benchmark.pipeline.keys import code_of_modules, digest

#: Module with the code of all preparations.
CODE = "benchmark.pipeline.preparation"

#: Prefix of the names of arrays that are notes on a shape.
NOTE = "note:"

#: Arrays that say why there is no result, and how many seconds the result took.
REFUSED, SECONDS = "refused", "seconds"


class SharedFailure(UnsupportedShape):
    """A result that methods share cannot be had in this run: the shape is refused for all of them."""


class Unprepared(UnsupportedShape):
    """A shape cannot be read or prepared, whatever the method."""


@dataclass(frozen=True, eq=False)
class Preparation:
    """Prepared shapes of a data set under one input.

    Parameters
    ----------
    shapes
        The data set.
    input
        ``"mesh"`` for the complete surface, ``"view"`` for the part visible to the depth camera.
    cache
        Where prepared shapes are kept; None to keep none.
    """

    shapes: ShapeSet
    input: Input
    cache: Cache | None = None
    _keys: dict[str, str] = field(default_factory=dict, repr=False)

    @cached_property
    def code(self) -> dict[str, str]:
        """Code that makes the meshes and prepares them."""
        return code_of_modules([*self.shapes.code, CODE], self.shapes.files)

    @cached_property
    def camera_key(self) -> str:
        """Digest of the frame that all views share: a width, or all shapes that it is fitted to; "" for meshes."""
        if self.input == "mesh":
            return ""
        shapes = self.shapes
        fitted = shapes.half_width or [(shapes.key(entry), repr(shapes.camera(entry))) for entry in shapes.shapes]
        return digest([fitted, self._code_digest])

    def key(self, entry: Entry) -> str:
        """Return the key of a prepared shape."""
        if entry.identifier not in self._keys:
            camera = [] if self.input == "mesh" else [self.camera_key, repr(self.shapes.camera(entry))]
            sensor = repr(self.shapes.sensor(entry)) if camera else ""
            content = [self.input, self.shapes.key(entry), camera, sensor, self._code_digest]
            self._keys[entry.identifier] = digest(content)
        return self._keys[entry.identifier]

    @cached_property
    def _code_digest(self) -> str:
        return digest(self.code)

    def arrays(self, entry: Entry, load: Callable[[Entry], Mesh] | None = None) -> Arrays:
        """Return the arrays of a prepared shape.

        Parameters
        ----------
        entry
            The shape.
        load
            Replaces the function that loads its mesh.

        Raises
        ------
        Unprepared
            If it cannot be read or prepared.
        """

        def compute() -> Arrays:
            start = time.perf_counter()
            arrays = attempt(lambda: self._prepare(entry, load or self.shapes.load))
            return {**arrays, SECONDS: np.asarray(time.perf_counter() - start)}

        arrays = compute() if self.cache is None else self.cache.get("prepared", self.key(entry), compute)
        return require_result(arrays, Unprepared)

    @cached_property
    def half_width(self) -> float:
        """Half the width of the camera's frame in file units, the same for all shapes of the data set."""
        if self.shapes.half_width is not None:
            return self.shapes.half_width
        if self.cache is None:
            return float(self._fit_frame()["half_width"])
        return float(self.cache.get("prepared", self.camera_key, self._fit_frame)["half_width"])

    def _prepare(self, entry: Entry, load: Callable[[Entry], Mesh]) -> Arrays:
        from benchmark.pipeline.preparation import prepare_mesh, prepare_view  # which takes a second

        if self.input == "mesh":
            return prepare_mesh(load(entry))
        half_width = self.half_width
        return prepare_view(load(entry), self.shapes.camera(entry), half_width, self.shapes.sensor(entry))

    def _fit_frame(self) -> Arrays:
        from benchmark.pipeline.preparation import common_frame, fit_frame

        widths = []
        for entry in self.shapes.shapes:
            with suppress(ShapeError):  # this shape is refused when it is prepared
                widths.append(fit_frame(self.shapes.load(entry), self.shapes.camera(entry)))
        return {"half_width": np.asarray(common_frame(widths))}


def attempt(compute: Callable[[], Arrays]) -> Arrays:
    """Return the arrays of a stage; for a refused shape, the reason.

    Raises
    ------
    InvalidForm, InvalidSignature
        If a method or a scorer returned something else, which is not the fault of the shape.
    SharedFailure
        If the shape is refused in this run only.
    """
    try:
        return compute()
    except (InvalidForm, InvalidSignature, SharedFailure):
        raise
    except ShapeError as error:
        return {REFUSED: np.array([error.problem, error.hint])}


def require_result(arrays: Arrays, error: type[UnsupportedShape] = UnsupportedShape) -> Arrays:
    """Return the arrays of a stage; raise an error with the reason if there are none."""
    if REFUSED in arrays:
        problem, hint = arrays[REFUSED].tolist()
        raise error(problem, hint)
    return arrays


def notes_of(*stages: Arrays) -> dict[str, float]:
    """Return the numbers that preparation and method reported, by name."""
    notes = {name.removeprefix(NOTE): a for arrays in stages for name, a in arrays.items() if name.startswith(NOTE)}
    return {name: float(note) for name, note in notes.items() if note.dtype.kind in "biuf"}
