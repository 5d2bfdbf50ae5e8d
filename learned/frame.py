"""Frame of a surface: its position, orientation and size, which are removed before a network sees the surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.api.contracts import FloatArray
from benchmark.errors import UnsupportedShape
from benchmark.geometry.mesh import Mesh, Points

SECOND_PERTURBATION = 0.05
"""Standard deviation of the training noise on the covariance, as a share of its trace: nearly tied axes occur in either
order."""

THIRD_PERTURBATION = 0.2
"""Standard deviation of the training noise on the skewness along an axis: a nearly symmetric axis occurs in either
direction."""

FLAT = 1e-9
"""Share of the variance below which a surface has no extent along an axis."""

TILT = 0.17
"""Largest angle in radians by which training rotates a frame: about ten degrees."""


@dataclass(frozen=True, eq=False)
class Frame:
    """An origin, three axes and a unit of length.

    Parameters
    ----------
    origin
        Centroid of the surface, shape (3,).
    axes
        Rotation matrix with the axes as rows, shape (3, 3).
    unit
        Square root of the area, positive.
    """

    origin: FloatArray
    axes: FloatArray
    unit: float

    def seen(self, mesh: Mesh) -> Mesh:
        """Return a mesh in the coordinates of this frame."""
        return mesh.with_vertices((mesh.vertices - self.origin) @ self.axes.T / self.unit)


def centred(mesh: Mesh) -> Mesh:
    """Move the centroid to the origin and scale to unit area, without rotation.

    Raises
    ------
    UnsupportedShape
        If the area is zero, or infinite because the coordinates are too large.
    """
    _, origin, unit = _spread(mesh)
    return mesh.with_vertices((mesh.vertices - origin) / unit)


def frame_of(mesh: Mesh, random: np.random.Generator | None = None) -> Frame:
    """Return the frame of the principal axes of a surface, longest first, with the square root of its area as unit.

    Moments are integrals over the triangles, so the triangulation does not matter. The two axes with the largest
    skewness point to the side of the positive third moment; the third axis makes the frame right-handed. If a surface
    has no skewness along two axes, up to rounding errors, a half turn about the third leaves its moments unchanged, and
    either frame will do. A surface with threefold or fourfold rotational symmetry that is not round has axes that
    depend on rounding errors; no body is of this kind.

    Parameters
    ----------
    mesh
        The surface.
    random
        Source of the perturbations of training, from which a network learns the frames near ties; None for no
        perturbation.

    Raises
    ------
    UnsupportedShape
        If the area is zero, or infinite because the coordinates are too large.
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
    """Scale the predicted vertices of a surface, shape (n, 3), to unit area.

    Raises
    ------
    UnsupportedShape
        If a vertex is not finite, or the area is zero.
    """
    area = mesh.with_vertices(vertices).area if np.isfinite(vertices).all() else 0.0
    if not area > 0:
        raise UnsupportedShape(
            "the network leaves no surface of this shape", "pass one like those it was trained on, or train it longer"
        )
    return np.asarray(vertices / area**0.5)


def _spread(mesh: Mesh) -> tuple[FloatArray, FloatArray, float]:
    """Return the share of the area of each triangle, shape (m,), the centroid, shape (3,), and the root of the area."""
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
    """Return the second moments about the origin, shape (3, 3), of triangles with these shares of the area."""
    a, b, c = corners
    vectors = (a, b, c, a + b + c)
    return np.asarray(sum((areas[:, None] * vectors_at).T @ vectors_at for vectors_at in vectors) / 12)


def _skewness(corners: Sequence[Points], areas: FloatArray) -> FloatArray:
    """Return the third standardised moment along each axis, shape (3,), of triangles with these shares of the area.

    The mean of t^3 over a triangle is a tenth of the complete homogeneous polynomial of its corners.
    """
    a, b, c = corners
    first, second, third = a + b + c, a * a + b * b + c * c, a * a * a + b * b * b + c * c * c
    homogeneous = (first * (first * first + 3 * second) + 2 * third) / 6
    variance = areas @ (first * first + second) / 12
    # Along the normal of a flat surface there are only rounding errors.
    return np.asarray(areas @ homogeneous / 10 / np.maximum(variance, FLAT * variance.sum()) ** 1.5)


def _tilt(random: np.random.Generator) -> FloatArray:
    """Draw a rotation about a random axis by a random angle up to ``TILT``, shape (3, 3)."""
    from scipy.spatial.transform import Rotation

    axis = random.normal(size=3)
    angle = random.uniform(0, TILT)
    return np.asarray(Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix())
