"""What methods, descriptors and scorers return, checked.

Values are never cast if that changes them.

No key contains this code: an edit of a check computes nothing anew, and what was refused before
stays refused until its own code changes.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import (
    CanonicalForm,
    Descriptor,
    FloatArray,
    Mesh,
    Method,
    MethodInfo,
    Shape,
)
from benchmark.api.scoring import Scorer, SignatureArrays
from benchmark.errors import InvalidForm, InvalidMesh, InvalidSignature, UnsupportedShape, one_line
from benchmark.geometry.cleaning import connected_components
from benchmark.pipeline.forms import SharedResults, output_arrays
from benchmark.pipeline.ranking import Check, distances_of_draw
from benchmark.pipeline.stages import REFUSED, Arrays, timed
from benchmark.text import LONGEST_NAME, brief

#: What to do about outputs that are refused.
_FORM_HINT = (
    "return shape.form(vertices) with finite numbers, or raise UnsupportedShape with the reason"
)
_MATRIX_HINT = "return the distances of all pairs as a symmetric matrix of finite numbers"
_SIGNATURE_HINT = "return a mapping from names to arrays of finite numbers"

#: Fewest vertices of a form: three coordinates and a residual need four points, as any three points
#: lie in a plane.
FEWEST_FORM_VERTICES = 4

#: Most vertices for distances of all pairs: their 3 GiB fit into an ordinary memory a few times.
MOST_WITH_ALL_PAIRS = 20_000

#: Largest coordinate of a form, which is stored in single precision.
_LARGEST_COORDINATE = float(np.finfo(np.float32).max)

#: Largest step between two numbers in single precision near a form, in units of its extent.
_LARGEST_ROUNDING = 1e-4

#: Kinds of numpy's types that are numbers, real numbers, and numbers or texts.
_NUMBERS = "biuf"
_REAL_NUMBERS = "iuf"
_NUMBERS_OR_TEXTS = "biufU"


def compute_output(method: Method | Descriptor, shape: Shape, shared: SharedResults) -> Arrays:
    """Return the arrays of a form or descriptor, or why the method refuses the shape.

    See :func:`benchmark.pipeline.forms.output_arrays` for the arrays. The reason is kept for the
    content of the shape, so that it does not begin with the name.

    Raises
    ------
    InvalidForm
        If it returns anything other than a form of the shape, or a vector of finite numbers.
    """
    if isinstance(method, Method):
        arrays = output_arrays(lambda: compute_form(method, shape), shape, shared)
    else:
        arrays = output_arrays(lambda: compute_descriptor(method, shape), shape, shared)
    if REFUSED not in arrays:
        return arrays
    texts = [text.removeprefix(f"{shape.identifier}: ") for text in arrays[REFUSED].tolist()]
    return {**arrays, REFUSED: np.array(texts)}


def sign(scorer: Scorer, form: Mesh) -> Arrays:
    """Compute the signature of a form; for a refused form, the reason."""
    return timed(lambda: compute_signature(scorer, form))


def check_needs(info: MethodInfo, shape: Shape) -> None:
    """Check that a shape has what a method needs: one connected surface, and not too many vertices.

    Parameters
    ----------
    info
        Declaration of the method. Its ``needs`` are empty, ``"connected"`` (a surface in one piece)
        or also ``"pairs"`` (so few vertices that all distances between them are kept).
    shape
        The shape.

    Raises
    ------
    UnsupportedShape
        If the shape has not what is needed.
    """
    if not info.needs:
        return
    name = shape.identifier
    n_vertices = shape.mesh.n_vertices
    n_faces = shape.mesh.n_faces
    if n_vertices < FEWEST_FORM_VERTICES or not n_faces:
        raise UnsupportedShape(
            f"{name}: {n_vertices} vertices and {n_faces} faces, "
            f"where at least {FEWEST_FORM_VERTICES} and one are needed",
            "check how the shape was cut or decimated",
        )
    n_pieces = int(connected_components(shape.mesh).max()) + 1
    if n_pieces > 1:
        hint = "keep the largest component or bridge the pieces first"
        raise UnsupportedShape(f"{name}: the surface is in {n_pieces} pieces", hint)
    if "pairs" in info.needs and n_vertices > MOST_WITH_ALL_PAIRS:
        raise UnsupportedShape(
            f"{name}: {n_vertices} vertices, "
            f"where distances of all pairs are kept of {MOST_WITH_ALL_PAIRS} at most",
            "decimate the surface, or choose a method that needs a few rows, "
            "such as accelerated-mds",
        )


def compute_form(method: Method, shape: Shape) -> CanonicalForm:
    """Compute the canonical form of a shape, and check what the method returns.

    The method may be the plugin of a user, who may have returned anything.

    Parameters
    ----------
    method
        The method.
    shape
        The prepared shape.

    Returns
    -------
    CanonicalForm
        The form with vertices and faces of the standard types, and the notes of the method.

    Raises
    ------
    ShapeError
        If the shape is not what the method needs, or the method refuses it.
    InvalidForm
        If the method returns anything other than a form of the shape.
    """
    check_needs(method.info, shape)
    who = f"{_name(method)} returned no canonical form"
    try:
        form: object = method.canonicalise(shape)
        mesh = form.mesh if isinstance(form, CanonicalForm) else None  # this checks the arrays
    except InvalidMesh as error:
        raise InvalidForm(f"{who}: {error.problem}", _FORM_HINT) from error
    if not isinstance(form, CanonicalForm) or mesh is None:
        problem = f"{who}: it is of type {type(form).__name__}, not CanonicalForm"
        raise InvalidForm(problem, _FORM_HINT)
    _check_surface(method, mesh)
    notes: object = form.notes
    if not isinstance(notes, Mapping):
        problem = f"{_name(method)} returned {type(notes).__name__} as notes of a form"
        raise InvalidForm(problem, "return a dictionary, or leave the notes out")
    for name, value in notes.items():
        _check_note(method, name, value)
    return CanonicalForm(mesh.vertices, mesh.faces, form.notes)


def _check_surface(method: Method, mesh: Mesh) -> None:
    """Raise ``InvalidForm`` unless a form can be stored and scored."""
    hint = "keep the scale and the triangles of the shape"
    if not len(mesh.faces):
        raise InvalidForm(f"{_name(method)} returned a form without triangles", hint)
    largest = np.abs(mesh.vertices).max()
    if largest > _LARGEST_COORDINATE:
        problem = f"{_name(method)} returned coordinates too large for single precision"
        raise InvalidForm(problem, hint)
    extent = np.ptp(mesh.vertices, axis=0).max()  # 0 is left to the scorer
    if extent and np.spacing(np.float32(largest)) > _LARGEST_ROUNDING * extent:
        problem = f"{_name(method)} returned a form that single precision cannot resolve"
        raise InvalidForm(problem, "move it to the origin, and keep the scale of the shape")


def _check_note(method: Method, name: str, value: object) -> None:
    """Raise ``InvalidForm`` unless a note is a number or a text with a short name."""
    if name != brief(name, LONGEST_NAME):
        problem = f"{_name(method)} returned a note called {name!r:.80}"
        raise InvalidForm(problem, "give it a short printable name")
    if not np.isscalar(value) or np.asarray(value).dtype.kind not in _NUMBERS_OR_TEXTS:
        problem = f"{_name(method)} returned {type(value).__name__} as note '{name}'"
        raise InvalidForm(problem, "notes must be numbers or strings")


def compute_descriptor(method: Descriptor, shape: Shape) -> FloatArray:
    """Return the descriptor of a shape, shape (k,).

    Raises
    ------
    ShapeError
        If the descriptor refuses the shape.
    InvalidForm
        If it returns anything other than a vector of finite numbers.
    """
    check_needs(method.info, shape)
    return _check_numbers(method.describe(shape), method, (), "return a vector of finite numbers")


def compute_signature(scorer: Scorer, form: Mesh) -> SignatureArrays:
    """Compute the signature of a form, and check that it consists of named arrays.

    Raises
    ------
    ShapeError
        If the scorer refuses the form, for example one without extent.
    InvalidSignature
        If it returns anything but named arrays of finite numbers.
    """
    signature = scorer.signature(form)
    if not isinstance(signature, Mapping) or not signature:
        problem = f"{_name(scorer)} returned {type(signature).__name__}, not named arrays"
        raise InvalidSignature(problem, _SIGNATURE_HINT)
    for name, value in signature.items():
        if not isinstance(name, str) or not name.isidentifier():
            problem = f"{_name(scorer)} returned an array called {name!r:.80}"
            raise InvalidSignature(problem, "name it like a variable")
        if not _is_finite_array(value):
            problem = f"{_name(scorer)} returned '{name}', not an array of finite numbers"
            raise InvalidSignature(problem, _SIGNATURE_HINT)
    return dict(signature)


def _is_finite_array(value: object) -> bool:
    """Return whether a value is an array of finite numbers."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in _NUMBERS:
        return False
    return bool(np.isfinite(value).all())


