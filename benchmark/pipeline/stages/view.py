"""View input: what one depth camera sees, as a depth image and as an open surface."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import InvalidMesh
from benchmark.geometry.camera import Camera, DepthSensor
from benchmark.geometry.cleaning import clean
from benchmark.geometry.depth import common_half_width, depth_surface, fit_half_width
from benchmark.geometry.mesh import Mesh


def seen(
    source: Mesh, camera: Camera, half_width: float, sensor: DepthSensor | None = None
) -> Mapping[str, NDArray[Any]]:
    """Render a mesh and project the image back.

    Parameters
    ----------
    source
        The mesh as the data set gives it.
    camera
        The camera.
    half_width
        Half the width of the frame in file units.
    sensor
        Errors of a real camera; None for an ideal one.

    Returns
    -------
    dict
        ``vertices`` and ``faces`` of the visible surface, of unit area; ``depth``, shape (500, 500), float32;
        ``source_area`` in squared file units; ``note:...`` for each fact that the projection reports.

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
    """Return half the width of the frame of a data set, from those of its shapes; any value without shapes."""
    return common_half_width(half_widths) if half_widths else 1.0


def _surface(source: Mesh) -> Mesh:
    """Return the mesh without unreferenced vertices, which would move the centre and the frame of the camera."""
    surface, cleaning = clean(source)
    if not surface.n_faces:
        raise InvalidMesh(f"none of the {cleaning.faces_before} triangles has an area", "export the mesh again")
    return surface
