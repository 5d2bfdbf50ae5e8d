"""The canonical form of a shape, or its descriptor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.contracts import Descriptor, Mesh, Method, Shape
from benchmark.errors import InvalidMesh

Arrays = Mapping[str, NDArray[Any]]


def canonicalise(method: Method, shape: Shape) -> Arrays:
    """Make the form of a shape.

    Coordinates are kept in single precision, a ten-millionth of their size and far below anything that the scorer
    sees; so the form that is scored is the same whether it was just made or read again.

    Returns
    -------
    dict
        ``vertices``, shape (n, 3), float32; ``faces`` where they are not those of the shape; ``note:...`` for each
        note of the method.

    Raises
    ------
    ShapeError
        If the method refuses the shape, or a coordinate is not finite.
    """
    form = method.canonicalise(shape)
    mesh = form.mesh  # raises when the method returned NaN
    with np.errstate(over="ignore"):
        vertices = mesh.vertices.astype(np.float32)
    if not np.isfinite(vertices).all():
        raise InvalidMesh("the form is too large for single precision", "keep the scale of the shape")
    arrays: dict[str, NDArray[Any]] = {"vertices": vertices}
    if mesh.faces.shape != shape.mesh.faces.shape or (mesh.faces != shape.mesh.faces).any():
        arrays["faces"] = mesh.faces
    return {**arrays, **{f"note:{name}": np.asarray(value) for name, value in form.notes.items()}}


def form_mesh(arrays: Arrays, shape: Mesh) -> Mesh:
    """The form that :func:`canonicalise` made of a shape with this mesh."""
    return Mesh(arrays["vertices"], arrays.get("faces", shape.faces))


def describe(method: Descriptor, shape: Shape) -> Arrays:
    """Make the descriptor of a shape: ``descriptor``, shape (k,), float64."""
    return {"descriptor": np.asarray(method.describe(shape), dtype=np.float64)}
