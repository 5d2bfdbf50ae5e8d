"""Walls, floors and tables of a scene, found by robust fitting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.mesh import Points

SHARE = 0.06
"""Share of the seen points that a plane of the background holds at the least."""

BEHIND = 0.03
"""Share of the seen points that may lie behind such a plane: walls and floors bound what a camera sees."""

EDGE = 0.1
"""Share of the image along its edges that counts as its edge: planes of the background reach it, the object's do not."""

MOST_PLANES = 5
"""Planes that are looked for at the most: a floor, two or three walls, a table."""

UNEVEN = 0.01
"""Metres by which walls and floors are uneven."""

FLOOR = np.cos(np.radians(50))
"""Least cosine between the normal of a floor and what is up in the image."""

_TRIALS, _SAMPLE, _REFINEMENTS = 256, 4000, 3


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane that faces the camera.

    Parameters
    ----------
    normal
        Of unit length, towards the camera, shape (3,), in the camera's frame: right, down, forward.
    offset
        ``normal @ point`` of its points, in metres; negative.
    """

    normal: NDArray[np.float64]
    offset: float

    def heights(self, points: Points) -> NDArray[np.float64]:
        """Return the signed distances of points, shape (..., 3), in metres: positive before the plane."""
        return np.asarray(points @ self.normal - self.offset)

    def holds(self, points: Points) -> NDArray[np.bool_]:
        """Return whether points, shape (..., 3), are of the plane, as far as a camera measures."""
        return np.asarray(np.abs(self.heights(points)) <= self.slack(points))

    def slack(self, points: Points) -> NDArray[np.float64]:
        """Return how far from the plane its points may be measured, in metres.

        Errors are those of the depth, so that a plane seen at a grazing angle is measured better than one from ahead.
        """
        depths = np.maximum(points[..., 2], 1e-6)
        return np.asarray(UNEVEN - self.offset * error_at(depths) / depths)

    @property
    def is_floor(self) -> bool:
        """Whether it can be stood on."""
        return bool(-self.normal[1] >= FLOOR)


def error_at(depths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far from its true depth a point may be measured, in metres, at depths in metres.

    Three standard deviations of a structured-light camera, whose error grows with the square of the depth: 1.4 mm at a
    metre [Khoshelham and Elberink 2012]; 0.1 m at the most.
    """
    return np.asarray(np.minimum(3 * 0.0014 * depths**2, 0.1))


def background_planes(points: Points, on_edge: NDArray[np.bool_]) -> list[Plane]:
    """Find the planes that bound a scene, by random samples of three points [Fischler and Bolles 1981].

    A plane is one of the background if it holds at least ``SHARE`` of the points, next to nothing lies behind it but
    what other such planes hold, and it reaches the edge of the image. The samples are the same for the same points.

    Parameters
    ----------
    points
        Shape (n, 3), metres in the camera's frame: right, down, forward.
    on_edge
        Whether each lies near the edge of the image, shape (n,).

    Returns
    -------
    list of Plane
        In the order in which they were found, the largest first.
    """
    random = np.random.default_rng(0)
    chosen = random.permutation(len(points))[:_SAMPLE]
    sample, edge = points[chosen], on_edge[chosen]
    left, spoiled = np.ones(len(sample), dtype=bool), np.zeros(len(sample), dtype=bool)
    found: list[Plane] = []
    for _ in range(3 * MOST_PLANES):
        candidates = left & ~spoiled
        if candidates.sum() < SHARE * len(sample) or len(found) == MOST_PLANES:
            break
        plane = _best_plane(sample[candidates], random)
        if plane is None:
            break
        holds = plane.holds(sample)
        held = candidates & holds
        behind = (left & (plane.heights(sample) < -2 * plane.slack(sample))).sum()
        if held.sum() < SHARE * len(sample):
            break
        if behind <= BEHIND * len(sample) and (held & edge).sum() >= EDGE * held.sum():
            found.append(plane)
            left &= ~holds
            spoiled[:] = False
        else:
            spoiled |= held  # of the object, or of something that stands about
    return found


def _best_plane(points: Points, random: np.random.Generator) -> Plane | None:
    """The plane that holds most points among those through random triples, refined by least squares."""
    corners = points[random.integers(len(points), size=(_TRIALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    proper = lengths > 1e-6
    if not proper.any():
        return None
    normals, starts = normals[proper] / lengths[proper, None], corners[proper, 0]
    offsets = np.einsum("ij,ij->i", normals, starts)
    slack = UNEVEN + np.abs(offsets[:, None]) * (error_at(points[:, 2]) / points[:, 2])
    held = np.abs(normals @ points.T - offsets[:, None]) <= slack
    best = int(held.sum(axis=1).argmax())
    inside = held[best]
    for _ in range(_REFINEMENTS):
        plane = _fitted(points[inside])
        inside = plane.holds(points)
        if inside.sum() < 3:
            return None
    return plane


def _fitted(points: Points) -> Plane:
    """Least-squares plane of points."""
    centre = points.mean(axis=0)
    moved = points - centre
    normal = np.linalg.eigh(moved.T @ moved)[1][:, 0]
    offset = float(normal @ centre)
    return Plane(normal, offset) if offset < 0 else Plane(-normal, -offset)
