"""What methods, descriptors and scorers return, checked: values are never cast if that changes them.

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

_LARGEST = float(np.finfo(np.float32).max)


def compute_output(method: Method | Descriptor, shape: Shape, shared: SharedResults) -> Arrays:
    """Return the arrays of a form or descriptor, or why the method refuses the shape; see :func:`output_arrays`.

    The reason is kept for the content of the shape, so that it does not begin with the name.

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
    """Raise ``UnsupportedShape`` unless a shape has what a method says that it needs."""
    if not info.needs:
        return
    name, n_vertices, n_faces = shape.identifier, shape.mesh.n_vertices, shape.mesh.n_faces
    if n_vertices < FEWEST_FORM_VERTICES or not n_faces:
        problem = f"{n_vertices} vertices and {n_faces} faces, where at least {FEWEST_FORM_VERTICES} and one are needed"
        raise UnsupportedShape(f"{name}: {problem}", "check how the shape was cut or decimated")
    n_pieces = int(connected_components(shape.mesh).max()) + 1
    if n_pieces > 1:
        hint = "keep the largest component or bridge the pieces first"
        raise UnsupportedShape(f"{name}: the surface is in {n_pieces} pieces", hint)
    if "pairs" in info.needs and n_vertices > MOST_WITH_ALL_PAIRS:
        problem = f"{n_vertices} vertices, where distances of all pairs are kept of {MOST_WITH_ALL_PAIRS} at most"
        hint = "decimate the surface, or choose a method that needs a few rows, such as accelerated-mds"
        raise UnsupportedShape(f"{name}: {problem}", hint)


def compute_form(method: Method, shape: Shape) -> CanonicalForm:
    """Return the form of a shape by a method; its notes are numbers or text.

    Raises
    ------
    ShapeError
        If the method refuses the shape.
    InvalidForm
        If it returns anything other than a form of the shape.
    """
    check_needs(method.info, shape)
    try:
        form: object = method.canonicalise(shape)
        if not isinstance(form, CanonicalForm):
            raise InvalidMesh(f"it is of type {type(form).__name__}, not CanonicalForm")
        mesh = form.mesh
    except InvalidMesh as error:  # the shape is valid, so the method made it invalid
        raise InvalidForm(
            f"{_name(method)} returned no canonical form: {error.problem}", _FORM_HINT
        ) from error
    if not len(mesh.faces) or np.abs(mesh.vertices).max() > _LARGEST:
        what = (
            "coordinates too large for single precision"
            if len(mesh.faces)
            else "a form without triangles"
        )
        raise InvalidForm(
            f"{_name(method)} returned {what}", "keep the scale and the triangles of the shape"
        )
    for name, value in form.notes.items():
        if name != brief(name, LONGEST_NAME):
            raise InvalidForm(
                f"{_name(method)} returned a note called {name!r:.80}",
                "give it a short printable name",
            )
        if not np.isscalar(value) or np.asarray(value).dtype.kind not in "biufU":
            problem = f"{_name(method)} returned {type(value).__name__} as note '{name}'"
            raise InvalidForm(problem, "notes must be numbers or strings")
    return CanonicalForm(mesh.vertices, mesh.faces, form.notes)


def compute_descriptor(method: Descriptor, shape: Shape) -> FloatArray:
    """Return the descriptor of a shape, shape (k,); raise ``ShapeError`` or ``InvalidForm`` if there is none."""
    check_needs(method.info, shape)
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
    signature, who = scorer.signature(form), _name(scorer)
    if not isinstance(signature, Mapping) or not signature:
        raise InvalidSignature(
            f"{who} returned {type(signature).__name__}, not named arrays", _SIGNATURE_HINT
        )
    for name, value in signature.items():
        if not (isinstance(name, str) and name.isidentifier()):
            raise InvalidSignature(
                f"{who} returned an array called {name!r:.80}", "name it like a variable"
            )
        if (
            not isinstance(value, np.ndarray)
            or value.dtype.kind not in "biuf"
            or not np.isfinite(value).all()
        ):
            raise InvalidSignature(
                f"{who} returned '{name}', not an array of finite numbers", _SIGNATURE_HINT
            )
    return dict(signature)


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
    return (
        f"{Path(file).name}: {kind} '{component.info.name}'"
        if file
        else f"{kind} '{component.info.name}'"
    )
