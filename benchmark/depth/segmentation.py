"""Segmentation of the object in a depth image: remove planes, then choose the nearest large segment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from benchmark.depth.errors import NoObject
from benchmark.depth.reading import Depths, Mask
from benchmark.geometry.mesh import Points

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

FLOOR = np.cos(np.radians(50))
"""Minimum cosine of the angle between the normal of a floor and the up direction of the image."""

_POINTS, _SCORED = 5000, 1000
"""Approximate number of points for fitting planes, and of those used to score random samples."""

_TRIALS, _REFINEMENTS, _REACH = 150, 4, 3
"""Number of random samples, number of refits to the inliers of the best one, and ratio of the image side to the maximum
offset between the points of a sample."""


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

    normal: NDArray[np.float64]
    offset: float

    def heights(self, points: Points) -> NDArray[np.float64]:
        """Return the signed distances of points, shape (..., 3), in metres: positive in front of the plane."""
        return np.asarray(points @ self.normal - self.offset)

    def holds(self, points: Points) -> NDArray[np.bool_]:
        """Return whether points, shape (..., 3), lie on the plane within the measurement error."""
        return np.asarray(np.abs(self.heights(points)) <= self.slack(points))

    def slack(self, points: Points) -> NDArray[np.float64]:
        """Return the tolerance on the distance of points to the plane, in metres.

        Errors act along the depth, so that a plane at a grazing angle has a smaller tolerance than a frontal one.
        """
        depths = np.maximum(points[..., 2], 1e-6)
        return np.asarray(UNEVEN - self.offset * error_at(depths) / depths)

    @property
    def is_floor(self) -> bool:
        """Whether the normal points up steeply enough for a floor."""
        return bool(-self.normal[1] >= FLOOR)


def error_at(depths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the maximum depth error in metres, for depths in metres.

    The error is three standard deviations of a structured-light camera, 1.4 mm at 1 m and growing with the square of
    the depth [Khoshelham and Elberink 2012], but at most 0.3 m.
    """
    return np.asarray(np.minimum(3 * 0.0014 * depths**2, 0.3))


