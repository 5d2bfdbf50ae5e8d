"""Canonical forms of surfaces, and of objects in depth images."""

from __future__ import annotations

import functools
import warnings
from bdb import BdbQuit
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from benchmark.api.contracts import Method, Shape
from benchmark.api.learning import MeasuresFit
from benchmark.commands.form import Form
from benchmark.depth.frame import HALF_WIDTH, UPRIGHT, ObservedObject, Up, observe, scale_of
from benchmark.depth.intrinsics import Intrinsics, camera_of
from benchmark.depth.reading import in_metres
from benchmark.errors import (
    BenchmarkError,
    ConfigurationError,
    DepthError,
    UnsupportedShape,
    locate,
    with_hint,
)
from benchmark.geometry.depth import depth_surface
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from benchmark.machine import copies_end
from benchmark.pipeline.outputs import compute_form
from benchmark.pipeline.surfaces import PREPARED_VERTICES
from benchmark.protocols.models import people_training, with_model
from benchmark.registry import Component, select_one

#: Size in metres below which an object is hardly a person.
_SMALLEST_PERSON = 1.0

__all__ = ["canonical_form_of_depth", "form_of_object", "method_of_depth", "small_for_person"]


def canonical_form_of_depth(
    depth: ArrayLike,
    intrinsics: Intrinsics | ArrayLike,
    mask: ArrayLike | None = None,
    method: str = "learned-streamed",
    *,
    scale: float | None = None,
    up: Up | None = None,
    half_width: float = HALF_WIDTH,
    seed: int = 0,
) -> Form:
    """Return the canonical form of the object in a depth image.

    The model is loaded once and cached.

    Parameters
    ----------
    depth
        Shape (h, w): depths along the optical axis, floats in metres or integers in millimetres; 0,
        NaN and infinity mark missing values.
    intrinsics
        Matrix of the camera, shape (3, 3) or (4, 4), or fx, fy, cx, cy in pixels, or
        :class:`~benchmark.depth.intrinsics.Intrinsics`, which may be distorted.
    mask
        Shape (h, w), nonzero on the object; None segments it, see docs/how-to/depth-camera.md.
    method
        Name of a method that accepts views, with optional parameters in brackets.
    scale
        Units of ``depth`` per metre; None means 1000 for integers and 1 for floats.
    up
        Upward direction in the camera's coordinates (right, down, forward) if no floor is visible;
        None means the image's.
    half_width
        Half the side of the square frame that must contain the object, in metres; networks that see
        size are trained with the default.
    seed
        Seed of all random choices.

    Returns
    -------
    Form
        ``vertices``, shape (n, 3), with unit area for learned methods; ``faces``, shape (m, 3);
        ``notes``: how the object was segmented, and the notes of the method.

    Raises
    ------
    benchmark.errors.DepthError
        If depth, intrinsics or mask are invalid, or no object fits the frame.
    ShapeError
        If the method refuses the shape.
    ConfigurationError
        If there is no such method, or it computes no forms from views.
    """
    maker = method_of_depth(method)
    if not isinstance(intrinsics, Intrinsics):
        intrinsics = camera_of(_camera_numbers(intrinsics))
    if scale is not None:
        _check_positive("scale", scale, "pass the units of the depths per metre")
    _check_positive("half_width", half_width, "pass metres")
    if mask is not None:
        mask = np.asarray(np.ma.filled(mask, 0))
    # What is masked has no reading; without a mask of numpy, nothing changes.
    values = np.asarray(np.ma.filled(depth, 0))
    depths = in_metres(values, scale_of(values, intrinsics, scale))
    observed = observe(depths, intrinsics, mask, up, half_width)
    return form_of_object(observed, maker, half_width=half_width, seed=seed)


def _camera_numbers(intrinsics: ArrayLike) -> list[float]:
    """Return the numbers of a camera in one list; raise ``DepthError`` if they are no numbers."""
    try:
        return [float(number) for number in np.asarray(intrinsics, dtype=np.float64).ravel()]
    except (TypeError, ValueError) as error:
        problem = f"intrinsics of type {type(intrinsics).__name__} are no numbers"
        hint = "pass fx, fy, cx, cy, a 3 x 3 matrix, or benchmark.depth.intrinsics.Intrinsics"
        raise DepthError(problem, hint) from error


