"""The object of a depth image where no mask names it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from benchmark.depth.errors import NoObject
from benchmark.depth.mask import Mask
from benchmark.depth.planes import Plane, error_at
from benchmark.depth.reading import Depths
from benchmark.geometry.mesh import Points

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
