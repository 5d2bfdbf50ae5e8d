"""Segmentation of the object in a depth image.

Planes are removed; of what is left, the object is the nearest large piece.
"""

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
"""Maximum fraction of the measured points behind a background plane; walls and floors bound the
scene."""

EDGE = 0.1
"""Fraction of each image side taken as margin, and minimum fraction of a background plane's points
in the margins."""

MOST_PLANES = 5
"""Maximum number of planes: a floor, two or three walls, a table."""

UNEVEN = 0.01
"""Unevenness of walls and floors, in metres."""

_N_POINTS = 5000
"""Approximate number of points to which planes are fitted."""

_N_SCORED = 1000
"""Approximate number of points that score random samples."""

_TRIALS = 150
"""Number of random samples of three points."""

_REFINEMENTS = 4
"""Number of refits to the inliers of the best sample."""

_COLLINEAR = 1e-6
"""Twice the area in square metres of a sample up to which its points lie on a line."""

_SPREAD = 3
"""Ratio of the side of the image to the maximum offset between the points of a sample."""

LARGE = 0.25
"""Minimum surface area of a large piece relative to the largest piece; the nearest large piece is
the object."""

FEWEST = 0.004
"""Minimum fraction of the image pixels covered by the object."""

JOINED = 0.3
"""Maximum distance in metres between pieces of a self-occluding object, such as an arm before a
chest."""

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
        """Return the signed distances of points, shape (..., 3), in metres.

        They are positive in front of the plane.
        """
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
    """Find the planes that bound a scene, such as floor and walls, by RANSAC.

    Planes through three random points are tried [Fischler and Bolles 1981]. A background plane
    contains at least ``SHARE`` of the points, reaches the margins of the image, and has almost no
    points behind it, except on other background planes. The result is deterministic.

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
    # About _N_POINTS points are enough.
    step = max(1, round((seen.size / _N_POINTS) ** 0.5))
    points = points[::step, ::step]
    seen = seen[::step, ::step]
    n_seen = np.count_nonzero(seen)
    fewest = max(SHARE * n_seen, 3)
    at_edge = _edge(seen.shape)
    planes: list[Plane] = []
    # Points on no background plane so far, and those of them on other planes, such as the back of a
    # chair, which are left out of the search until a background plane is found.
    remaining = seen.copy()
    is_clutter = np.zeros(seen.shape, dtype=bool)
    for _ in range(3 * MOST_PLANES):
        candidates = remaining & ~is_clutter
        if len(planes) == MOST_PLANES or np.count_nonzero(candidates) < fewest:
            break
        plane = _best_plane(points, candidates, random)
        if plane is None:
            break
        on_plane = candidates & plane.holds(points)
        n_on_plane = np.count_nonzero(on_plane)
        if n_on_plane < fewest:
            break
        behind = remaining & (plane.heights(points) < -2 * plane.slack(points))
        bounds_the_scene = np.count_nonzero(behind) <= BEHIND * n_seen
        reaches_the_edge = np.count_nonzero(on_plane & at_edge) >= EDGE * n_on_plane
        if bounds_the_scene and reaches_the_edge:
            planes.append(plane)
            remaining &= ~plane.holds(points)
            is_clutter[:] = False
        else:
            is_clutter |= on_plane
    return planes


def _edge(shape: tuple[int, ...]) -> Mask:
    """Return the margins of an image."""
    rows, columns = (max(1, round(EDGE / 2 * length)) for length in shape)
    result = np.ones(shape, dtype=bool)
    result[rows:-rows, columns:-columns] = False
    return result


def _best_plane(points: Points, candidates: Mask, random: np.random.Generator) -> Plane | None:
    """Return the plane with the most inliers among those through random neighbours.

    It is refined by least squares.
    """
    normals, offsets = _random_planes(points, candidates, random)
    if not len(normals):
        return None
    inside = points[candidates]
    some = inside[:: max(1, len(inside) // _N_SCORED)]
    slack = UNEVEN + np.abs(offsets[:, None]) * (error_at(some[:, 2]) / some[:, 2])
    n_inliers = (np.abs(normals @ some.T - offsets[:, None]) <= slack).sum(axis=1)
    best = int(n_inliers.argmax())
    return _refined(Plane.facing(normals[best], float(offsets[best])), inside)


def _random_planes(
    points: Points, candidates: Mask, random: np.random.Generator
) -> tuple[Points, FloatArray]:
    """Draw planes, each through a random candidate and two random pixels near it.

    A draw is dropped if its three points lie on a line, or one is no candidate.

    Parameters
    ----------
    points
        Shape (h, w, 3), metres in the camera's frame.
    candidates
        Pixels from which planes are drawn, shape (h, w).
    random
        Source of randomness.

    Returns
    -------
    normals : numpy.ndarray
        Unit normals, shape (k, 3), with k at most :data:`_TRIALS`.
    offsets : numpy.ndarray
        Distance of each plane from the camera along its normal, shape (k,), metres.
    """
    rows, columns = np.nonzero(candidates)
    first = random.integers(len(rows), size=_TRIALS)
    second = _near(rows[first], columns[first], candidates.shape, random)
    third = _near(rows[first], columns[first], candidates.shape, random)
    a = points[rows[first], columns[first]]
    b = points[second]
    c = points[third]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    is_plane = (lengths > _COLLINEAR) & candidates[second] & candidates[third]
    normals = normals[is_plane] / lengths[is_plane, None]
    offsets = (normals * a[is_plane]).sum(axis=1)
    return normals, offsets


def _near(
    rows: IntArray, columns: IntArray, shape: tuple[int, ...], random: np.random.Generator
) -> tuple[IntArray, IntArray]:
    """Return a random pixel near each given one.

    Neighbours share a plane more often than others.
    """
    height, width = shape
    down = random.integers(-height // _SPREAD, height // _SPREAD + 1, _TRIALS)
    right = random.integers(-width // _SPREAD, width // _SPREAD + 1, _TRIALS)
    return np.clip(rows + down, 0, height - 1), np.clip(columns + right, 0, width - 1)


def _refined(plane: Plane, points: Points) -> Plane | None:
    """Return a plane fitted to its inliers again and again; None if it loses them."""
    for _ in range(_REFINEMENTS):
        held = points[plane.holds(points)]
        if len(held) < 3:
            return None
        centre = held.mean(axis=0)
        normal = np.linalg.eigh((held - centre).T @ (held - centre))[1][:, 0]
        plane = Plane.facing(normal, float(normal @ centre))
    return plane


def find_object(points: Points, seen: Mask, planes: Sequence[Plane]) -> Mask:
    """Return the mask of the object: the nearest large piece of the scene on none of the planes.

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

    # Label of the piece of each free pixel, -1 elsewhere; a piece ends where the depth jumps.
    labels = np.full(free.shape, -1, dtype=np.int64)
    labels[free] = np.arange(np.count_nonzero(free))
    labels[free] = _joined(labels, depths, jump(depths))

    # An arm before the chest is a piece of its own. Pieces that touch in the image at similar
    # depths are grouped, and the group of the nearest large piece is the object.
    nearest = _nearest_large_piece(depths[free], labels[free], seen.size)
    group_of_piece = _joined(labels, depths, np.full_like(depths, JOINED))
    is_of_object = group_of_piece == group_of_piece[nearest]
    return np.asarray(free & is_of_object[labels])