def compute_distances(
    comparing: Descriptor | Scorer,
    outputs: Sequence[Any],
    draw: int = 0,
    queries: Sequence[Any] | None = None,
) -> FloatArray:
    """Return the checked distances of :func:`benchmark.pipeline.ranking.distances_of_draw`."""
    return distances_of_draw(comparing, make_distance_check(comparing), outputs, draw, queries)


def make_distance_check(comparing: Descriptor | Scorer) -> Check:
    """Return the check of the matrices of a scorer or descriptor.

    It returns them in double precision, or raises ``InvalidForm`` if they are anything but finite
    real numbers in the shape that is asked for.
    """

    def check(matrix: object, shape: tuple[int, int]) -> FloatArray:
        return _check_numbers(matrix, comparing, shape, _MATRIX_HINT)

    return check


def _check_numbers(
    output: object, component: object, shape: tuple[int, ...], hint: str
) -> FloatArray:
    """Return the output of a method or scorer as an array of floats, after checks.

    Parameters
    ----------
    output
        What it returned.
    component
        The method or scorer.
    shape
        The shape that the array must have; () stands for a vector that is not empty.
    hint
        What its author should do about anything else.

    Raises
    ------
    InvalidForm
        If it is no array of finite real numbers, or has another shape.
    """
    who = f"{_name(component)} returned"
    try:
        array: NDArray[Any] = np.asarray(output)
    except (TypeError, ValueError, RuntimeError) as error:  # rows of different lengths
        raise InvalidForm(f"{who} no array ({one_line(error)})", hint) from error
    is_vector = array.ndim == 1 and array.size > 0
    has_shape = array.shape == shape if shape else is_vector
    if not has_shape or array.dtype.kind not in _REAL_NUMBERS:
        raise InvalidForm(f"{who} an array of shape {array.shape} and type {array.dtype}", hint)
    if not np.isfinite(array).all():
        raise InvalidForm(f"{who} an array with NaN or infinite numbers", hint)
    return array.astype(np.float64)


def _name(component: Any) -> str:
    """Return file and name of a method or scorer, for messages."""
    kind = "scorer" if isinstance(component, Scorer) else "method"
    name = f"{kind} '{component.info.name}'"
    module = sys.modules.get(type(component).__module__)
    file = getattr(module, "__file__", None)
    return f"{Path(file).name}: {name}" if file else name
