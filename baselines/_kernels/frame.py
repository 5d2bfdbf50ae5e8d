"""Frame of the principal axes of a surface, and the surface on a grid in this frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baselines._kernels.orientation import canonical_signs, vertex_areas
from benchmark.api.contracts import FloatArray
from benchmark.geometry.mesh import Mesh

CLEAR = 1e-3
"""Two principal axes are ambiguous if their variances differ by less than this share of the largest."""

GRID = 2.0**-20
"""Step of the grid, as a share of the square root of the surface area: some 4e-5 of an edge for 2000 vertices."""


@dataclass(frozen=True, eq=False)
class Frame:
    """An origin, three axes and a unit of length.

    Parameters
    ----------
    origin
        Shape (3,).
    axes
        Columns, shape (3, 3): a rotation.
    unit
        Positive.
    """

    origin: FloatArray
    axes: FloatArray
    unit: float

    def coordinates(self, points: FloatArray) -> FloatArray:
        """Return the coordinates of points in this frame, shape (n, 3)."""
        return np.asarray((points - self.origin) @ self.axes / self.unit)

    def points(self, coordinates: FloatArray) -> FloatArray:
        """Return the points with these coordinates, shape (n, 3): the inverse of :meth:`coordinates`."""
        return np.asarray(coordinates * self.unit @ self.axes.T + self.origin)


def principal_frame(mesh: Mesh) -> Frame:
    """Return the frame of the principal axes of a surface, in units of the square root of its area.

    A surface with ambiguous axes, such as a round tube, keeps the coordinate axes: its own would depend on rounding
    errors.
    """
    areas = vertex_areas(mesh)
    origin = areas @ mesh.vertices / areas.sum()
    centred = mesh.vertices - origin
    variances, axes = np.linalg.eigh((centred * areas[:, None]).T @ centred)
    if np.diff(variances).min() <= CLEAR * variances[2]:
        axes = np.eye(3)
    else:
        axes = axes[:, ::-1] * canonical_signs(centred @ axes[:, ::-1], areas, mesh.vertices)
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return Frame(origin, axes, float(np.sqrt(areas.sum())))


def on_grid(mesh: Mesh, frame: Frame) -> Mesh:
    """Return the surface in the frame, with coordinates rounded to multiples of ``GRID``."""
    return mesh.with_vertices(np.round(frame.coordinates(mesh.vertices) / GRID) * GRID + 0.0)
