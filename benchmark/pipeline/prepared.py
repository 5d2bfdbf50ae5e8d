"""Prepare the shapes of a data set: their keys, and how they are computed while their files do not change."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np

from benchmark.code_digest import code_of_modules, digest
from benchmark.errors import ShapeError
from benchmark.pipeline import surfaces, views
from benchmark.pipeline.stages import Arrays, Incomplete, timed
from benchmark.pipeline.surfaces import prepare_mesh
from benchmark.pipeline.views import common_frame, fit_frame, prepare_view

if TYPE_CHECKING:
    from benchmark.api.contracts import Input
    from benchmark.api.datasets import Entry, ShapeSet

#: Modules that prepare the meshes of a data set, by input, beside those that make them.
PREPARING_MODULES: Mapping[Input, str] = {"mesh": surfaces.__name__, "view": views.__name__}

#: Problem of a shape whose key is not the planned one.
CHANGED = "changed during the run"


@dataclass(frozen=True, eq=False)
class PreparedShapes:
    """Keys and arrays of the prepared shapes of a data set under one input.

    Parameters
    ----------
    shapes
        The data set.
    input
        ``"mesh"`` for the complete surface, ``"view"`` for the part visible to the depth camera.
    """

    shapes: ShapeSet
    input: Input

    @cached_property
    def code(self) -> dict[str, str]:
        """Code that makes the meshes and prepares them."""
        makers = dict.fromkeys(name for entry in self.shapes.shapes for name in self._makers(entry))
        return code_of_modules(makers)

    def _makers(self, entry: Entry) -> tuple[str, ...]:
        """Return the modules that make the mesh of a shape and prepare it."""
        return (*self.shapes.code(entry), PREPARING_MODULES[self.input])

    @cached_property
    def camera_key(self) -> str:
        """Digest of the frame that all views share: a width, or all shapes that it is fitted to; "" for meshes."""
        if self.input == "mesh":
            return ""
        if self.shapes.framed:
            return PreparedShapes(self.shapes.framed, self.input).camera_key
        shapes = self.shapes
        fitted = shapes.half_width or [
            (shapes.key(entry), repr(shapes.camera(entry))) for entry in shapes.shapes
        ]
        return digest([fitted, self._code_digest])

    @property
    def frame_key(self) -> str:
        """Key of the file with the frame that is fitted to all shapes; "" if there is nothing to fit."""
        return "" if self.shapes.half_width else self.camera_key

    def key(self, entry: Entry) -> str:
        """Return the key of a prepared shape."""
        shapes, view = self.shapes, []
        if self.input == "view":
            view = [self.camera_key, repr(shapes.camera(entry)), repr(shapes.sensor(entry))]
        return digest([self.input, shapes.key(entry), view, self._digest_of(self._makers(entry))])

    @cached_property
    def _code_digest(self) -> str:
        return digest(self.code)

    @cached_property
    def _digest_of(self) -> Callable[[tuple[str, ...]], str]:
        """Return the digest of the code of modules, which many shapes share."""
        return cache(lambda modules: digest(code_of_modules(modules)))

    def find(self, identifier: str, key: str) -> Entry:
        """Return the shape with a name; raise :class:`Incomplete` unless its key is the planned one."""
        with suppress(ShapeError):  # it can no longer be read
            for entry in self.shapes.shapes:
                if entry.identifier == identifier and self.key(entry) == key:
                    return entry
        raise Incomplete(CHANGED)

    def frame(self) -> Arrays:
        """Return ``half_width``: half the width of the camera's frame in file units, the same for all shapes.

        Raises
        ------
        Incomplete
            If a shape cannot be read now, or a file changes meanwhile.
        """
        if self.shapes.framed:
            return PreparedShapes(self.shapes.framed, self.input).frame()
        return self._while_unchanged(
            self.shapes.shapes, lambda: {"half_width": np.asarray(frame_of(self.shapes))}
        )

    def prepare(self, entry: Entry, half_width: float) -> Arrays:
        """Return the arrays of a prepared shape, or the reason why its content is refused.

        Raises
        ------
        Incomplete
            If it cannot be read now, or its file changes meanwhile.
        """
        shapes = self.shapes

        def compute() -> Arrays:
            if self.input == "mesh":
                return prepare_mesh(shapes.load(entry))
            return prepare_view(
                shapes.load(entry), shapes.camera(entry), half_width, shapes.sensor(entry)
            )

        return self._while_unchanged([entry], lambda: timed(compute))

    def _while_unchanged(self, entries: Sequence[Entry], compute: Callable[[], Arrays]) -> Arrays:
        """Return what is computed from shapes; raise :class:`Incomplete` if one of them changes meanwhile."""
        before = [last_change(self.shapes, entry) for entry in entries]
        arrays = compute()
        after = [last_change(self.shapes, entry) for entry in entries]
        now = replace(self)  # which has no key yet
        if after != before or [now.key(entry) for entry in entries] != [
            self.key(entry) for entry in entries
        ]:
            raise Incomplete(CHANGED)
        return arrays


def frame_of(shapes: ShapeSet) -> float:
    """Return half the width of the frame of all views of a data set, in file units; arbitrary without shapes."""

    def fitted(entry: Entry) -> Arrays:
        return timed(
            lambda: {"width": np.asarray(fit_frame(shapes.load(entry), shapes.camera(entry)))}
        )

    if shapes.half_width is not None:
        return shapes.half_width
    widths = [float(arrays["width"]) for arrays in map(fitted, shapes.shapes) if "width" in arrays]
    return common_frame(widths)


def last_change(shapes: ShapeSet, entry: Entry) -> int:
    """Return when a file of a shape, or its attributes, changed last; 0 without a file."""
    with suppress(OSError):
        return max((path.stat().st_ctime_ns for path in shapes.files(entry)), default=0)
    return 0
