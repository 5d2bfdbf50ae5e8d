"""View input: what one depth camera sees, as an image and as the open surface behind it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.camera import Camera
from benchmark.geometry.cleaning import clean
from benchmark.geometry.depth import depth_surface, fit_half_width
from benchmark.geometry.mesh import Mesh


def seen(source: Mesh, camera: Camera, half_width: float) -> Mapping[str, NDArray[Any]]:
    """Render a mesh and project the image back.

    Parameters
    ----------
    source
        The mesh as the data set gives it.
    camera
        Where it is looked at from.
    half_width
        Half the width of the frame in file units.

    Returns
    -------
    dict
        ``vertices`` and ``faces`` of the surface that is seen, of unit area; ``depth``, shape (500, 500), float32;
        ``source_area`` in squared file units; ``note:...`` for each fact that the projection reports.

    Raises
    ------
    ShapeError
        If nothing of the mesh is seen.
    """
    view = depth_surface(_surface(source), camera, half_width)
    area = view.surface.area
    return {
        "vertices": view.surface.vertices / np.sqrt(area),
        "faces": view.surface.faces,
        "depth": view.depth,
        "source_area": np.asarray(area),
        **{f"note:{name}": np.asarray(value) for name, value in dataclasses.asdict(view.report).items()},
    }


def half_width_of(source: Mesh, camera: Camera) -> float:
    """Half the width of the frame that a mesh fills, in file units; raises ``ShapeError`` if it has no extent."""
    return fit_half_width([_surface(source)], camera)


def _surface(source: Mesh) -> Mesh:
    """The mesh without vertices that no face names: they would move the centre and the frame of the camera."""
    return clean(source)[0]
