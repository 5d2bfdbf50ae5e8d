"""Stages of a single shape: prepared surface, form or descriptor, and signature."""

from __future__ import annotations

import errno
import sys
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, Descriptor, FloatArray, Input, Mesh, Method, Shape
from benchmark.api.datasets import Entry, ShapeSet, files_of
from benchmark.api.scoring import Scorer, SignatureArrays
from benchmark.code_digest import code_of_modules, digest
from benchmark.errors import (
    BenchmarkError,
    InvalidForm,
    InvalidMesh,
    InvalidSignature,
    ShapeError,
    UnsupportedShape,
    one_line,
)
from benchmark.machine import describe_machine
from benchmark.pipeline.cache import Arrays, Cache

#: Module with the code of all stages.
CODE = "benchmark.pipeline.stages"

#: Prefix of the names of arrays that are notes on a shape.
NOTE = "note:"

#: Arrays that say why there is no result, how many seconds the result took, and on which machine.
REFUSED, SECONDS, MACHINE = "refused", "seconds", "machine"

#: Problem of a shape whose key is not the planned one, and what to do without a result for a passing reason.
CHANGED, AGAIN = "changed during the run", "run again"

#: Returns the context of work whose time is not charged to a method, such as ``"geodesics"``.
Uncharged = Callable[[str], AbstractContextManager[object]]


class Unprepared(UnsupportedShape):
    """The content of a shape cannot be prepared: it is refused for all methods."""


class Incomplete(BenchmarkError):
    """A shape has no result for a reason that is not in its content, such as a read error; nothing of it is kept.

    Parameters
    ----------
    problem
        What goes on after the name of the shape.
    """

    def __init__(self, problem: str) -> None:
        super().__init__(problem, AGAIN)


# Prepared shapes -----------------------------------------------------------------------------------------------------


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
        Where prepared shapes are kept.
    """

    shapes: ShapeSet
    input: Input
    cache: Cache

    @cached_property
    def code(self) -> dict[str, str]:
        """Code that makes the meshes and prepares them."""
        return code_of_modules([*self.shapes.code, CODE])

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
        shapes, view = self.shapes, []
        if self.input == "view":
            view = [self.camera_key, repr(shapes.camera(entry)), repr(shapes.sensor(entry))]
        return digest([self.input, shapes.key(entry), view, self._code_digest])

    @cached_property
    def _code_digest(self) -> str:
        return digest(self.code)

    def get_ready(self) -> None:
        """Do what belongs to no shape: import what prepares them, and fit the frame of the camera."""
        from benchmark.geometry.preparation import import_pymeshlab
        from benchmark.pipeline import preparation  # noqa: F401

        import_pymeshlab()
        if self.input == "view":
            self.half_width  # noqa: B018

    def find(self, identifier: str, key: str) -> Entry:
        """Return the shape with a name; raise :class:`Incomplete` unless its key is the planned one."""
        with suppress(ShapeError):  # it can no longer be read
            for entry in self.shapes.shapes:
                if entry.identifier == identifier and self.key(entry) == key:
                    return entry
        raise Incomplete(CHANGED)

    def arrays(self, entry: Entry) -> Arrays:
        """Return the arrays of a prepared shape.

        Raises
        ------
        Unprepared
            If its content is refused.
        Incomplete
            If it cannot be read now, memory is exhausted, or its file changes meanwhile.
        """
        key = self.key(entry)

        def compute() -> Arrays:
            before = last_change(entry)
            arrays = timed(lambda: self._prepare(entry))
            if self.key(entry) != key or last_change(entry) != before:
                raise Incomplete(CHANGED)
            return arrays

        return require_result(self.cache.get("prepared", key, compute), Unprepared)

    @cached_property
    def half_width(self) -> float:
        """Half the width of the camera's frame in file units, the same for all shapes of the data set."""
        if self.shapes.half_width is not None:
            return self.shapes.half_width
        return float(self.cache.get("prepared", self.camera_key, self._fit_frame)["half_width"])

    def _fit_frame(self) -> Arrays:
        half_width = frame_of(self.shapes)
        if replace(self).camera_key != self.camera_key:
            raise Incomplete("has no camera: the data set changed during the run")
        return {"half_width": np.asarray(half_width)}

    def _prepare(self, entry: Entry) -> Arrays:
        from benchmark.pipeline.preparation import prepare_mesh, prepare_view  # which takes a second

        shapes = self.shapes
        if self.input == "mesh":
            return prepare_mesh(shapes.load(entry))
        return prepare_view(shapes.load(entry), shapes.camera(entry), self.half_width, shapes.sensor(entry))


