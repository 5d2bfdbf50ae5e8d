"""Frame of a surface: position, orientation and size, of which a network of surfaces is told nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.api.contracts import FloatArray
from benchmark.errors import UnsupportedShape
from benchmark.geometry.mesh import Mesh, Points

SECOND_PERTURBATION = 0.05
"""Standard deviation of what training adds to the covariance, as a share of its trace: axes that nearly tie are seen
in either order."""

THIRD_PERTURBATION = 0.2
"""Standard deviation of what training adds to the skewness along an axis: one that is nearly even is seen from either
side."""

FLAT = 1e-9
"""Share of the variance below which a surface has no extent along an axis."""

TILT = 0.17
"""Largest angle in radians by which training turns a frame: ten degrees."""


@dataclass(frozen=True, eq=False)
class Frame:
    """An origin, three axes and a unit of length.

    Parameters
    ----------
    origin
        Centroid of the surface, shape (3,).
    axes
        Rows, shape (3, 3): a rotation.
    unit
        Root of the area, positive.
    """

    origin: FloatArray
    axes: FloatArray
    unit: float

    def seen(self, mesh: Mesh) -> Mesh:
        """Return a surface of space in this frame."""
        return mesh.with_vertices((mesh.vertices - self.origin) @ self.axes.T / self.unit)


def centred(mesh: Mesh) -> Mesh:
    """The surface with its centroid at the origin and unit area; how it stands and faces stays.

    Raises
    ------
    UnsupportedShape
        If the surface has no area, or coordinates so large that it is infinite.
    """
    _, origin, unit = _spread(mesh)
    return mesh.with_vertices((mesh.vertices - origin) / unit)


def frame_of(mesh: Mesh, random: np.random.Generator | None = None) -> Frame:
    """Frame of the principal axes of a surface, the longest first, in units of the root of its area.

    Moments are integrals over the triangles, so that how a surface is divided does not matter. The two axes along
    which the surface is least even look to the side of the positive third moment, and the other one makes the frame a
    proper one. A surface that is even along two axes, but for rounding errors, looks the same to its moments when it is
    turned by half a circle about the third, and either frame will do. What looks the same after a third or a quarter
    of a turn, without being round, has axes that hang on rounding errors; no body does.

    Parameters
    ----------
    mesh
        The surface.
    random
        Perturbs the frame as training does, so that a network learns what happens near ties; None does not.

    Raises
    ------
    UnsupportedShape
        If the surface has no area, or coordinates so large that it is infinite.
    """
    shares, origin, unit = _spread(mesh)
    corners = [(mesh.vertices[mesh.faces[:, k]] - origin) / unit for k in range(3)]
    covariance = _covariance(corners, shares)
    if random is not None:
        noise = random.normal(scale=SECOND_PERTURBATION * np.trace(covariance), size=(3, 3))
        covariance = covariance + (noise + noise.T) / 2
    axes = np.linalg.eigh(covariance)[1].T[::-1].copy()
    skewness = _skewness([vectors_at @ axes.T for vectors_at in corners], shares)
    if random is not None:
        skewness = skewness + random.normal(scale=THIRD_PERTURBATION, size=3)
    axes[skewness < 0] *= -1
    if np.linalg.det(axes) < 0:
        axes[np.abs(skewness).argmin()] *= -1
    if random is not None:
        axes = _tilt(random) @ axes
    return Frame(origin, axes, unit)


def of_unit_area(mesh: Mesh, vertices: Points) -> Points:
    """Return where a network puts the vertices of a surface, shape (n, 3), scaled so that its area is 1.

    Raises
    ------
    UnsupportedShape
        If that is no surface.
    """
    area = mesh.with_vertices(vertices).area if np.isfinite(vertices).all() else 0.0
    if not area > 0:
        raise UnsupportedShape(
            "the network leaves no surface of this shape", "pass one like those it was trained on, or train it longer"
        )
    return np.asarray(vertices / area**0.5)


def _spread(mesh: Mesh) -> tuple[FloatArray, FloatArray, float]:
    """Shares of the area of all triangles, shape (m,), the centroid, shape (3,), and the root of the area."""
    areas = mesh.face_areas
    total = float(areas.sum())
    if not np.isfinite(total):
        raise UnsupportedShape("the coordinates are too large to compute with", "scale the mesh")
    if not total > 0:
        raise UnsupportedShape("the mesh has no area", "pass a surface with at least one proper triangle")
    shares = areas / total
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return shares, shares @ (a + b + c) / 3, total**0.5


def _covariance(corners: Sequence[Points], areas: FloatArray) -> FloatArray:
    """Second moments, shape (3, 3), of triangles with shares of area, shape (m,), about the origin."""
    a, b, c = corners
    vectors = (a, b, c, a + b + c)
    return np.asarray(sum((areas[:, None] * vectors_at).T @ vectors_at for vectors_at in vectors) / 12)


def _skewness(corners: Sequence[Points], areas: FloatArray) -> FloatArray:
    """Third moments along each axis in units of the standard deviation, shape (3,), of triangles with shares of area.

    The mean of t^3 over a triangle is a tenth of the complete homogeneous polynomial of its corners.
    """
    a, b, c = corners
    first, second, third = a + b + c, a * a + b * b + c * c, a * a * a + b * b * b + c * c * c
    homogeneous = (first * (first * first + 3 * second) + 2 * third) / 6
    variance = areas @ (first * first + second) / 12
    # Along the normal of a flat surface there is nothing but rounding errors.
    return np.asarray(areas @ homogeneous / 10 / np.maximum(variance, FLAT * variance.sum()) ** 1.5)


def _tilt(random: np.random.Generator) -> FloatArray:
    """Rotation about a random axis by a random angle up to ``TILT``, shape (3, 3)."""
    from scipy.spatial.transform import Rotation

    axis = random.normal(size=3)
    angle = random.uniform(0, TILT)
    return np.asarray(Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix())
