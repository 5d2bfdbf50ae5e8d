"""Segmentation of the object in a depth image: remove planes, then choose the nearest large piece."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.depth.neighbours import DOWN, RIGHT, error_at, jump, neighbours
from benchmark.depth.reading import Depths, Mask
from benchmark.errors import DepthError
from benchmark.geometry.cleaning import component_labels
from benchmark.geometry.mesh import FloatArray, IntArray, Points

SHARE = 0.06
"""Minimum fraction of the measured points on a background plane."""

BEHIND = 0.03
"""Maximum fraction of the measured points behind a background plane; walls and floors bound the scene."""

EDGE = 0.1
"""Fraction of each image side taken as margin, and minimum fraction of a background plane's points in the margins."""

MOST_PLANES = 5
"""Maximum number of planes: a floor, two or three walls, a table."""

UNEVEN = 0.01
"""Unevenness of walls and floors, in metres."""

_POINTS, _SCORED = 5000, 1000
"""Approximate number of points for fitting planes, and of those used to score random samples."""

_TRIALS, _REFINEMENTS, _REACH = 150, 4, 3
"""Number of random samples, number of refits to the inliers of the best one, and ratio of the image side to the maximum
offset between the points of a sample."""

LARGE = 0.25
"""Minimum surface area of a large piece relative to the largest piece; the nearest large piece is the object."""

FEWEST = 0.004
"""Minimum fraction of the image pixels covered by the object."""

JOINED = 0.3
"""Maximum distance in metres between pieces of a self-occluding object, such as an arm before a chest."""

