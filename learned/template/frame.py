"""Where a shape lies: centred, of unit area, along its principal axes, and the ways in which these may be meant."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.mesh import Mesh, Points

_EDGES = ((0, 1), (1, 2), (2, 0))


def centred(mesh: Mesh) -> Mesh:
    """The surface with its centroid in the origin and unit area; it is not turned.

    The area must be positive.
    """
    places, weights = _spread(mesh)
    return mesh.with_vertices((mesh.vertices - weights @ places) / np.sqrt(mesh.area))


def principal_axes(mesh: Mesh) -> Points:
    """Principal axes of a centred surface, shape (3, 3), one a row, longest first, right-handed.

    An axis points to where the third moment along it is positive. Of the three signs one follows from the other two;
    that is the sign along which the shape is nearest to symmetric, where the moment would tell little: a shape that is
    its own mirror image looks the same either way.
    """
    places, weights = _spread(mesh)
    _, vectors = np.linalg.eigh((places * weights[:, None]).T @ places)
    axes: Points = vectors.T[::-1].copy()
    skewness = weights @ (places @ axes.T) ** 3
    axes *= np.where(skewness < 0, -1.0, 1.0)[:, None]
    if np.linalg.det(axes) < 0:
        axes[np.argmin(np.abs(skewness))] *= -1
    return axes


def quarter_turns() -> NDArray[np.float64]:
    """The 24 rotations that bring a cube onto itself, shape (24, 3, 3)."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.linalg.det(turn) > 0:
                found.append(turn)
    return np.stack(found)


def _spread(mesh: Mesh) -> tuple[Points, Points]:
    """Midpoints of all edges of all triangles and shares of the area; moments up to the second are exact."""
    corners = mesh.vertices[mesh.faces]
    places = np.concatenate([(corners[:, one] + corners[:, other]) / 2 for one, other in _EDGES])
    areas = mesh.face_areas
    return places, np.tile(areas / (3 * areas.sum()), 3)