def _nearest_large_piece(depths: FloatArray, labels: IntArray, n_pixels_of_image: int) -> int:
    """Return the label of the nearest large piece of a scene, by the mean depth of the pieces.

    Parameters
    ----------
    depths
        Depth of each pixel of a piece, shape (k,), metres.
    labels
        Label of the piece of each of these pixels, from 0, shape (k,).
    n_pixels_of_image
        Number of all pixels of the image.

    Raises
    ------
    DepthError
        If no piece has a sufficient share of the image.
    """
    # Relative areas of the pieces: at twice the depth, a pixel covers four times the area.
    areas = np.bincount(labels, weights=depths**2)
    n_pixels = np.bincount(labels)
    mean_depths = np.bincount(labels, weights=depths) / n_pixels
    is_large = (areas >= LARGE * areas.max()) & (n_pixels >= FEWEST * n_pixels_of_image)
    if not is_large.any():
        problem = (
            f"no piece left of the scene holds {FEWEST:.1%} of the image,"
            f" the largest {n_pixels.max()} pixels"
        )
        raise DepthError(problem, _HINT)
    large = np.flatnonzero(is_large)
    return int(large[mean_depths[large].argmin()])


def _joined(labels: IntArray, depths: Depths, limits: Depths) -> IntArray:
    """Return the group of each label of an image.

    Labels of neighbours are in one group if their depths differ by at most the limit of the nearer
    one.
    """
    label = labels.ravel()
    depth = depths.ravel()
    limit = limits.ravel()
    pairs = [neighbours(depths > 0, direction) for direction in (RIGHT, DOWN)]
    one, other = np.concatenate(pairs, axis=1)
    limit_of_nearer = np.where(depth[one] <= depth[other], limit[one], limit[other])
    is_close = (label[one] >= 0) & (label[other] >= 0)
    is_close &= np.abs(depth[one] - depth[other]) <= limit_of_nearer
    return component_labels(label[one[is_close]], label[other[is_close]], int(labels.max()) + 1)
