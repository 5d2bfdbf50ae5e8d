"""Check the descriptions and results of plugins before use; values are never cast if that changes them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, Descriptor, FloatArray, Mesh, Method, MethodInfo, Shape
from benchmark.api.datasets import DatasetInfo, Entry
from benchmark.api.learning import Split
from benchmark.api.scoring import Scorer, ScorerInfo, SignatureArrays
from benchmark.errors import InvalidForm, InvalidMesh, InvalidSignature, one_line
from benchmark.execution.processes.process import one_of_us
from benchmark.text import LONGEST_NAME, RESERVED, clean, is_name

Note = NDArray[Any]
Info = MethodInfo | ScorerInfo | DatasetInfo

#: Problems with their hints.
Problems = Iterator[tuple[str, str]]

#: Maximum number of draws of a scorer; each ranks the whole gallery.
_MOST_DRAWS = 100

#: Maximum number of characters in the identifier, class and pose of a shape.
_LONGEST = 200

#: Name of the array that replaces a missing result: the problem, its hint, and the kind of error.
REFUSED = "refused"

_FORM_HINT = "return shape.form(vertices) with finite numbers, or raise UnsupportedShape with the reason"
_MATRIX_HINT = "return the distances of all pairs as a symmetric matrix of finite numbers"


def form_of(method: Method, shape: Shape) -> tuple[Mesh, dict[str, Note]]:
    """Return the form of a shape by a method, with its notes, which are numbers or text.

    Raises
    ------
    ShapeError
        If the method refuses the shape.
    InvalidForm
        If it returns anything other than a form of the shape.
    """
    who = f"method '{method.info.name}'"
    method.info.check(shape)
    try:
        with one_of_us():
            form = method.canonicalise(shape)
        if not isinstance(form, CanonicalForm):
            raise InvalidMesh(f"it is of type {type(form).__name__}, not CanonicalForm", _FORM_HINT)
        mesh = form.mesh
    except InvalidMesh as error:  # the shape is valid, so the method made it invalid
        raise InvalidForm(f"{who} returned no canonical form: {error.problem}", _FORM_HINT) from error
    notes = {}
    for name, value in form.notes.items():
        note = np.asarray(value) if np.isscalar(value) else None  # a ragged list cannot become an array
        if note is None or note.dtype.kind not in "biufU":
            what = f"{type(value).__name__} as note '{name}'"
            raise InvalidForm(f"{who} returned {what}", "notes must be numbers or strings")
        notes[name] = note
    return mesh, notes


def descriptor_of(method: Descriptor, shape: Shape) -> FloatArray:
    """Return the descriptor of a shape, shape (k,), float64.

    Raises
    ------
    ShapeError
        If the method refuses the shape.
    InvalidForm
        If it returns anything but a vector of finite numbers.
    """
    method.info.check(shape)
    with one_of_us():
        answer = method.describe(shape)
    return _real_numbers(f"method '{method.info.name}'", answer, (None,), "return a vector of finite numbers")


def distances_of(method: Descriptor, descriptors: Sequence[FloatArray]) -> FloatArray:
    """Return the dissimilarities of all pairs of descriptors, shape (N, N), float64.

    Raises
    ------
    InvalidForm
        If it returns anything but a square matrix of finite real numbers.
    """
    with one_of_us():
        answer = method.distances(descriptors)
    return _real_numbers(f"method '{method.info.name}'", answer, (len(descriptors),) * 2, _MATRIX_HINT)


def signature_of(scorer: Scorer, form: Mesh) -> SignatureArrays:
    """Return the signature of a form: named arrays.

    Raises
    ------
    ShapeError
        If the scorer refuses the form, for example one without extent.
    InvalidSignature
        If it returns anything but named arrays of finite numbers.
    """
    answer: object = scorer.signature(form)
    who, hint = f"scorer '{scorer.info.name}' returned", "return a mapping from names to arrays of finite numbers"
    if not isinstance(answer, Mapping) or not answer:
        raise InvalidSignature(f"{who} {type(answer).__name__}, not named arrays", hint)
    for name, value in answer.items():
        if not (isinstance(name, str) and name.isidentifier()) or name == REFUSED:
            hint = f"name it like a variable, and not '{REFUSED}'"
            raise InvalidSignature(f"{who} an array called {name!r:.80}", hint)
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf" or not np.isfinite(value).all():
            raise InvalidSignature(f"{who} '{name}', which is no array of finite numbers", hint)
    return dict(answer)


def form_distances(scorer: Scorer, signatures: Sequence[SignatureArrays], draw: int) -> FloatArray:
    """Return the dissimilarities of all pairs of forms for one draw of the scorer, shape (N, N).

    Raises
    ------
    InvalidForm
        If the scorer returns anything but a square matrix of finite real numbers.
    """
    answer = scorer.compare(signatures, draw)
    return _real_numbers(f"scorer '{scorer.info.name}'", answer, (len(signatures),) * 2, _MATRIX_HINT)


def _real_numbers(who: str, answer: object, shape: tuple[int | None, ...], hint: str) -> FloatArray:
    """Return an answer as an array of finite real numbers; None in ``shape`` stands for any length except 0."""
    try:
        array = np.asarray(answer)
    except (TypeError, ValueError, RuntimeError) as error:  # rows of different lengths
        raise InvalidForm(f"{who} returned no array ({one_line(error)})", hint) from error
    lengths = tuple(None if length is None and count else count for count, length in zip(array.shape, shape))  # noqa: B905
    if len(array.shape) != len(shape) or lengths != shape or array.dtype.kind not in "iuf":
        raise InvalidForm(f"{who} returned an array of shape {array.shape} and type {array.dtype}", hint)
    if not np.isfinite(array).all():
        raise InvalidForm(f"{who} returned an array with NaN or infinite numbers", hint)
    return array.astype(np.float64)


# Descriptions of plugins ---------------------------------------------------------------------------------------------


def _are_words(value: Any) -> bool:
    return isinstance(value, tuple | list) and all(isinstance(word, str) for word in value)


def _is_width(value: Any) -> bool:
    return value is None or (type(value) in (int, float) and 0 < value < 1e300)


def _is_bool(value: Any) -> bool:
    return isinstance(value, bool)


#: For each field of an info that is not text: the required type, and a hint.
_FIELDS: Mapping[str, tuple[Callable[[Any], bool], str]] = {
    "inputs": (
        lambda value: _are_words(value) and bool(value) and set(value) <= {"mesh", "view"},
        "name 'mesh', 'view' or both in a tuple",
    ),
    "scale": (lambda value: value in ("equivariant", "invariant"), "write 'equivariant' or 'invariant'"),
    "family": (lambda value: value in ("paper", "control", "extended"), "write 'extended'"),
    "deterministic": (_is_bool, "write True or False"),
    "invariant": (_is_bool, "write True or False"),
    "draws": (
        lambda value: type(value) is int and 1 <= value <= _MOST_DRAWS,
        f"write an integer from 1 to {_MOST_DRAWS}",
    ),
    "requires": (_are_words, "write a tuple of the import names of packages"),
    "files": (_are_words, "write a tuple of paths"),
    "half_width": (_is_width, "write a positive number in units of the meshes, or None"),
}


def problems_of(info: Info) -> Problems:
    """Return the problems in the description of a plugin, with hints."""
    if isinstance(info, MethodInfo) and isinstance(info.name, str) and info.name in RESERVED:
        yield f"name '{info.name}' stands for several methods on the command line", "choose another name"
    if not is_name(info.name):
        problem = f"name {info.name!r:.80} is not lower-case words joined by hyphens"
        yield problem, f"use lower-case words joined by hyphens, with {LONGEST_NAME} characters at most"
    for name in ("title", "summary", "departs", "cite"):
        text = getattr(info, name, "")
        if not isinstance(text, str) or "\n" in text:
            yield f"{name} {text!r:.80} is not a text of one line", "write a text"
    if isinstance(info.title, str) and not info.title.strip():
        yield "title is empty", "write the text for the tables"
    for name, (fits, hint) in _FIELDS.items():
        if hasattr(info, name) and not fits(value := getattr(info, name)):
            yield f"{name} {'are' if name == 'inputs' else 'is'} {value!r:.80}", hint


def problems_of_learner(learner: Any) -> Problems:
    """Return the problems in a learner's attributes about its models, with hints."""
    if not isinstance(learner.model_name, str) or not re.fullmatch(r"[\w.=-]+", learner.model_name):
        yield f"model_name is {learner.model_name!r}", "return a valid folder name"
    if learner.split not in get_args(Split):
        yield f"split is {learner.split!r}", f"choose one of {', '.join(get_args(Split))}"
    if not isinstance(getattr(learner, "shipped_models", None), Path):
        yield "shipped_models is not a path", "name a folder, which need not exist"


def problems_of_entries(entries: Sequence[Any]) -> Problems:
    """Return the problems in the shapes that a data set lists, with hints."""
    if not entries:
        yield "it lists no shapes", "let 'entries' list at least two classes, one of them with two shapes"
    for entry in entries:
        if not isinstance(entry, Entry):
            yield f"'entries' lists {type(entry).__name__}", "list Entry(identifier, subject, pose)"
            return
        for name in ("identifier", "subject", "pose"):
            text = getattr(entry, name)
            if not isinstance(text, str) or not 0 < len(text) <= _LONGEST or clean(text) != text:
                yield f"{name} {text!r:.80} is not a text of one line", f"write 1 to {_LONGEST} printable characters"
                return
        path: Any = entry.path
        if not isinstance(path, Path | None):
            yield f"path of '{entry.identifier}' is {type(path).__name__}", "pass a pathlib.Path"
            return
    for name, count in Counter(entry.identifier for entry in entries).most_common(1):
        if count > 1:
            yield f"two shapes are called '{name}'", "give each shape a unique identifier"