def frame_of(shapes: ShapeSet) -> float:
    """Return half the width of the frame of all views of a data set, in file units; arbitrary without shapes."""
    from benchmark.geometry.depth import common_half_width
    from benchmark.pipeline.preparation import fit_frame

    def fitted(entry: Entry) -> Arrays:
        return timed(lambda: {"width": np.asarray(fit_frame(shapes.load(entry), shapes.camera(entry)))})

    if shapes.half_width is not None:
        return shapes.half_width
    widths = [float(arrays["width"]) for arrays in map(fitted, shapes.shapes) if "width" in arrays]
    return common_half_width(widths) if widths else 1.0


def last_change(entry: Entry) -> int:
    """Return when a file of a shape, or its attributes, changed last; 0 without a file."""
    with suppress(OSError):
        return max((path.stat().st_ctime_ns for path in files_of(entry)), default=0)
    return 0


def _is_temporary(error: BaseException | None) -> bool:
    """Return whether an error comes from memory, or from reading a file that is there."""
    while error is not None:
        is_read_error = isinstance(error, OSError) and error.errno not in (None, errno.ENOENT)
        if is_read_error or isinstance(error, MemoryError):
            return True
        error = error.__cause__
    return False


def timed(compute: Callable[[], Arrays]) -> Arrays:
    """Return the arrays of a stage, or the reason why it refuses the shape, with the seconds that it took.

    Raises
    ------
    InvalidForm, InvalidSignature
        If a method or a scorer returned something else, which is not the fault of the shape.
    Incomplete
        If memory or a read error is to blame, which may not happen again.
    """
    start = time.perf_counter()
    try:
        arrays = compute()
    except (InvalidForm, InvalidSignature):
        raise
    except ShapeError as error:
        if _is_temporary(error):
            raise Incomplete(f"has no result: {error.problem}") from error
        arrays = {REFUSED: np.array([error.problem, error.hint])}
    return {**arrays, SECONDS: np.asarray(time.perf_counter() - start)}


def require_result(arrays: Arrays, error: type[UnsupportedShape] = UnsupportedShape) -> Arrays:
    """Return the arrays of a stage; raise an error with the reason if there are none."""
    if REFUSED in arrays:
        raise error(*arrays[REFUSED].tolist())
    return arrays


# Forms, descriptors and signatures -----------------------------------------------------------------------------------


class SharedResults:
    """Geodesic distances of a shape, by solver, and forms that other methods deform, by method; each computed once.

    Parameters
    ----------
    uncharged
        Context of work that is not charged to a method: geodesics. A form is charged to each method that uses it.
    """

    def __init__(self, uncharged: Uncharged = lambda _: nullcontext()) -> None:
        self._uncharged = uncharged
        self._results: dict[Hashable, tuple[Any, float]] = {}
        #: Seconds of the matrix that the current method used, and those that passed and are not its own.
        self.used = 0.0
        self.waited = 0.0

    def get_or_compute(self, key: Hashable, compute: Callable[[], Any]) -> Any:
        """Return the distances of a solver, or the form of a method; compute them if they are missing.

        Raises
        ------
        Incomplete
            If there is no memory for distances; the method is not to blame.
        """
        known, is_solver, start = key in self._results, isinstance(key, str), time.perf_counter()
        if not known:
            try:
                with self._uncharged("geodesics") if is_solver else nullcontext():
                    result = compute()
            except MemoryError as error:
                if is_solver:
                    raise Incomplete("has no geodesics: out of memory") from error
                raise
            self._results[key] = result, time.perf_counter() - start
        result, seconds = self._results[key]
        if is_solver:
            self.used = seconds
            self.waited += 0.0 if known else seconds
        elif known:
            self.waited -= seconds
        return result


