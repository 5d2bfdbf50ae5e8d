"""Stages of one shape: the prepared mesh or view, and its canonical form or descriptor."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Descriptor, Method, Shape
from benchmark.errors import InvalidForm, InvalidMesh
from benchmark.geometry.camera import Camera, DepthSensor
from benchmark.geometry.cleaning import clean
from benchmark.geometry.depth import common_half_width, depth_surface, fit_half_width
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from benchmark.plugins.output_checks import descriptor_of, form_of

Arrays = Mapping[str, NDArray[Any]]

#: Number of vertices of the prepared mesh, as usual for canonical forms (Lian et al. 2013, Pickup et al. 2018).
N_VERTICES = 2000


def complete(source: Mesh) -> Arrays:
    """Clean, join, decimate and scale a mesh.

    Parameters
    ----------
    source
        The mesh as loaded from the data set.

    Returns
    -------
    dict
        ``vertices`` and ``faces`` of the prepared surface, of unit area; ``source_area`` in squared file units;
        ``note:...`` for each note of the preparation.

    Raises
    ------
    ShapeError
        If the mesh has no usable part.
    """
    prepared = prepare(source, N_VERTICES)
    return {
        "vertices": prepared.mesh.vertices,
        "faces": prepared.mesh.faces,
        "source_area": np.asarray(prepared.source_area),
        **{f"note:{name}": np.asarray(value) for name, value in prepared.report.items()},
    }


def seen(source: Mesh, camera: Camera, half_width: float, sensor: DepthSensor | None = None) -> Arrays:
    """Render a mesh and back-project the depth image.

    Parameters
    ----------
    source
        The mesh as loaded from the data set.
    camera
        The camera.
    half_width
        Half the width of the frame in file units.
    sensor
        Sensor whose errors are added; None for an ideal camera.

    Returns
    -------
    dict
        ``vertices`` and ``faces`` of the visible surface, of unit area; ``depth``, shape (500, 500), float32;
        ``source_area`` in squared file units; ``note:...`` for each note of the projection.

    Raises
    ------
    ShapeError
        If no part of the mesh is visible.
    """
    view = depth_surface(_surface(source), camera, half_width, sensor)
    area = view.surface.area
    return {
        "vertices": view.surface.vertices / np.sqrt(area),
        "faces": view.surface.faces,
        "depth": view.depth,
        "source_area": np.asarray(area),
        **{f"note:{name}": np.asarray(value) for name, value in dataclasses.asdict(view.report).items()},
    }


def half_width_of(source: Mesh, camera: Camera) -> float:
    """Return half the width of the frame that a mesh fills, in file units; raise ``ShapeError`` without a surface."""
    return fit_half_width([_surface(source)], camera)


def frame_of(half_widths: Sequence[float]) -> float:
    """Return half the width of the frame of a data set, from those of its shapes; arbitrary without shapes."""
    return common_half_width(half_widths) if half_widths else 1.0


def _surface(source: Mesh) -> Mesh:
    """Return the mesh without unreferenced vertices, which would move the centre and the frame of the camera."""
    surface, cleaning = clean(source)
    if not surface.n_faces:
        raise InvalidMesh(f"none of the {cleaning.faces_before} triangles has an area", "export the mesh again")
    return surface


def canonicalise(method: Method, shape: Shape) -> Arrays:
    """Compute the form of a shape.

    Coordinates are rounded to single precision, an error of 1e-7 that is negligible for all scorers. The scored form is
    therefore the same whether it was just computed or read from the store.

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
        If it returns anything other than a form of the shape.
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
    """Return the form of a shape with this mesh, from the arrays of :func:`canonicalise`."""
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
