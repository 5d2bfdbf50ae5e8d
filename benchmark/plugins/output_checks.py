"""Checks of the output of a method or a scorer before it is used: nothing is cast that would change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, Descriptor, FloatArray, Mesh, Method, Shape
from benchmark.api.scoring import Scorer, SignatureArrays
from benchmark.errors import InvalidForm, InvalidMesh, InvalidSignature, one_line
from benchmark.execution.processes.process import one_of_us

Note = NDArray[Any]

#: Array that stands where there is no result: the problem, its hint, and the kind of error.
REFUSED = "refused"

_HINT = "return shape.form(vertices) with finite numbers, or raise UnsupportedShape with the reason"


def form_of(method: Method, shape: Shape) -> tuple[Mesh, dict[str, Note]]:
    """The form that a method makes of a shape, and what it notes, each a number or a text.

    Raises
    ------
    ShapeError
        If the method refuses the shape.
    InvalidForm
        If it returns what is no form of it.
    """
    try:
        with one_of_us():
            form = method.canonicalise(shape)
        if not isinstance(form, CanonicalForm):
            raise InvalidMesh(f"it is of type {type(form).__name__}, not CanonicalForm", _HINT)
        mesh = form.mesh
    except InvalidMesh as error:  # the shape is in order, so what is not was made of it
        raise InvalidForm(f"method '{method.info.name}' returned no canonical form: {error.problem}", _HINT) from error
    return mesh, {name: _note(method, name, value) for name, value in form.notes.items()}


def _note(method: Method, name: str, value: Any) -> Note:
    note = np.asarray(value) if np.isscalar(value) else None  # a ragged list could not even be an array
    if note is None or note.dtype.kind not in "biufU":
        raise InvalidForm(
            f"method '{method.info.name}' returned {type(value).__name__} as note '{name}'",
            "note numbers and strings only",
        )
    return note


def descriptor_of(method: Descriptor, shape: Shape) -> FloatArray:
    """The descriptor of a shape, shape (k,), float64.

    Raises
    ------
    ShapeError
        If the method refuses the shape.
    InvalidForm
        If it returns anything but a vector of finite numbers.
    """
    with one_of_us():
        found = method.describe(shape)
    return real_numbers(f"method '{method.info.name}'", found, (None,), "return a vector of finite numbers")


def distances_of(method: Descriptor, descriptors: Sequence[FloatArray]) -> FloatArray:
    """Dissimilarities that a descriptor finds between all pairs of shapes, shape (N, N), float64.

    Raises
    ------
    InvalidForm
        If it returns anything but a square matrix of finite real numbers.
    """
    count = len(descriptors)
    hint = "return the distances of all pairs as a symmetric matrix of finite numbers"
    with one_of_us():
        found = method.distances(descriptors)
    return real_numbers(f"method '{method.info.name}'", found, (count, count), hint)


def signature_of(scorer: Scorer, form: Mesh) -> SignatureArrays:
    """The signature of a form: named arrays.

    Raises
    ------
    ShapeError
        If the scorer refuses the form, which may have no extent.
    InvalidSignature
        If it returns anything but named arrays of finite numbers.
    """
    answer: object = scorer.signature(form)
    who, hint = f"scorer '{scorer.info.name}'", "return a mapping from names to arrays of finite numbers"
    if not isinstance(answer, Mapping) or not answer:
        raise InvalidSignature(f"{who} returned {type(answer).__name__}, not named arrays", hint)
    arrays: dict[str, NDArray[Any]] = {}
    for name, value in answer.items():
        if not (isinstance(name, str) and name.isidentifier()) or name == REFUSED:
            hint = f"name it like a variable, and not '{REFUSED}'"
            raise InvalidSignature(f"{who} returned an array called {name!r:.80}", hint)
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf" or not np.isfinite(value).all():
            raise InvalidSignature(f"{who} returned '{name}', which is no array of finite numbers", hint)
        arrays[name] = value
    return arrays


def form_distances(scorer: Scorer, signatures: Sequence[SignatureArrays], draw: int) -> FloatArray:
    """Dissimilarities of all pairs of forms under one draw of the scorer, shape (N, N).

    Raises
    ------
    InvalidForm
        If the scorer returns anything but a square matrix of finite real numbers.
    """
    count = len(signatures)
    hint = "return the distances of all pairs as a symmetric matrix of finite numbers"
    return real_numbers(f"scorer '{scorer.info.name}'", scorer.compare(signatures, draw), (count, count), hint)


def real_numbers(who: str, answer: object, shape: tuple[int | None, ...], hint: str) -> FloatArray:
    """An answer as an array of finite real numbers; any length but 0 will do where the shape is None."""
    try:
        found = np.asarray(answer)
    except (TypeError, ValueError, RuntimeError) as error:  # rows of different lengths
        raise InvalidForm(f"{who} returned no array ({one_line(error)})", hint) from error
    fits = len(found.shape) == len(shape) and all(
        count == wanted if wanted is not None else count for count, wanted in zip(found.shape, shape, strict=True)
    )
    if not fits or found.dtype.kind not in "iuf":
        what = f"an array of shape {found.shape} and type {found.dtype}"
    elif not np.isfinite(found).all():
        what = "an array with NaN or infinite numbers"
    else:
        return found.astype(np.float64)
    raise InvalidForm(f"{who} returned {what}", hint)
