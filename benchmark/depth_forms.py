"""The canonical form of what a depth camera sees."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.api.contracts import CanonicalForm, Method, Shape
from benchmark.depth.errors import InvalidIntrinsics
from benchmark.depth.frame import ObservedObject, Up, observe
from benchmark.depth.intrinsics import Intrinsics, parse_intrinsics
from benchmark.depth.projection import HALF_WIDTH, UPRIGHT
from benchmark.depth.reading import in_metres
from benchmark.errors import ConfigurationError
from benchmark.geometry.depth import depth_surface
from benchmark.plugins.output_checks import form_of
from benchmark.plugins.registry import methods, variant
from benchmark.protocols.models import with_model

__all__ = ["DepthForm", "canonical_form_of_depth", "form_of_object", "method_of_depth"]

#: Numbers of fx, fy, cx, cy, and shapes of matrices that hold them.
_FOUR, _MATRICES = (4,), ((3, 3), (4, 4))


@dataclass(frozen=True, eq=False)
class DepthForm:
    """The canonical form of the object of one frame, and what it was made from.

    Parameters
    ----------
    observed
        The object.
    shape
        What the method was given.
    form
        The canonical form; its notes tell how the object was found, and what the method noted.
    """

    observed: ObservedObject
    shape: Shape
    form: CanonicalForm


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
) -> CanonicalForm:
    """Return the canonical form of the object of a depth image; a loop loads the model once.

    Parameters
    ----------
    depth
        Shape (h, w): depths along the optical axis, in metres or, of integers, in millimetres; 0, NaN and infinity mean
        that nothing was seen.
    intrinsics
        Matrix of the camera, shape (3, 3) or (4, 4), or fx, fy, cx, cy in pixels, or
        :class:`~benchmark.depth.intrinsics.Intrinsics`, which may be distorted.
    mask
        Shape (h, w), not zero on the object; None finds it, see docs/how-to/depth-camera.md.
    method
        Name of a method that makes forms of views, with parameters in brackets if need be.
    scale
        Units of ``depth`` per metre; None takes 1000 for integers and 1 for floats.
    up
        What is up in the camera's frame (right, down, forward), where no floor is seen; None takes the image's.
    half_width
        Half the side of the frame that the object has to fit, in metres; models that know a scale know this one.
    seed
        Base seed.

    Returns
    -------
    CanonicalForm
        ``vertices``, shape (n, 3), of unit area where the method is one of the learned; ``faces``, shape (m, 3);
        ``notes``: how the object was found, and what the method noted.

    Raises
    ------
    benchmark.depth.errors.DepthError
        If depth, intrinsics or mask cannot be used, or no object is found that fits the frame.
    ShapeError
        If the method refuses the shape.
    ConfigurationError
        If there is no such method, or it makes no forms of views.
    """
    maker = method_of_depth(method)
    given = None if mask is None else np.asarray(mask)
    observed = observe(in_metres(np.asarray(depth), scale), _camera(intrinsics), given, up, half_width)
    return form_of_object(observed, maker, half_width=half_width, seed=seed).form


@functools.lru_cache(maxsize=8)
def method_of_depth(name: str, plugins: tuple[Path, ...] = ()) -> Method:
    """Return a method that makes forms of views; raises ``ConfigurationError`` for any other."""
    spec = variant(name, methods(plugins))
    if missing := spec.missing_packages():
        raise ConfigurationError(f"method '{name}' needs {', '.join(missing)}", f"pip install {' '.join(missing)}")
    maker = with_model(spec)
    if not isinstance(maker, Method):
        raise ConfigurationError(f"method '{name}' describes shapes without a canonical form", "choose another method")
    if "view" not in spec.info.inputs:
        raise ConfigurationError(
            f"method '{name}' reads complete surfaces, and a depth image shows one side", "choose one that reads views"
        )
    return maker


def form_of_object(
    observed: ObservedObject,
    maker: Method,
    name: str = "depth",
    *,
    half_width: float = HALF_WIDTH,
    seed: int = 0,
) -> DepthForm:
    """Return the canonical form of an object that was seen.

    Parameters
    ----------
    observed
        See :func:`benchmark.depth.frame.observe`.
    maker
        The method; see :func:`method_of_depth`.
    name
        What random choices depend on beside the seed.
    half_width, seed
        As of :func:`canonical_form_of_depth`.

    Raises
    ------
    ShapeError
        If the method refuses the shape.
    """
    view = depth_surface(observed.surface, UPRIGHT, half_width)
    area = view.surface.area
    mesh = view.surface.with_vertices(view.surface.vertices / np.sqrt(area))
    shape = Shape(identifier=name, mesh=mesh, depth=view.depth, source_area=area, seed=seed)
    form, notes = form_of(maker, shape)
    return DepthForm(
        observed, shape, CanonicalForm(form.vertices, form.faces, {**observed.notes, **plain_notes(notes)})
    )


def plain_notes(notes: Mapping[str, NDArray[Any]]) -> dict[str, float | str]:
    """Return the notes of a method as texts and numbers."""
    return {name: str(note) if note.dtype.kind == "U" else float(note) for name, note in notes.items()}


def _camera(value: Intrinsics | ArrayLike | Sequence[float]) -> Intrinsics:
    if isinstance(value, Intrinsics):
        return value
    array = np.asarray(value, dtype=np.float64)
    if array.shape not in (_FOUR, *_MATRICES):
        raise InvalidIntrinsics(
            f"an array of shape {array.shape} is no camera", "pass a 3 x 3 matrix or fx, fy, cx, cy"
        )
    return parse_intrinsics(" ".join(map(repr, array.ravel().tolist())))
