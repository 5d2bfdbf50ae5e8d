"""Prepare the shapes of a data set: the complete surface, or the part that a depth camera sees.

The code of this module and of all that it imports is in the key of each prepared shape and form; it
imports no check.
"""

from __future__ import annotations

import errno
import resource
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Input
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.code_digest import code_of_modules, digest
from benchmark.errors import (
    BenchmarkError,
    InvalidForm,
    InvalidMesh,
    InvalidSignature,
    ShapeError,
    UnsupportedShape,
)
from benchmark.geometry.camera import Camera, DepthSensor
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.cache import Arrays

#: Number of vertices of the prepared mesh, as usual for canonical forms (Lian et al. 2013, Pickup
#: et al. 2018).
N_VERTICES = 2000

#: Prefix of the names of arrays that are notes on a shape.
NOTE = "note:"

#: Arrays that say why there is no result, and what it took (:func:`clock`); a scorer can call none
#: of its own so.
REFUSED, SECONDS = ":refused", ":seconds"

#: Problem of a shape whose key is not the planned one, and what to do without a result for a
#: passing reason.
CHANGED, AGAIN = "changed during the run", "run again"


class Incomplete(BenchmarkError):
    """A shape has no result for a reason that is not in its content, such as a read error; nothing of it is kept.

    Parameters
    ----------
    problem
        What goes on after the name of the shape.
    """

    def __init__(self, problem: str) -> None:
        super().__init__(problem, AGAIN)


# Prepared shapes of a data set
# ---------------------------------------------------------------------------------------


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
        return (*self.shapes.code(entry), __name__)

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
    from benchmark.geometry.depth import common_half_width

    def fitted(entry: Entry) -> Arrays:
        return timed(
            lambda: {"width": np.asarray(fit_frame(shapes.load(entry), shapes.camera(entry)))}
        )

    if shapes.half_width is not None:
        return shapes.half_width
    widths = [float(arrays["width"]) for arrays in map(fitted, shapes.shapes) if "width" in arrays]
    return common_half_width(widths) if widths else 1.0


def last_change(shapes: ShapeSet, entry: Entry) -> int:
    """Return when a file of a shape, or its attributes, changed last; 0 without a file."""
    with suppress(OSError):
        return max((path.stat().st_ctime_ns for path in shapes.files(entry)), default=0)
    return 0


def clock() -> NDArray[np.float64]:
    """Return seconds of the wall and of the processor, user and system, of this process and its ended children."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return np.array(
        [time.perf_counter(), time.process_time() + children.ru_utime + children.ru_stime]
    )


def timed(compute: Callable[[], Arrays]) -> Arrays:
    """Return the arrays of a stage, or the reason why it refuses the shape, with the seconds that it took.

    Raises
    ------
    InvalidForm, InvalidSignature
        If a method or a scorer returned something else, which is not the fault of the shape.
    Incomplete
        If memory or a read error is to blame, which may not happen again.
    """
    start = clock()
    try:
        arrays = compute()
    except (InvalidForm, InvalidSignature):
        raise
    except ShapeError as error:
        if _is_temporary(error):
            raise Incomplete(f"has no result: {error.problem}") from error
        arrays = {REFUSED: np.array([error.problem, error.hint])}
    return {**arrays, SECONDS: clock() - start}


def _is_temporary(error: BaseException | None) -> bool:
    """Return whether an error comes from memory, or from reading a file that is there."""
    while error is not None:
        is_read_error = isinstance(error, OSError) and error.errno not in (None, errno.ENOENT)
        if is_read_error or isinstance(error, MemoryError):
            return True
        error = error.__cause__
    return False


def require_result(arrays: Arrays) -> Arrays:
    """Return the arrays of a stage; raise ``UnsupportedShape`` with the reason if there are none."""
    if REFUSED in arrays:
        raise UnsupportedShape(*arrays[REFUSED].tolist())
    return arrays


# Meshes to arrays; what these functions import takes a second
# ---------------------------------------------------------


def prepare_mesh(source: Mesh) -> Arrays:
    """Clean, join, decimate and scale a mesh.

    Returns
    -------
    dict
        ``vertices`` and ``faces`` of the prepared surface, of unit area; ``vertex_map``, the
        nearest vertex of the file at each vertex; ``source_area`` in squared file units;
        ``note:...`` for each note of the preparation.

    Raises
    ------
    ShapeError
        If the mesh has no usable part.
    """
    from benchmark.geometry.preparation import prepare

    prepared = prepare(source, N_VERTICES)
    return {
        "vertices": prepared.mesh.vertices,
        "faces": prepared.mesh.faces,
        "vertex_map": prepared.vertex_map(source).astype(np.int32),
        "source_area": np.asarray(prepared.source_area),
        **{f"note:{name}": np.asarray(value) for name, value in prepared.report.items()},
    }


def prepare_view(
    source: Mesh, camera: Camera, half_width: float, sensor: DepthSensor | None = None
) -> Arrays:
    """Render a mesh and back-project the depth image.

    Parameters
    ----------
    source
        The mesh as loaded from the data set.
    camera
        The camera.
    half_width
        Half the width of the frame in file units.
    sensor
        Sensor whose errors are added; None for an ideal camera.

    Returns
    -------
    dict
        As :func:`prepare_mesh`, of the visible surface, and ``depth``, shape (500, 500), float32.

    Raises
    ------
    ShapeError
        If no part of the mesh is visible.
    """
    from benchmark.geometry.depth import depth_surface

    view = depth_surface(_surface(source), camera, half_width, sensor)
    area = view.surface.area
    return {
        "vertices": view.surface.vertices / np.sqrt(area),
        "faces": view.surface.faces,
        "depth": view.depth,
        "source_area": np.asarray(area),
        **{f"note:{name}": np.asarray(value) for name, value in view.report.items()},
    }


def fit_frame(source: Mesh, camera: Camera) -> float:
    """Return half the width of the frame that a mesh fills, in file units; raise ``ShapeError`` without a surface."""
    from benchmark.geometry.depth import fit_half_width

    return fit_half_width(_surface(source), camera)


def _surface(source: Mesh) -> Mesh:
    """Return the mesh without unreferenced vertices, which would move the centre and the frame of the camera."""
    from benchmark.geometry.cleaning import clean

    surface, cleaning = clean(source)
    if not surface.n_faces:
        raise InvalidMesh(
            f"none of the {cleaning['faces_before']} triangles has an area", "export the mesh again"
        )
    return surface