def _check_positive(name: str, value: Any, hint: str) -> None:
    """Raise ``DepthError`` unless a parameter is a positive, finite number."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not 0 < value < np.inf:
        raise DepthError(f"{name} is no positive number: {value!r:.40}", hint)


@functools.lru_cache(maxsize=8)
def method_of_depth(name: str, plugins: tuple[Path, ...] = ()) -> Method:
    """Return a method that computes forms from views.

    Raise ``ConfigurationError`` for any other.
    """
    component = select_one(name, plugins)
    maker = form_maker(component)
    if "view" not in component.info.inputs:
        problem = f"method '{name}' reads complete surfaces, and a depth image shows one side"
        raise ConfigurationError(problem, "choose one that reads views")
    return maker


def form_maker(component: Component) -> Method:
    """Return a method with its default model.

    Raise ``ConfigurationError`` if it computes no forms.
    """
    maker = with_model(component)
    if not isinstance(maker, Method):
        raise ConfigurationError(
            f"method '{component.name}' computes no forms", "choose another method"
        )
    return maker


def form_of_object(
    observed: ObservedObject,
    maker: Method,
    name: str = "depth",
    *,
    half_width: float = HALF_WIDTH,
    seed: int = 0,
) -> Form:
    """Return the canonical form of an object that was segmented in a depth image.

    Parameters
    ----------
    observed
        Surface of the object, and what is doubtful about it; see
        :func:`benchmark.depth.frame.observe`.
    maker
        The method; see :func:`method_of_depth`.
    name
        Identifier of the shape.
    half_width
        Half the side of the square frame that must contain the object, in metres.
    seed
        Seed of all random choices.

    Returns
    -------
    Form
        The form; its note ``"doubt"`` says what may be wrong with it.

    Raises
    ------
    ShapeError
        If the method refuses the shape.
    """
    view = depth_surface(observed.surface, UPRIGHT, half_width)
    area = view.surface.area  # square metres; methods take surfaces of unit area
    mesh = view.surface.with_vertices(view.surface.vertices / np.sqrt(area))
    shape = Shape(identifier=name, mesh=mesh, depth=view.depth, source_area=area, seed=seed)
    notes = dict(observed.notes)
    n_pieces = float(view.report["pieces"])
    if n_pieces > 1:
        notes["joined_pieces"] = n_pieces
    form = form_with_notes(maker, shape, notes)
    # Doubts come from the segmentation, the size of the object, and the method ("" for none).
    doubts = [with_hint(what, hint) for what, hint in observed.doubts]
    doubts += [small_for_person(shape, maker), str(form.notes.get("doubt", ""))]
    doubt = "; ".join(filter(None, doubts))
    if not doubt:
        return form
    return replace(form, notes={**form.notes, "doubt": doubt})


def small_for_person(shape: Shape, model: object) -> str:
    """Return a warning if a view in metres is small, and a model was shown people alone; or "".

    Parameters
    ----------
    shape
        The view, with the area of its source.
    model
        A method with a model, or the folder of a model.
    """
    size = float(np.ptp(shape.mesh.vertices, axis=0).max() * np.sqrt(shape.source_area or 0.0))
    if size >= _SMALLEST_PERSON or not people_training(model):
        return ""
    return f"{size:.2g} m is small for a person, so the depth scale may be wrong"


def form_of_surface(
    maker: Method,
    mesh: Mesh,
    name: str = "shape",
    *,
    n_vertices: int = PREPARED_VERTICES,
    seed: int = 0,
) -> Form:
    """Return the form of a surface, prepared as in a run.

    Where each vertex of the surface has one of its own in the prepared surface, the form has those
    of the surface in their order; otherwise it has those of the prepared surface, and says in
    ``vertex_map`` which one of the surface is nearest.
    """
    prepared = prepare(mesh, n_vertices)
    shape = Shape(identifier=name, mesh=prepared.mesh, source_area=prepared.source_area, seed=seed)
    form = form_with_notes(maker, shape, prepared.notes)
    if not np.array_equal(form.faces, prepared.mesh.faces):
        return form
    numbers = prepared.numbers_of(mesh)
    # Where sheets touch in a vertex, preparation gives each sheet one: they part in the form.
    if numbers is None or len(np.unique(numbers)) < prepared.mesh.n_vertices:
        return replace(form, vertex_map=prepared.vertex_map(mesh))
    return replace(form, vertices=form.vertices[numbers], faces=mesh.faces, body=mesh)


def form_with_notes(maker: Method, shape: Shape, first: Mapping[str, float | str]) -> Form:
    """Compute the form of a shape, with notes of the method on it.

    Parameters
    ----------
    maker
        The method.
    shape
        The prepared shape.
    first
        Further notes by name, which stand before those of the method.
    """
    with copies_end():
        form = compute_form(maker, shape)
    notes = dict(first)
    for name, note in form.notes.items():
        notes[name] = str(note) if isinstance(note, str) else float(note)
    notes.update(measured_fit(maker, shape))
    body = None
    if np.array_equal(form.faces, shape.mesh.faces):  # the form is the shape with moved vertices
        body = shape.mesh
    title = f"{shape.identifier}, {maker.info.title}"
    return Form(form.vertices, form.faces, notes, body=body, title=title)


@contextmanager
def plugins_may_fail(*components: Component) -> Iterator[None]:
    """Turn what plugins raise into ``ShapeError``, so that it is one line of a command.

    Where all components are of the suite, nothing is changed: what they raise is an error of it.
    """
    try:
        yield
    except (BenchmarkError, BdbQuit):
        raise
    except (Exception, SystemExit) as error:
        if all(component.of_suite for component in components):
            raise
        problem = f"the code of a plugin failed: {locate(error)}"
        hint = "'python -m benchmark check FILE --traceback' prints such errors in full"
        raise UnsupportedShape(problem, hint) from error


def measured_fit(maker: object, shape: Shape) -> dict[str, float | str]:
    """Return the notes of a learner that measures its fit apart, as learners once did."""
    if not isinstance(maker, MeasuresFit):
        return {}
    warnings.warn(
        f"{type(maker).__name__}.measure_fit is deprecated: return its notes with the form",
        DeprecationWarning,
        stacklevel=2,
    )
    return dict(maker.measure_fit(shape))
