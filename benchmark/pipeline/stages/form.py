"""The canonical form of a shape, or its descriptor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Descriptor, Mesh, Method, Shape
from benchmark.errors import InvalidForm
from benchmark.plugins.output_checks import descriptor_of, form_of

Arrays = Mapping[str, NDArray[Any]]


def canonicalise(method: Method, shape: Shape) -> Arrays:
    """Compute the form of a shape.

    Coordinates are rounded to single precision, an error of 1e-7 that no scorer can see. The form that is scored is
    therefore the same whether it was just computed or read again.

    Returns
    -------
    dict
        ``vertices``, shape (n, 3), float32; ``faces`` if they differ from those of the shape; ``note:...`` for each
        note of the method.

    Raises
    ------
    ShapeError
        If the method refuses the shape.
    InvalidForm
        If it returns something else than a form of the shape.
    """
    mesh, notes = form_of(method, shape)
    with np.errstate(over="ignore"):
        vertices = mesh.vertices.astype(np.float32)
    if not (np.isfinite(vertices).all() and mesh.n_faces):
        what = "coordinates too large for single precision" if mesh.n_faces else "a form without triangles"
        raise InvalidForm(
            f"method '{method.info.name}' returned {what}", "keep the scale and the triangles of the shape"
        )
    arrays: dict[str, NDArray[Any]] = {"vertices": vertices}
    if mesh.faces.shape != shape.mesh.faces.shape or (mesh.faces != shape.mesh.faces).any():
        arrays["faces"] = mesh.faces
    return {**arrays, **{f"note:{name}": note for name, note in notes.items()}}


def form_mesh(arrays: Arrays, shape: Mesh) -> Mesh:
    """Return the form that :func:`canonicalise` computed of a shape with this mesh."""
    return Mesh(arrays["vertices"], arrays.get("faces", shape.faces))


def describe(method: Descriptor, shape: Shape) -> Arrays:
    """Compute the descriptor of a shape: ``descriptor``, shape (k,), float64.

    Raises
    ------
    ShapeError
        If the method refuses the shape.
    InvalidForm
        If it returns anything but a vector of finite numbers.
    """
    return {"descriptor": descriptor_of(method, shape)}