#: Hint of the error if no object is found.
_HINT = "pass a mask of it with --mask, or put a PNG that ends in _mask.png beside the image"


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane that faces the camera.

    Parameters
    ----------
    normal
        Unit normal towards the camera, shape (3,), in the camera's frame: right, down, forward.
    offset
        ``normal @ point`` for points of the plane, in metres; negative.
    """

    normal: FloatArray
    offset: float

    @classmethod
    def facing(cls, normal: FloatArray, offset: float) -> Plane:
        """Return the plane of a normal of either direction."""
        return cls(normal, offset) if offset < 0 else cls(-normal, -offset)

    def heights(self, points: Points) -> FloatArray:
        """Return the signed distances of points, shape (..., 3), in metres: positive in front of the plane."""
        return np.asarray(points @ self.normal - self.offset)

    def slack(self, points: Points) -> FloatArray:
        """Return the tolerance on the distance of points to the plane, in metres.

        Errors act along the depth, so that a plane at a grazing angle has a smaller tolerance than
        a frontal one.
        """
        depths = np.maximum(points[..., 2], 1e-6)
        return np.asarray(UNEVEN - self.offset * error_at(depths) / depths)

    def holds(self, points: Points) -> Mask:
        """Return whether points, shape (..., 3), lie on the plane within the measurement error."""
        return np.asarray(np.abs(self.heights(points)) <= self.slack(points))


def background_planes(points: Points, seen: Mask) -> list[Plane]:
    """Find the planes that bound a scene by RANSAC with three-point samples [Fischler and Bolles 1981].

    A background plane contains at least ``SHARE`` of the points, has almost no points behind it
    other than those of other background planes, and reaches the image margins. The result is
    deterministic.

    Parameters
    ----------
    points
        Shape (h, w, 3), metres in the camera's frame: right, down, forward.
    seen
        Mask of the points to use, shape (h, w).

    Returns
    -------
    list of Plane
        Planes in order of detection, largest first.
    """
    random = np.random.default_rng(0)
    step = max(1, round((seen.size / _POINTS) ** 0.5))
    points, seen = points[::step, ::step], seen[::step, ::step]
    rows, columns = (max(1, round(EDGE / 2 * length)) for length in seen.shape)
    edge = np.ones(seen.shape, dtype=bool)
    edge[rows:-rows, columns:-columns] = False
    n_seen = np.count_nonzero(seen)
    left, spoiled = seen.copy(), np.zeros(seen.shape, dtype=bool)
    planes: list[Plane] = []
    for _ in range(3 * MOST_PLANES):
        candidates = left & ~spoiled
        if len(planes) == MOST_PLANES or np.count_nonzero(candidates) < max(SHARE * n_seen, 3):
            break
        plane = _best_plane(points, candidates, random)
        held = candidates & plane.holds(points) if plane else candidates & False
        if plane is None or np.count_nonzero(held) < max(SHARE * n_seen, 3):
            break
        behind = left & (plane.heights(points) < -2 * plane.slack(points))
        bounds = np.count_nonzero(behind) <= BEHIND * n_seen
        if bounds and np.count_nonzero(held & edge) >= EDGE * np.count_nonzero(held):
            planes.append(plane)
            left &= ~plane.holds(points)
            spoiled[:] = False
        else:
            spoiled |= held  # part of the object or of other clutter
    return planes


def _best_plane(points: Points, candidates: Mask, random: np.random.Generator) -> Plane | None:
    """Return the plane with the most inliers among those through random neighbours, refined by least squares."""
    rows, columns = np.nonzero(candidates)
    first = random.integers(len(rows), size=_TRIALS)
    corners = [(rows[first], columns[first])]
    for _ in range(2):  # neighbours share a plane more often than arbitrary points
        places = [
            np.clip(
                place[first] + random.integers(-length // _REACH, length // _REACH + 1, _TRIALS),
                0,
                length - 1,
            )
            for place, length in zip((rows, columns), candidates.shape, strict=True)
        ]
        corners.append((places[0], places[1]))
    a, b, c = (points[place] for place in corners)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    proper = (lengths > 1e-6) & candidates[corners[1]] & candidates[corners[2]]
    if not proper.any():
        return None
    normals = normals[proper] / lengths[proper, None]
    offsets = (normals * a[proper]).sum(axis=1)
    inside = points[candidates]
    some = inside[:: max(1, len(inside) // _SCORED)]
    slack = UNEVEN + np.abs(offsets[:, None]) * (error_at(some[:, 2]) / some[:, 2])
    best = int((np.abs(normals @ some.T - offsets[:, None]) <= slack).sum(axis=1).argmax())
    plane = Plane.facing(normals[best], float(offsets[best]))
    for _ in range(_REFINEMENTS):
        held = inside[plane.holds(inside)]
        if len(held) < 3:
            return None
        centre = held.mean(axis=0)
        normal = np.linalg.eigh((held - centre).T @ (held - centre))[1][:, 0]
        plane = Plane.facing(normal, float(normal @ centre))
    return plane


def find_object(points: Points, seen: Mask, planes: Sequence[Plane]) -> Mask:
    """Return the mask of the object: the nearest large piece left after removing the planes.

    Parameters
    ----------
    points
        Shape (h, w, 3), metres in the camera's frame: right, down, forward.
    seen
        Pixels with a depth, shape (h, w).
    planes
        Background planes of the scene.

    Returns
    -------
    numpy.ndarray
        Shape (h, w), bool.

    Raises
    ------
    DepthError
        If no remaining piece is large enough.
    """
    depths = points[..., 2]
    free = seen.copy()
    for plane in planes:
        free &= plane.heights(points) > plane.slack(points)
    if not free.any():
        raise DepthError("nothing but planes is left of the scene", _HINT)
    # A piece ends where the depth jumps.
    labels = np.full(free.shape, -1, dtype=np.int64)
    labels[free] = np.arange(np.count_nonzero(free))
    labels[free] = _joined(labels, depths, jump(depths))
    # At twice the depth, a pixel covers four times the area.
    surfaces = np.bincount(labels[free], weights=depths[free] ** 2)
    pixels = np.bincount(labels[free])
    distances = np.bincount(labels[free], weights=depths[free]) / pixels
    large = (surfaces >= LARGE * surfaces.max()) & (pixels >= FEWEST * seen.size)
    if not large.any():
        problem = f"no piece left of the scene holds {FEWEST:.1%} of the image, the largest {pixels.max()} pixels"
        raise DepthError(problem, _HINT)
    chosen = int(np.flatnonzero(large)[distances[large].argmin()])
    group = _joined(
        labels, depths, np.full_like(depths, JOINED)
    )  # an arm before a chest is a separate piece
    return np.asarray(free & (group == group[chosen])[labels])


def _joined(labels: IntArray, depths: Depths, limits: Depths) -> IntArray:
    """Return the group of each label of an image: labels of neighbours at depths within the limit of the nearer one."""
    label, depth, limit = labels.ravel(), depths.ravel(), limits.ravel()
    pairs = [neighbours(depths > 0, direction) for direction in (RIGHT, DOWN)]
    one, other = np.concatenate(pairs, axis=1)
    nearer = np.where(depth[one] <= depth[other], limit[one], limit[other])
    close = (label[one] >= 0) & (label[other] >= 0)
    close &= np.abs(depth[one] - depth[other]) <= nearer
    return component_labels(label[one[close]], label[other[close]], int(labels.max()) + 1)
