"""Which pixels of a depth image lie on one surface.

Neighbours are the next readings, and only a jump of depth parts them.

A camera has no reading at many pixels: dead lines, dark or shiny places, pixels between those of a
smaller image that was registered to this one. The absence of a reading is no edge of a body, so a
pixel's neighbour in a direction is the next pixel with a reading, beyond up to
:data:`NEIGHBOUR_GAP` without one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.depth.reading import Depths, Mask
from benchmark.errors import DepthError
from benchmark.geometry.cleaning import component_labels
from benchmark.geometry.mesh import IntArray

NEIGHBOUR_GAP = 2
"""Maximum number of pixels without a reading between neighbours, as where every third pixel has
one."""

LARGEST_ERROR = 0.1
"""Upper bound in metres on the measurement error in the depth difference of neighbours on one
surface."""

LEAST_SUPPORT = 3
"""Minimum number of the eight neighbours on the same surface; a pixel with fewer is a flying
pixel."""

SMALLEST_PIECE = 0.01
"""Minimum share of the object's pixels in a piece that jumps of depth part from its main piece."""

SOLID = 0.5
"""Minimum share of neighbours on the same surface, averaged over such a piece.

An arm before a chest has .6 and more even if it is two pixels wide. Averages of depths and missing
pixels lie scattered among others."""

LEAST_OBJECT = 0.5
"""Minimum share of the object's readings that remain after flying pixels and scattered pieces are
dropped."""

MOST_FLYING = 0.25
"""Maximum share of the readings of an image on no surface if the object is to be found in it."""

HOW_TO_RESIZE = (
    "resize depth images by the nearest neighbour, not by averages, which mix depths with pixels"
    " without one"
)
"""Hint of the errors of an image whose depths were averaged."""

LEAST_MEASURED = 0.5
"""Minimum share of pixels with a reading in an image whose background is not cut away."""

MOST_DEAD = 0.25
"""Maximum share of an image in dead lines, which a camera fails to read."""

RIGHT = (0, 1)
DOWN = (1, 0)
DIRECTIONS = (RIGHT, DOWN, (1, 1), (1, -1))
"""Directions in which each pair of the eight neighbours is met once: steps in rows and columns."""


def error_at(depths: Depths) -> Depths:
    """Return the maximum depth error in metres, for depths in metres.

    The error is three standard deviations of a structured-light camera, 1.4 mm at 1 m and growing
    with the square of the depth [Khoshelham and Elberink 2012], but at most 0.3 m.
    """
    return np.asarray(np.minimum(3 * 0.0014 * depths**2, 0.3))


def jump(depths: Depths) -> Depths:
    """Return the depth difference in metres above which neighbours belong to different surfaces."""
    return np.asarray(0.03 + np.minimum(error_at(depths), LARGEST_ERROR))


def neighbours(seen: Mask, direction: tuple[int, int]) -> tuple[IntArray, IntArray]:
    """Return all pairs of pixels with a reading that are neighbours in one direction.

    The neighbour of a pixel is the next pixel with a reading in that direction, beyond at most
    :data:`NEIGHBOUR_GAP` pixels without one.

    Parameters
    ----------
    seen
        Pixels with a reading, shape (h, w), neither of them 0.
    direction
        Steps down, not negative, and to the right: (0, 1) for pairs in a row.

    Returns
    -------
    first, second : numpy.ndarray
        Both pixels of each pair, as indices into the flat image, shape (k,).
    """
    height, width = seen.shape
    numbers = np.arange(seen.size).reshape(seen.shape)
    is_open = seen.copy()  # pixels whose neighbour is not found yet
    # An image of one row, or of one column, has no pairs in some directions.
    first = [numbers[:0, 0]]
    second = [numbers[:0, 0]]
    for distance in range(1, NEIGHBOUR_GAP + 2):
        down = distance * direction[0]
        right = distance * direction[1]
        # Columns from which a step of this length stays in the image.
        start = max(0, -right)
        stop = width - max(0, right)
        if down >= height or start >= stop:
            break
        here = np.s_[: height - down, start:stop]
        there = np.s_[down:, start + right : stop + right]
        found = is_open[here] & seen[there]
        first.append(numbers[here][found])
        second.append(numbers[there][found])
        is_open[here] &= ~found
    return np.concatenate(first), np.concatenate(second)


