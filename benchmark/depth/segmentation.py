"""Segment the object of a depth image: remove planes, then choose the nearest large segment."""

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
"""Share of the seen points that a plane of the background holds at the least."""

BEHIND = 0.03
"""Share of the seen points that may lie behind such a plane: walls and floors bound what a camera sees."""

EDGE = 0.1
"""Share of the image along its edges that counts as its edge, which planes of the background reach."""

MOST_PLANES = 5
"""Planes that are looked for at the most: a floor, two or three walls, a table."""

UNEVEN = 0.01
"""Metres by which walls and floors are uneven."""

FLOOR = np.cos(np.radians(50))
"""Least cosine between the normal of a floor and what is up in the image."""

_POINTS, _SCORED = 5000, 1000
"""Points that planes are fitted to, and of these the ones that samples are compared by."""

_TRIALS, _REFINEMENTS, _REACH = 150, 4, 3
"""Samples; fits to the points that the best one holds; and into how many the image is cut to get the largest distance
of a sample's points."""


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
        """Return whether it can be stood on."""
        return bool(-self.normal[1] >= FLOOR)


def error_at(depths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far from its true depth a point may be measured, in metres, at depths in metres.

    Three standard deviations of a structured-light camera, whose error grows with the square of the depth: 1.4 mm at a
    metre [Khoshelham and Elberink 2012]; 0.3 m at the most.
    """
    return np.asarray(np.minimum(3 * 0.0014 * depths**2, 0.3))


def background_planes(points: Points, seen: NDArray[np.bool_]) -> list[Plane]:
    """Find the planes that bound a scene, by random samples of three points [Fischler and Bolles 1981].

    A plane is one of the background if it holds at least ``SHARE`` of the points, next to nothing lies behind it but
    what other such planes hold, and it reaches the edge of the image. The samples are the same for the same points.

    Parameters
    ----------
    points
        Shape (h, w, 3), metres in the camera's frame: right, down, forward.
    seen
        Which of them count, shape (h, w).

    Returns
    -------
    list of Plane
        In the order in which they were found, the largest first.
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
            spoiled |= held  # of the object, or of something that stands about
    return planes


def _best_plane(points: Points, candidates: NDArray[np.bool_], random: np.random.Generator) -> Plane | None:
    """The plane that holds most points among those through random neighbours, refined by least squares."""
    rows, columns = np.nonzero(candidates)
    first = random.integers(len(rows), size=_TRIALS)
    corners = [(rows[first], columns[first])]
    for _ in range(2):  # neighbours lie on one plane more often than any three points
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
    """Least-squares plane of points."""
    centre = points.mean(axis=0)
    moved = points - centre
    normal = np.linalg.eigh(moved.T @ moved)[1][:, 0]
    return _facing(normal, float(normal @ centre))


def _facing(normal: NDArray[np.float64], offset: float) -> Plane:
    return Plane(normal, offset) if offset < 0 else Plane(-normal, -offset)


LARGE = 0.25
"""Pieces of at least this share of the surface of the largest one are large; the nearest of them is the object."""

FEWEST = 0.004
"""Share of the pixels of the image that the object shows at the least."""

LARGEST_ERROR = 0.1
"""Metres that two neighbours on one surface may be measured apart, at the most."""

JOINED = 0.3
"""Metres between pieces of one object that hides part of itself, such as an arm before a chest, at the most."""

_LEFT, _RIGHT = (slice(None), slice(None, -1)), (slice(None), slice(1, None))
_UPPER, _LOWER = (slice(None, -1), slice(None)), (slice(1, None), slice(None))

#: What is told where no object is found.
_HINT = "pass a mask of it with --mask, or put a PNG that ends in _mask.png beside the image"


def find_object(points: Points, seen: Mask, planes: Sequence[Plane]) -> Mask:
    """Return the pixels of the object: the nearest of the large pieces that are left without the planes.

    Parameters
    ----------
    points
        Shape (h, w, 3), metres in the camera's frame: right, down, forward.
    seen
        Pixels with a depth, shape (h, w).
    planes
        What bounds the scene.

    Returns
    -------
    numpy.ndarray
        Shape (h, w), bool.

    Raises
    ------
    NoObject
        If nothing is left that is large enough.
    """
    depths = points[..., 2]
    free = seen.copy()
    for plane in planes:
        free &= plane.heights(points) > plane.slack(points)
    labels, count = pieces(depths, free)
    if not count:
        raise NoObject("nothing but planes and specks is left of the scene", _HINT)
    of_pixels = labels[free]
    # A pixel twice as far away shows four times the surface.
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
    # An arm before a chest is a piece of its own.
    _, group = _groups(count, _touching(labels, depths, lambda _: np.asarray(JOINED)))
    return np.asarray(free & (group == group[chosen])[labels])


def pieces(depths: NDArray[np.float64], free: Mask) -> tuple[NDArray[np.int64], int]:
    """Label the pieces of an image between its depth jumps.

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
    """Return the difference of neighbouring depths above which two surfaces are seen, in metres."""
    return np.asarray(0.03 + np.minimum(error_at(depths), LARGEST_ERROR))


def _touching(
    labels: NDArray[np.int64], depths: NDArray[np.float64], limit: Callable[[Depths], Depths]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Labels of the neighbouring pixels whose depths differ by no more than a limit at the nearer one; -1 has none."""
    pairs = []
    for one, other in ((_LEFT, _RIGHT), (_UPPER, _LOWER)):
        close = (labels[one] >= 0) & (labels[other] >= 0) & (labels[one] != labels[other])
        close &= np.abs(depths[one] - depths[other]) <= limit(np.minimum(depths[one], depths[other]))
        pairs.append((labels[one][close], labels[other][close]))
    first, second = zip(*pairs, strict=True)
    return np.concatenate(first), np.concatenate(second)


def _groups(count: int, pairs: tuple[NDArray[np.int64], NDArray[np.int64]]) -> tuple[int, NDArray[np.int64]]:
    """Number of groups that pairs of labels join, and the group of each label, shape (count,)."""
    graph = coo_array((np.ones(len(pairs[0]), dtype=np.int8), pairs), shape=(count, count))
    n_groups, group = connected_components(graph.tocsr(), directed=False)
    return int(n_groups), group.astype(np.int64)