def shape_of(arrays: Arrays, identifier: str, seed: int = 0, shared: SharedResults | None = None) -> Shape:
    """Return the shape passed to methods, from its prepared arrays."""
    return Shape(
        identifier=identifier,
        mesh=Mesh(arrays["vertices"], arrays["faces"]),
        depth=arrays.get("depth"),
        source_area=float(arrays["source_area"]),
        seed=seed,
        cache=shared.get_or_compute if shared else None,
    )


def compute_output(method: Method | Descriptor, shape: Shape, shared: SharedResults) -> Arrays:
    """Compute the form or the descriptor of a shape; for a refused shape, the reason.

    Coordinates are rounded to single precision, an error of 1e-7 that is negligible for all scorers. The scored form is
    therefore the same whether it was just computed or read from the cache.

    Returns
    -------
    dict
        ``vertices``, shape (n, 3), float32, and ``faces`` if they differ from those of the shape; or ``descriptor``,
        shape (k,); ``note:...`` for each note of the method; ``seconds`` of the method, and ``seconds:geodesics`` of
        the distances that it shares with others.

    Raises
    ------
    InvalidForm
        If it returns anything other than a form of the shape, or a vector of finite numbers.
    """
    shared.used = shared.waited = 0.0
    if isinstance(method, Method):
        arrays = timed(lambda: _rounded(compute_form(method, shape), shape, method))
    else:
        arrays = timed(lambda: {"descriptor": compute_descriptor(method, shape)})
    if shared.used:
        arrays = {**arrays, f"{SECONDS}:geodesics": np.asarray(shared.used)}
    return {**arrays, SECONDS: arrays[SECONDS] - shared.waited, MACHINE: np.asarray(describe_machine())}


def _rounded(form: CanonicalForm, shape: Shape, method: Method) -> Arrays:
    with np.errstate(over="ignore"):
        vertices = form.vertices.astype(np.float32)
    if not (np.isfinite(vertices).all() and len(form.faces)):
        what = "coordinates too large for single precision" if len(form.faces) else "a form without triangles"
        raise InvalidForm(f"{_name(method)} returned {what}", "keep the scale and the triangles of the shape")
    changed = {} if np.array_equal(form.faces, shape.mesh.faces) else {"faces": form.faces}
    return {"vertices": vertices, **changed, **{f"{NOTE}{name}": np.asarray(v) for name, v in form.notes.items()}}


def mesh_of(form: Arrays, prepared: Arrays) -> Mesh:
    """Return the form of a shape, from the arrays of :func:`compute_output` and of the prepared shape."""
    return Mesh(form["vertices"], form["faces"] if "faces" in form else prepared["faces"])


def sign(scorer: Scorer, form: Mesh) -> Arrays:
    """Compute the signature of a form; for a refused form, the reason."""
    return timed(lambda: compute_signature(scorer, form))


# What methods, descriptors and scorers return: values are never cast if that changes them ----------------------------

_FORM_HINT = "return shape.form(vertices) with finite numbers, or raise UnsupportedShape with the reason"
_MATRIX_HINT = "return the distances of all pairs as a symmetric matrix of finite numbers"
_SIGNATURE_HINT = "return a mapping from names to arrays of finite numbers"


def compute_form(method: Method, shape: Shape) -> CanonicalForm:
    """Return the form of a shape by a method; its notes are numbers or text.

    Raises
    ------
    ShapeError
        If the method refuses the shape.
    InvalidForm
        If it returns anything other than a form of the shape.
    """
    method.info.check(shape)
    try:
        return _check_form(method.canonicalise(shape), method)
    except InvalidMesh as error:  # the shape is valid, so the method made it invalid
        raise InvalidForm(f"{_name(method)} returned no canonical form: {error.problem}", _FORM_HINT) from error


