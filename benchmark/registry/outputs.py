"""Call methods, descriptors and scorers, and check what they return; values are never cast if that changes them."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, Descriptor, FloatArray, Method, Shape
from benchmark.api.scoring import Scorer, SignatureArrays
from benchmark.errors import InvalidForm, InvalidMesh, InvalidSignature, one_line
from benchmark.geometry.mesh import Mesh

_FORM_HINT = "return shape.form(vertices) with finite numbers, or raise UnsupportedShape with the reason"
_MATRIX_HINT = "return the distances of all pairs as a symmetric matrix of finite numbers"
_SIGNATURE_HINT = "return a mapping from names to arrays of finite numbers"


def compute_form(method: Method, shape: Shape) -> tuple[Mesh, dict[str, NDArray[Any]]]:
    """Return the form of a shape by a method, with its notes, which are numbers or text.

    Raises
    ------
    ShapeError
        If the method refuses the shape.
    InvalidForm
        If it returns anything other than a form of the shape.
    """
    who = f"{_name(method)} returned"
    method.info.check(shape)
    try:
        form = method.canonicalise(shape)
        if not isinstance(form, CanonicalForm):
            raise InvalidMesh(f"it is of type {type(form).__name__}, not CanonicalForm", _FORM_HINT)
        mesh = form.mesh
    except InvalidMesh as error:  # the shape is valid, so the method made it invalid
        raise InvalidForm(f"{who} no canonical form: {error.problem}", _FORM_HINT) from error
    notes = {}
    for name, value in form.notes.items():
        note = np.asarray(value) if np.isscalar(value) else None  # a ragged list cannot become an array
        if note is None or note.dtype.kind not in "biufU":
            raise InvalidForm(f"{who} {type(value).__name__} as note '{name}'", "notes must be numbers or strings")
        notes[name] = note
    return mesh, notes


def compute_descriptor(method: Descriptor, shape: Shape) -> FloatArray:
    """Return the descriptor of a shape, shape (k,); raise ``ShapeError`` or ``InvalidForm`` if there is none."""
    hint = "return a vector of finite numbers"
    method.info.check(shape)
    return _real_numbers(_name(method), method.describe(shape), (), hint)


def compute_distances(method: Descriptor, descriptors: Sequence[FloatArray]) -> FloatArray:
    """Return the dissimilarities of all pairs of descriptors, shape (N, N); raise ``InvalidForm`` without."""
    return _real_numbers(_name(method), method.distances(descriptors), (len(descriptors),) * 2, _MATRIX_HINT)


def compute_signature(scorer: Scorer, form: Mesh) -> SignatureArrays:
    """Return the signature of a form: named arrays.

    Raises
    ------
    ShapeError
        If the scorer refuses the form, for example one without extent.
    InvalidSignature
        If it returns anything but named arrays of finite numbers.
    """
    signature: object = scorer.signature(form)
    who = f"{_name(scorer)} returned"
    if not isinstance(signature, Mapping) or not signature:
        raise InvalidSignature(f"{who} {type(signature).__name__}, not named arrays", _SIGNATURE_HINT)
    for name, value in signature.items():
        if not (isinstance(name, str) and name.isidentifier()):
            raise InvalidSignature(f"{who} an array called {name!r:.80}", "name it like a variable")
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf" or not np.isfinite(value).all():
            raise InvalidSignature(f"{who} '{name}', which is no array of finite numbers", _SIGNATURE_HINT)
    return dict(signature)


def compare_signatures(scorer: Scorer, signatures: Sequence[SignatureArrays], draw: int) -> FloatArray:
    """Return the dissimilarities of all pairs of forms for one draw of the scorer, shape (N, N).

    Raises
    ------
    InvalidForm
        If the scorer returns anything but a square matrix of finite real numbers.
    """
    return _real_numbers(_name(scorer), scorer.compare(signatures, draw), (len(signatures),) * 2, _MATRIX_HINT)


def _name(component: Any) -> str:
    """Return file and name of a method or scorer, for messages."""
    file = getattr(sys.modules.get(type(component).__module__), "__file__", None)
    kind = "scorer" if isinstance(component, Scorer) else "method"
    return f"{Path(file).name}: {kind} '{component.info.name}'" if file else f"{kind} '{component.info.name}'"


def _real_numbers(who: str, answer: object, shape: tuple[int, ...], hint: str) -> FloatArray:
    """Return an answer as an array of finite real numbers of a shape; () stands for a vector that is not empty."""
    try:
        array = np.asarray(answer)
    except (TypeError, ValueError, RuntimeError) as error:  # rows of different lengths
        raise InvalidForm(f"{who} returned no array ({one_line(error)})", hint) from error
    fits = array.shape == shape if shape else array.ndim == 1 and array.size
    if not fits or array.dtype.kind not in "iuf":
        raise InvalidForm(f"{who} returned an array of shape {array.shape} and type {array.dtype}", hint)
    if not np.isfinite(array).all():
        raise InvalidForm(f"{who} returned an array with NaN or infinite numbers", hint)
    return array.astype(np.float64)