def background_planes(points: Points, seen: NDArray[np.bool_]) -> list[Plane]:
    """Find the planes that bound a scene by RANSAC with three-point samples [Fischler and Bolles 1981].

    A background plane contains at least ``SHARE`` of the points, has almost no points behind it other than those of
    other background planes, and reaches the image margins. The result is deterministic.

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
    margins = [max(1, round(EDGE / 2 * length)) for length in seen.shape]
    edge = np.ones(seen.shape, dtype=bool)
    edge[margins[0] : -margins[0], margins[1] : -margins[1]] = False
    fewest = max(SHARE * np.count_nonzero(seen), 3)
    left, spoiled = seen.copy(), np.zeros(seen.shape, dtype=bool)
    planes: list[Plane] = []
    for _ in range(3 * MOST_PLANES):
        candidates = left & ~spoiled
        plane = _best_plane(points, candidates, random) if np.count_nonzero(candidates) >= fewest else None
        if plane is None or len(planes) == MOST_PLANES:
            break
        held = candidates & plane.holds(points)
        if np.count_nonzero(held) < fewest:
            break
        behind = left & (plane.heights(points) < -2 * plane.slack(points))
        bounds = np.count_nonzero(behind) <= BEHIND * np.count_nonzero(seen)
        if bounds and np.count_nonzero(held & edge) >= EDGE * np.count_nonzero(held):
            planes.append(plane)
            left &= ~plane.holds(points)
            spoiled[:] = False
        else:
            spoiled |= held  # part of the object or of other clutter
    return planes


def _best_plane(points: Points, candidates: NDArray[np.bool_], random: np.random.Generator) -> Plane | None:
    """Return the plane with the most inliers among those through random neighbours, refined by least squares."""
    rows, columns = np.nonzero(candidates)
    first = random.integers(len(rows), size=_TRIALS)
    corners = [(rows[first], columns[first])]
    for _ in range(2):  # neighbours share a plane more often than arbitrary points
        places = [
            np.clip(place[first] + random.integers(-length // _REACH, length // _REACH + 1, _TRIALS), 0, length - 1)
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
    held = np.abs(normals @ some.T - offsets[:, None]) <= slack
    plane = _facing(normals[best := int(held.sum(axis=1).argmax())], float(offsets[best]))
    for _ in range(_REFINEMENTS):
        held_points = inside[plane.holds(inside)]
        if len(held_points) < 3:
            return None
        plane = _fitted(held_points)
    return plane


def _fitted(points: Points) -> Plane:
    """Return the least-squares plane of points."""
    centre = points.mean(axis=0)
    moved = points - centre
    normal = np.linalg.eigh(moved.T @ moved)[1][:, 0]
    return _facing(normal, float(normal @ centre))


def _facing(normal: NDArray[np.float64], offset: float) -> Plane:
    return Plane(normal, offset) if offset < 0 else Plane(-normal, -offset)


LARGE = 0.25
"""Minimum surface area of a large piece relative to the largest piece; the nearest large piece is the object."""

FEWEST = 0.004
"""Minimum fraction of the image pixels covered by the object."""

LARGEST_ERROR = 0.1
"""Upper bound in metres on the measurement error in the depth difference of neighbours on one surface."""

JOINED = 0.3
"""Maximum distance in metres between pieces of a self-occluding object, such as an arm before a chest."""

_LEFT, _RIGHT = (slice(None), slice(None, -1)), (slice(None), slice(1, None))
_UPPER, _LOWER = (slice(None, -1), slice(None)), (slice(1, None), slice(None))

#: Hint of the error if no object is found.
_HINT = "pass a mask of it with --mask, or put a PNG that ends in _mask.png beside the image"


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
    NoObject
        If no remaining piece is large enough.
    """
    depths = points[..., 2]
    free = seen.copy()
    for plane in planes:
        free &= plane.heights(points) > plane.slack(points)
    labels, count = pieces(depths, free)
    if not count:
        raise NoObject("nothing but planes and specks is left of the scene", _HINT)
    of_pixels = labels[free]
    # At twice the depth, a pixel covers four times the area.
    surfaces = np.bincount(of_pixels, weights=depths[free] ** 2, minlength=count)
    pixels = np.bincount(of_pixels, minlength=count)
    distances = np.bincount(of_pixels, weights=depths[free], minlength=count) / pixels
    large = (surfaces >= LARGE * surfaces.max()) & (pixels >= FEWEST * seen.size)
    if not large.any():
        raise NoObject(
            f"no piece that is left of the scene holds {FEWEST:.1%} of the image, the largest {pixels.max()} pixels",
            _HINT,
        )
    chosen = int(np.flatnonzero(large)[distances[large].argmin()])
    # An arm before a chest is a separate piece.
    _, group = _groups(count, _touching(labels, depths, lambda _: np.asarray(JOINED)))
    return np.asarray(free & (group == group[chosen])[labels])


def pieces(depths: NDArray[np.float64], free: Mask) -> tuple[NDArray[np.int64], int]:
    """Label the pieces of an image separated by depth jumps.

    Parameters
    ----------
    depths
        Shape (h, w), metres.
    free
        Pixels that belong to pieces, shape (h, w).

    Returns
    -------
    labels : numpy.ndarray
        Shape (h, w); -1 elsewhere.
    count : int
        Number of pieces.
    """
    labels = np.full(free.shape, -1, dtype=np.int64)
    labels[free] = np.arange(np.count_nonzero(free))
    count, of_pixel = _groups(int(np.count_nonzero(free)), _touching(labels, depths, jump))
    labels[free] = of_pixel
    return labels, count


def jump(depths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the depth difference in metres above which neighbouring pixels belong to different surfaces."""
    return np.asarray(0.03 + np.minimum(error_at(depths), LARGEST_ERROR))


def _touching(
    labels: NDArray[np.int64], depths: NDArray[np.float64], limit: Callable[[Depths], Depths]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return label pairs of neighbouring pixels whose depths differ by at most the limit at the nearer one; skip -1."""
    pairs = []
    for one, other in ((_LEFT, _RIGHT), (_UPPER, _LOWER)):
        close = (labels[one] >= 0) & (labels[other] >= 0) & (labels[one] != labels[other])
        close &= np.abs(depths[one] - depths[other]) <= limit(np.minimum(depths[one], depths[other]))
        pairs.append((labels[one][close], labels[other][close]))
    first, second = zip(*pairs, strict=True)
    return np.concatenate(first), np.concatenate(second)


def _groups(count: int, pairs: tuple[NDArray[np.int64], NDArray[np.int64]]) -> tuple[int, NDArray[np.int64]]:
    """Return the number of connected groups of labels and the group of each label, shape (count,)."""
    graph = coo_array((np.ones(len(pairs[0]), dtype=np.int8), pairs), shape=(count, count))
    n_groups, group = connected_components(graph.tocsr(), directed=False)
    return int(n_groups), group.astype(np.int64)