def _check_form(form: object, method: Method) -> CanonicalForm:
    if not isinstance(form, CanonicalForm):
        raise InvalidMesh(f"it is of type {type(form).__name__}, not CanonicalForm")
    mesh = form.mesh
    for name, value in form.notes.items():
        if not np.isscalar(value) or np.asarray(value).dtype.kind not in "biufU":
            problem = f"{_name(method)} returned {type(value).__name__} as note '{name}'"
            raise InvalidForm(problem, "notes must be numbers or strings")
    return CanonicalForm(mesh.vertices, mesh.faces, form.notes)


def compute_descriptor(method: Descriptor, shape: Shape) -> FloatArray:
    """Return the descriptor of a shape, shape (k,); raise ``ShapeError`` or ``InvalidForm`` if there is none."""
    method.info.check(shape)
    return _check_numbers(method.describe(shape), method, (), "return a vector of finite numbers")


def compute_signature(scorer: Scorer, form: Mesh) -> SignatureArrays:
    """Return the signature of a form: named arrays.

    Raises
    ------
    ShapeError
        If the scorer refuses the form, for example one without extent.
    InvalidSignature
        If it returns anything but named arrays of finite numbers.
    """
    return _check_signature(scorer.signature(form), _name(scorer))


def _check_signature(signature: object, who: str) -> SignatureArrays:
    if not isinstance(signature, Mapping) or not signature:
        raise InvalidSignature(f"{who} returned {type(signature).__name__}, not named arrays", _SIGNATURE_HINT)
    for name, value in signature.items():
        if not (isinstance(name, str) and name.isidentifier()):
            raise InvalidSignature(f"{who} returned an array called {name!r:.80}", "name it like a variable")
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf" or not np.isfinite(value).all():
            raise InvalidSignature(f"{who} returned '{name}', not an array of finite numbers", _SIGNATURE_HINT)
    return dict(signature)


def compute_distances(
    comparing: Descriptor | Scorer, outputs: Sequence[Any], draw: int = 0, queries: Sequence[Any] | None = None
) -> FloatArray:
    """Return the dissimilarities of all pairs of descriptors, or of signatures for one draw of their scorer.

    Those of queries to the outputs, shape (M, N), depend on no other query.

    Raises
    ------
    InvalidForm
        If they are anything but a matrix of finite real numbers, shape (N, N) without queries.
    """
    if queries is None:
        matrix = comparing.compare(outputs, draw) if isinstance(comparing, Scorer) else comparing.distances(outputs)
        return _check_numbers(matrix, comparing, (len(outputs),) * 2, _MATRIX_HINT)
    if compare_to := getattr(comparing, "compare_to", None):
        shape = len(queries), len(outputs)
        return _check_numbers(compare_to(queries, outputs, draw), comparing, shape, _MATRIX_HINT)
    each = (compute_distances(comparing, [*outputs, query], draw) for query in queries)
    return np.stack([matrix[-1, :-1] for matrix in each])


def _check_numbers(output: object, component: object, shape: tuple[int, ...], hint: str) -> FloatArray:
    """Return an output as an array of finite real numbers of a shape; () stands for a vector that is not empty."""
    who = f"{_name(component)} returned"
    try:
        array: NDArray[Any] = np.asarray(output)
    except (TypeError, ValueError, RuntimeError) as error:  # rows of different lengths
        raise InvalidForm(f"{who} no array ({one_line(error)})", hint) from error
    fits = array.shape == shape if shape else array.ndim == 1 and array.size
    if not fits or array.dtype.kind not in "iuf":
        raise InvalidForm(f"{who} an array of shape {array.shape} and type {array.dtype}", hint)
    if not np.isfinite(array).all():
        raise InvalidForm(f"{who} an array with NaN or infinite numbers", hint)
    return array.astype(np.float64)


def _name(component: Any) -> str:
    """Return file and name of a method or scorer, for messages."""
    file = getattr(sys.modules.get(type(component).__module__), "__file__", None)
    kind = "scorer" if isinstance(component, Scorer) else "method"
    return f"{Path(file).name}: {kind} '{component.info.name}'" if file else f"{kind} '{component.info.name}'"
