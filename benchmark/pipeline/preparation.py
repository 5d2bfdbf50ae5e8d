"""Prepare a shape: the complete surface, or the part that a depth camera sees. Pure functions from meshes to arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import InvalidMesh
from benchmark.geometry.camera import Camera, DepthSensor
from benchmark.geometry.cleaning import clean
from benchmark.geometry.depth import depth_surface, fit_half_width
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare

Arrays = Mapping[str, NDArray[Any]]

#: Number of vertices of the prepared mesh, as usual for canonical forms (Lian et al. 2013, Pickup et al. 2018).
N_VERTICES = 2000


def prepare_mesh(source: Mesh) -> Arrays:
    """Clean, join, decimate and scale a mesh.

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


def prepare_view(source: Mesh, camera: Camera, half_width: float, sensor: DepthSensor | None = None) -> Arrays:
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
        As :func:`prepare_mesh`, of the visible surface, and ``depth``, shape (500, 500), float32.

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
        **{f"note:{name}": np.asarray(value) for name, value in view.report.items()},
    }


def fit_frame(source: Mesh, camera: Camera) -> float:
    """Return half the width of the frame that a mesh fills, in file units; raise ``ShapeError`` without a surface."""
    return fit_half_width([_surface(source)], camera)


def _surface(source: Mesh) -> Mesh:
    """Return the mesh without unreferenced vertices, which would move the centre and the frame of the camera."""
    surface, cleaning = clean(source)
    if not surface.n_faces:
        raise InvalidMesh(f"none of the {cleaning['faces_before']} triangles has an area", "export the mesh again")
    return surface
