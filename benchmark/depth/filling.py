"""Depths of an object where the camera has no reading.

They lie between its pixels, never where something else was measured.

The absence of a reading is no edge of a body; only a jump of depth is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, distance_transform_edt

from benchmark.depth.neighbours import NEIGHBOUR_GAP, error_at, jump
from benchmark.depth.reading import Depths, Mask
from benchmark.geometry.mesh import IntArray

WIDEST = 0.1
"""Widest gap in metres that is filled within a mask, which says that the object is there."""

_ACROSS = 8
"""Distance in pixels within which a reading behind the object keeps a pixel open.

It lies along the other axis: the pixel may be one of a gap between two legs, most of whose pixels
have no reading."""

_ROUNDS = 3
"""Number of rounds: pixels may lie between filled ones, as where every other row and column has
readings."""

_FOLLOWS = 0.75
"""Share of the outline of a mask within :data:`NEIGHBOUR_GAP` pixels of the surface if the mask
fits the object."""

_UNEVEN = 0.01
"""Unevenness in metres of a surface between the pixels beside a gap of its mask."""


class _Ends(NamedTuple):
    """The known pixels at both ends of the gap around each pixel, along one axis.

    Each field is a pair: the end before the pixel (left or above) and the end after it (right or
    below). All arrays have shape (h, w).

    Parameters
    ----------
    depths
        Depths of the two ends; 0 beyond the image.
    on_object
        Whether the ends are pixels of the object; false beyond the image.
    distances
        Numbers of pixels from here to the ends; an end beyond the image is just outside of it.
    """

    depths: tuple[Depths, Depths]
    on_object: tuple[Mask, Mask]
    distances: tuple[IntArray, IntArray]


def filled(
    depths: Depths, kept: Mask, averaged: Mask, mask: Mask | None, allowed: Mask, widest: int
) -> Depths:
    """Return the depths of an object, with those between its pixels; 0 elsewhere.

    A pixel without a reading is filled if the next readings in its row or column are two pixels of
    the object without a jump of depth between them, and no near reading along the other axis lies
    behind them.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing depth.
    kept
        Pixels of the object on its surface, shape (h, w).
    averaged
        Readings that count as missing, see :func:`averages`, shape (h, w).
    mask
        The object as a user passes it, shape (h, w), or None. If its outline follows the surface,
        missing pixels within it are those of the object.
    allowed
        Other pixels that are certainly missing, shape (h, w).
    widest
        Maximum number of pixels between two of the object within the mask and ``allowed``;
        elsewhere, :data:`NEIGHBOUR_GAP`.
    """
    others = (depths > 0) & ~kept & ~averaged
    surface = np.where(kept, depths, 0)
    if mask is not None:
        # Within the mask, only what was measured there speaks against it.
        surface = _in_rounds(depths, surface, others & mask, others | ~mask, NEIGHBOUR_GAP)
        if _fits(mask, surface > 0):
            allowed = allowed | mask
    surface = _in_rounds(depths, surface, others, others, NEIGHBOUR_GAP)
    return _in_rounds(depths, surface, others, others | ~allowed, widest)


def _in_rounds(depths: Depths, surface: Depths, others: Mask, bounds: Mask, widest: int) -> Depths:
    """Return a surface after several rounds; see :func:`_filled_once`."""
    for _ in range(_ROUNDS):
        surface = _filled_once(depths, surface, others, bounds, widest)
    return surface


def _fits(mask: Mask, is_surface: Mask) -> bool:
    """Return whether the outline of a mask follows the pixels of a surface.

    That of a box or a hull does not.
    """
    outline = mask & ~binary_erosion(mask)
    distances = distance_transform_edt(~is_surface)[outline]
    return bool(np.quantile(distances, _FOLLOWS) <= NEIGHBOUR_GAP + 1)


def averages(depths: Depths, kept: Mask, dropped: Mask) -> Mask:
    """Return which dropped readings are averages of the surface and missing pixels, shape (h, w).

    Averages with zeros lie before the surface. Those with a large number for missing pixels lie
    behind it, but scattered, while the background shows in lines beside the object.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing depth.
    kept
        Pixels of the object on its surface, shape (h, w).
    dropped
        Readings that are on no surface, shape (h, w).
    """
    nearest = distance_transform_edt(~kept, return_distances=False, return_indices=True)
    is_before = depths < depths[tuple(nearest)]
    is_scattered = (_width(kept) <= NEIGHBOUR_GAP) & (_width(kept.T).T <= NEIGHBOUR_GAP)
    return np.asarray(dropped & (is_before | is_scattered))


def _width(is_end: Mask) -> IntArray:
    """Return the number of pixels in the gap around each pixel in its row."""
    before, after = _columns_of_ends(is_end)
    return after - before - 1


def in_gaps_of_mask(depths: Depths, kept: Mask) -> Mask:
    """Return readings outside a mask that lie on the surface of the object, shape (h, w).

    They lie between two pixels of the object.

    The gap is at most :data:`NEIGHBOUR_GAP` pixels wide. If the background was measured in it, it
    is an edge.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing depth.
    kept
        Pixels of the object on its surface, shape (h, w).
    """
    surface = np.where(kept, depths, 0)
    nearest = distance_transform_edt(~kept, return_distances=False, return_indices=True)
    before = depths[tuple(nearest)]
    others = (depths > before + jump(before)) & ~kept
    between = _in_rounds(depths, surface, others, others, NEIGHBOUR_GAP)
    is_alike = np.abs(depths - between) <= _UNEVEN + error_at(between)
    return np.asarray((depths > 0) & ~kept & (between > 0) & is_alike)


def _filled_once(
    depths: Depths, surface: Depths, others: Mask, bounds: Mask, widest: int
) -> Depths:
    """Fill the gaps of a surface by interpolation along rows and along columns, in one pass.

    A gap is a run of pixels without a depth between two pixels of the object. It is filled unless
    the depth jumps from one of the two to the other, or a reading across the gap lies behind the
    surface. A pixel in a gap along its row and in one along its column belongs to the narrower one.

    Parameters
    ----------
    depths
        Depth image, shape (h, w), metres.
    surface
        Depths of the pixels of the object, shape (h, w); 0 elsewhere.
    others
        Mask of the readings that are not of the object, shape (h, w).
    bounds
        Mask of the pixels that end a gap, besides those of the object, shape (h, w).
    widest
        Maximum number of pixels in a gap.

    Returns
    -------
    numpy.ndarray
        Depths of the surface with those of the gaps, shape (h, w); 0 elsewhere.
    """
    known = np.where(surface > 0, surface, np.where(others, depths, 0))
    on_object = surface > 0
    is_end = on_object | bounds
    # For each pixel, the nearest ends before and after it, in its row and in its column.
    in_row = _ends(known, on_object, is_end)
    in_column = _transposed(_ends(known.T, on_object.T, is_end.T))
    result = surface.copy()
    narrowest = np.full(surface.shape, widest + 1)
    for along, across in ((in_row, in_column), (in_column, in_row)):
        gap = along.distances[0] + along.distances[1] - 1
        between = _interpolated(along)
        is_narrower = gap < narrowest
        fits = ~is_end & _are_on_one_surface(along) & is_narrower & ~_is_behind(across, between)
        result[fits] = between[fits]
        narrowest[fits] = gap[fits]
    return result


def _interpolated(ends: _Ends) -> Depths:
    """Return the depth of each pixel on the straight line between the ends of its gap."""
    before, after = ends.depths
    to_before, to_after = ends.distances
    return np.asarray(before + (after - before) * to_before / np.maximum(to_before + to_after, 1))


def _are_on_one_surface(ends: _Ends) -> Mask:
    """Return whether both ends of the gap around each pixel are of the object, without a jump."""
    before, after = ends.depths
    is_smooth = np.abs(before - after) <= jump(np.minimum(before, after))
    return np.asarray(ends.on_object[0] & ends.on_object[1] & is_smooth)


def _ends(known: Depths, on_object: Mask, is_end: Mask) -> _Ends:
    """Find the ends of the gap around each pixel, to its left and to its right in its row.

    A pixel that is itself an end has itself at both ends. Where the gap reaches the border of the
    image, its end is the column just outside of it.

    Parameters
    ----------
    known
        Depths in metres, 0 where there is no reading, shape (h, w).
    on_object
        Pixels of the object, shape (h, w).
    is_end
        Pixels that end a gap, shape (h, w).
    """
    columns = np.arange(is_end.shape[1])
    before, after = _columns_of_ends(is_end)
    return _Ends(
        depths=(_in_columns(known, before), _in_columns(known, after)),
        on_object=(_in_columns(on_object, before), _in_columns(on_object, after)),
        distances=(columns - before, after - columns),
    )


def _in_columns(values: NDArray[Any], columns: IntArray) -> NDArray[Any]:
    """Return, for each pixel, the value in another column of its row.

    Parameters
    ----------
    values
        An image, shape (h, w).
    columns
        The other column for each pixel, shape (h, w); -1 and w, the columns beside the image, give
        0.
    """
    bordered = np.pad(values, ((0, 0), (1, 1)))
    return np.take_along_axis(bordered, columns + 1, axis=1)


def _columns_of_ends(is_end: Mask) -> tuple[IntArray, IntArray]:
    """Return the columns of the ends of the gap around each pixel in its row, each of shape (h, w).

    Where the gap reaches the border of the image, these are -1 on the left and w on the right.
    """
    width = is_end.shape[1]
    columns = np.arange(width)
    before = np.maximum.accumulate(np.where(is_end, columns, -1), axis=1)
    after = np.minimum.accumulate(np.where(is_end, columns, width)[:, ::-1], axis=1)[:, ::-1]
    return before, after


def _transposed(ends: _Ends) -> _Ends:
    """Return the ends in columns of an image from those in rows of the transposed one."""
    depths, on_object, distances = ends
    return _Ends(
        (depths[0].T, depths[1].T),
        (on_object[0].T, on_object[1].T),
        (distances[0].T, distances[1].T),
    )


def _is_behind(across: _Ends, between: Depths) -> Mask:
    """Return where a near reading along the other axis lies behind a depth.

    A reading beside it that is not on the object counts, too.
    """
    result = np.zeros(between.shape, dtype=bool)
    limit = jump(between)
    for depths, on_object, distances in zip(*across, strict=True):
        farther = np.where(on_object, between + limit, between - limit)
        result |= (distances <= _ACROSS) & (depths > 0) & (depths > farther)
    return result
