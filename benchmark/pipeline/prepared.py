"""Prepare the shapes of a data set: their keys and arrays, while their files do not change."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import chain
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
        makers = chain.from_iterable(self._makers(entry) for entry in self.shapes.shapes)
        return code_of_modules(dict.fromkeys(makers))

    def _makers(self, entry: Entry) -> tuple[str, ...]:
        """Return the modules that make the mesh of a shape and prepare it."""
        return (*self.shapes.code(entry), PREPARING_MODULES[self.input])

    @cached_property
    def camera_key(self) -> str:
        """Digest of what sets the frame that all views share; "" for meshes.

        That is a width, or all shapes that the frame is fitted to.
        """
        if self.input == "mesh":
            return ""
        if self.shapes.framed:
            return PreparedShapes(self.shapes.framed, self.input).camera_key
        shapes = self.shapes
        if shapes.half_width:
            return digest([shapes.half_width, self._code_digest])
        fitted = [(shapes.key(entry), repr(shapes.camera(entry))) for entry in shapes.shapes]
        return digest([fitted, self._code_digest])

    @property
    def frame_key(self) -> str:
        """Key of the file with the frame that is fitted to all shapes; "" if none is."""
        return "" if self.shapes.half_width else self.camera_key

    def key(self, entry: Entry) -> str:
        """Return the key of a prepared shape."""
        shapes = self.shapes
        view: list[str] = []
        if self.input == "view":
            view = [self.camera_key, repr(shapes.camera(entry)), repr(shapes.sensor(entry))]
        code = self._digest_of(self._makers(entry))
        return digest([self.input, shapes.key(entry), view, code])

    @cached_property
    def _code_digest(self) -> str:
        """Digest of the code that makes the meshes and prepares them."""
        return digest(self.code)

    @cached_property
    def _digest_of(self) -> Callable[[tuple[str, ...]], str]:
        """Function that returns the digest of the code of modules, which many shapes share."""
        return cache(lambda modules: digest(code_of_modules(modules)))

    def find(self, identifier: str, key: str) -> Entry:
        """Return the shape with a name; raise ``Incomplete`` unless its key is the planned one."""
        with suppress(ShapeError):  # it can no longer be read
            for entry in self.shapes.shapes:
                if entry.identifier == identifier and self.key(entry) == key:
                    return entry
        raise Incomplete(CHANGED)

    def frame(self) -> Arrays:
        """Return ``half_width``: half the width of the frame of all views, in file units.

        Raises
        ------
        Incomplete
            If a shape cannot be read now, or a file changes meanwhile.
        """
        if self.shapes.framed:
            return PreparedShapes(self.shapes.framed, self.input).frame()

        def compute() -> Arrays:
            return {"half_width": np.asarray(frame_of(self.shapes))}

        return self._while_unchanged(self.shapes.shapes, compute)

    def prepare(self, entry: Entry, half_width: float) -> Arrays:
        """Return the arrays of a prepared shape, or the reason why its content is refused.

        Raises
        ------
        Incomplete
            If it cannot be read now, or its file changes meanwhile.
        """
        shapes = self.shapes

        def compute() -> Arrays:
            mesh = shapes.load(entry)
            if self.input == "mesh":
                return prepare_mesh(mesh)
            return prepare_view(mesh, shapes.camera(entry), half_width, shapes.sensor(entry))

        return self._while_unchanged([entry], lambda: timed(compute))

    def _while_unchanged(self, entries: Sequence[Entry], compute: Callable[[], Arrays]) -> Arrays:
        """Return what is computed from shapes; raise ``Incomplete`` if one changes meanwhile."""
        planned_keys = [self.key(entry) for entry in entries]
        before = [last_change(self.shapes, entry) for entry in entries]
        arrays = compute()
        after = [last_change(self.shapes, entry) for entry in entries]
        without_known_keys = replace(self)
        keys = [without_known_keys.key(entry) for entry in entries]
        if after != before or keys != planned_keys:
            raise Incomplete(CHANGED)
        return arrays


def frame_of(shapes: ShapeSet) -> float:
    """Return half the width of the square frame into which all views of a data set fit.

    It is in the unit of the mesh files. Shapes that cannot be read or have no surface are ignored;
    if there are no others, the width is arbitrary.
    """
    if shapes.half_width is not None:  # the data set fixes it
        return shapes.half_width

    def fit(entry: Entry) -> Arrays:
        """Return the width of the frame that one shape needs."""
        return {"width": np.asarray(fit_frame(shapes.load(entry), shapes.camera(entry)))}

    widths = []
    for entry in shapes.shapes:
        fitted = timed(partial(fit, entry))  # without "width" if the shape is refused
        if "width" in fitted:
            widths.append(float(fitted["width"]))
    return common_frame(widths)


def last_change(shapes: ShapeSet, entry: Entry) -> int:
    """Return when a file of a shape, or its attributes, changed last; 0 without a file."""
    try:
        return max((path.stat().st_ctime_ns for path in shapes.files(entry)), default=0)
    except OSError:
        return 0
