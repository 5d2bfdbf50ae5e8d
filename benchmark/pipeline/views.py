"""What a depth camera sees of a mesh: the prepared shapes of the input ``view``, and its frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from benchmark.errors import InvalidMesh
from benchmark.pipeline.stages import NOTE, Arrays

if TYPE_CHECKING:
    from benchmark.geometry.camera import Camera, DepthSensor
    from benchmark.geometry.mesh import Mesh


def prepare_view(
    source: Mesh, camera: Camera, half_width: float, sensor: DepthSensor | None = None
) -> Arrays:
    """Render a depth image of a mesh, and make a surface of what the image shows.

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
        ``vertices`` and ``faces`` of the visible surface, of unit area; ``depth``, the image, shape
        (500, 500), float32; ``source_area`` of the surface in squared file units; ``note:...`` for
        each note of the rendering.

    Raises
    ------
    ShapeError
        If no part of the mesh is visible.
    """
    from benchmark.geometry.depth import depth_surface  # it takes a second to import

    view = depth_surface(_surface(source), camera, half_width, sensor)
    area = view.surface.area
    notes = {f"{NOTE}{name}": np.asarray(value) for name, value in view.report.items()}
    return {
        "vertices": view.surface.vertices / np.sqrt(area),  # to unit area
        "faces": view.surface.faces,
        "depth": view.depth,
        "source_area": np.asarray(area),
        **notes,
    }


def fit_frame(source: Mesh, camera: Camera) -> float:
    """Return half the width of the frame that a mesh fills, in file units.

    Raises
    ------
    ShapeError
        If the mesh has no surface.
    """
    from benchmark.geometry.depth import fit_half_width

    return fit_half_width(_surface(source), camera)


def common_frame(half_widths: Sequence[float]) -> float:
    """Return half the width of the frame that fits all shapes, in file units.

    Parameters
    ----------
    half_widths
        Half the width of the frame that each shape fills; without any, the result is arbitrary.
    """
    from benchmark.geometry.depth import common_half_width

    return common_half_width(half_widths) if half_widths else 1.0


def _surface(source: Mesh) -> Mesh:
    """Return a mesh without unreferenced vertices, which would move the frame of the camera."""
    from benchmark.geometry.cleaning import clean

    surface, report = clean(source)
    if not surface.n_faces:
        problem = f"none of the {report['faces_before']} triangles has an area"
        raise InvalidMesh(problem, "export the mesh again")
    return surface