def dead_lines(seen: Mask) -> tuple[Mask, Mask]:
    """Return which rows, shape (h,), and columns, shape (w,), are dead.

    They have no reading, and lie between others that have.

    There are none unless most other pixels have a reading: if the background is cut away, an empty
    line may lie between two objects.
    """
    rows = _empty_between(np.asarray(seen.any(axis=1)))
    columns = _empty_between(np.asarray(seen.any(axis=0)))
    n_others = np.count_nonzero(~rows) * np.count_nonzero(~columns)
    if np.count_nonzero(seen) < LEAST_MEASURED * n_others:
        return np.zeros_like(rows), np.zeros_like(columns)
    return rows, columns


def _empty_between(is_live: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which lines have no reading and lie between lines with one."""
    after_first = np.logical_or.accumulate(is_live)
    before_last = np.logical_or.accumulate(is_live[::-1])[::-1]
    return np.asarray(~is_live & after_first & before_last)


def on_surface(depths: Depths, mask: Mask) -> Mask:
    """Return the mask of an object without flying pixels, which lie between two surfaces.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing depth.
    mask
        Pixels of the object, with and without a depth, shape (h, w).

    Returns
    -------
    numpy.ndarray
        Mask of the pixels on the surface, shape (h, w).

    Raises
    ------
    DepthError
        If most pixels have no neighbours, or most are not on the surface.
    """
    is_object = mask & (depths > 0)
    n_object = np.count_nonzero(is_object)
    first, second = _pairs(depths > 0, is_object)
    n_neighbours = np.bincount(np.concatenate([first, second]), minlength=mask.size)
    if np.median(n_neighbours[is_object.ravel()]) < LEAST_SUPPORT:
        problem = "most pixels of the object have no neighbour with a depth"
        hint = (
            "if the image was registered to a larger one, pass depth and intrinsics at the"
            " resolution of the depth camera; or check the mask"
        )
        raise DepthError(problem, hint)
    kept = without_flying_pixels(depths, is_object)
    if np.count_nonzero(kept) < LEAST_OBJECT * n_object:
        problem = f"the depth jumps between most of the {n_object} pixels of the object"
        raise DepthError(problem, f"{HOW_TO_RESIZE}; or check the mask")
    return kept


def without_flying_pixels(depths: Depths, mask: Mask) -> Mask:
    """Return a mask without flying pixels and scattered pieces.

    Flying pixels are readings between two surfaces; few of their neighbours have a similar depth.
    Scattered pieces lie before the surface, where a program that resized the image has averaged
    depths with missing ones. Of the pieces that remain connected by small jumps of depth, the
    largest is kept, and others, such as an arm before a chest, if they are large and solid.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing depth.
    mask
        Pixels of the object, which have a depth, shape (h, w).
    """
    depth = depths.ravel()
    first, second = _pairs(depths > 0, mask)
    difference = np.abs(depth[first] - depth[second])

    # Numbers of neighbours of each pixel, and of those at a similar depth.
    n_around = np.zeros(depth.size)
    n_alike = np.zeros(depth.size)
    for one in (first, second):
        is_alike = difference <= jump(depth[one])
        n_around += np.bincount(one, minlength=depth.size)
        n_alike += np.bincount(one[is_alike], minlength=depth.size)
    is_supported = mask.ravel() & (n_alike >= LEAST_SUPPORT)

    # Pieces: pixels with enough similar neighbours, connected where the depth jumps little.
    is_link = difference <= jump(np.minimum(depth[first], depth[second]))
    is_link &= is_supported[first] & is_supported[second]
    labels = component_labels(first[is_link], second[is_link], depth.size)
    n_pixels = np.bincount(labels, weights=is_supported)
    # A piece is solid if the neighbours of its pixels have, on average, mostly their depth.
    shares = np.divide(n_alike, n_around, out=np.zeros(depth.size), where=n_around > 0)
    solidity = np.bincount(labels, weights=shares * is_supported) / np.maximum(n_pixels, 1)
    is_kept = (n_pixels >= SMALLEST_PIECE * n_pixels.sum()) & (solidity >= SOLID)
    is_kept[n_pixels.argmax()] = True
    return np.asarray((is_supported & is_kept[labels]).reshape(mask.shape))


def _pairs(seen: Mask, mask: Mask) -> tuple[IntArray, IntArray]:
    """Return the pairs of neighbours in all directions, of which both are in a mask."""
    is_inside = mask.ravel()
    pairs = [neighbours(seen, direction) for direction in DIRECTIONS]
    first, second = np.concatenate(pairs, axis=1)
    are_inside = is_inside[first] & is_inside[second]
    return first[are_inside], second[are_inside]
