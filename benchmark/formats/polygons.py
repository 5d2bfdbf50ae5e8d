"""Corners of polygons as files list them, which are counted from 0 and split into triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import InvalidMesh
from benchmark.geometry.mesh import IntArray, Points
from benchmark.text import counted

#: Polygons of one size that are split at a time.
_MOST_POLYGONS = 2**16

#: Most corners of polygons that are looked at together, each corner of each of them; corners of a
#: larger polygon are looked at in linear time.
_MOST_CORNERS = 64

#: Most corners of a larger polygon that are tried as the centre of its fan.
_MOST_TRIES = 500

#: Most corners whose fan is made.
_MOST_FANS = 20

#: Area of a triangle of a fan that may look the other way, as a share of the polygon: that of a
#: corner on a side, in single precision. Of a larger polygon, that of all such triangles together.
_FOLDED = 1e-6


def count_from_0(corners: IntArray, n_vertices: int, first: int) -> IntArray:
    """Return corners counted from 0 instead of ``first``.

    Raises
    ------
    InvalidMesh
        If vertices are missing, or the file counts otherwise.
    """
    low = int(corners.min())
    high = int(corners.max())
    other = 1 - first
    fits = first <= low and high < n_vertices + first
    if not fits and other <= low and high < n_vertices + other:
        hint = "subtract 1 from each corner" if other else "add 1 to each corner"
        raise InvalidMesh(f"this format counts vertices from {first}, the file from {other}", hint)
    if not fits:
        last = first + n_vertices - 1
        problem = f"faces name vertices {low} to {high}, but there are {first} to {last}"
        raise InvalidMesh(problem, "fetch or export the file again")
    return corners - first


def split_polygons(vertices: Points, corners: IntArray, sizes: IntArray) -> IntArray:
    """Split polygons into fans of triangles, around the first corner that sees all others.

    A face without corners, as some exporters write, is none.
    """
    sizes = sizes[sizes != 0]
    too_few = np.flatnonzero(sizes < 3)
    if too_few.size:
        size = counted(int(sizes[too_few[0]]), "corner")
        problem = f"face {too_few[0] + 1} of {len(sizes)} has {size}"
        raise InvalidMesh(problem, "drop faces of fewer than three corners")
    starts = np.cumsum(sizes) - sizes
    centres = _fan_centres(vertices, corners, starts, sizes)
    blind = np.flatnonzero(centres < 0)
    if blind.size:
        problem = (
            f"face {blind[0] + 1} of {len(sizes)} is a polygon "
            "without a corner that sees all others"
        )
        raise InvalidMesh(problem, "triangulate the polygons before exporting them")
    # The polygon of each triangle, and the triangle's place in the fan.
    polygon = np.repeat(np.arange(len(sizes)), sizes - 2)
    within = np.arange(len(polygon)) - np.repeat(starts - 2 * np.arange(len(starts)), sizes - 2)
    turned = [(centres[polygon] + step) % sizes[polygon] for step in (0, within + 1, within + 2)]
    return np.stack([corners[starts[polygon] + place] for place in turned], axis=1)


def _fan_centres(
    vertices: Points, corners: IntArray, starts: IntArray, sizes: IntArray
) -> IntArray:
    """Return the place of the first corner of each polygon that sees all others; -1 for none."""
    centres = np.zeros(len(sizes), dtype=np.int64)
    extent = np.abs(vertices).max() or 1.0  # products of coordinates stay in range
    if not np.isfinite(extent):
        return centres  # this is refused as a mesh
    for size in np.unique(sizes[sizes > 3]):
        same = np.flatnonzero(sizes == size)
        if size > _MOST_CORNERS:
            for polygon in same:
                places = starts[polygon] + np.arange(size)
                centres[polygon] = _seeing_corner(vertices[corners[places]] / extent)
            continue
        for block in np.array_split(same, len(same) // _MOST_POLYGONS + 1):
            places = starts[block, None] + np.arange(size)
            centres[block] = _seeing_corners(vertices[corners[places]] / extent)
    return centres


def _seeing_corners(polygons: Points) -> IntArray:
    """Return the first corner of each polygon, shape (p, k, 3), whose fan nowhere folds back.

    -1 if there is none.
    """
    first = np.full(len(polygons), -1)
    waiting = np.arange(len(polygons))
    for corner in range(polygons.shape[1]):
        is_ahead = _looks_ahead(polygons[waiting], corner)
        first[waiting[is_ahead]] = corner
        waiting = waiting[~is_ahead]
        if not len(waiting):
            break
    return first


def _looks_ahead(polygons: Points, corner: int) -> NDArray[np.bool_]:
    """Return whether the fan around a corner of polygons, shape (p, k, 3), nowhere folds back."""
    a, *others = np.moveaxis(np.roll(polygons, -corner, axis=1), 1, 0)
    sides = np.stack(others) - a
    normals = np.cross(sides[:-1], sides[1:])
    whole = normals.sum(axis=0)
    square = (whole**2).sum(axis=1)
    is_ahead = ((normals * whole).sum(axis=2) >= -_FOLDED * square).all(axis=0)
    # Of sides that cross, halves cancel.
    is_ahead &= square >= _FOLDED * (normals**2).sum(axis=(0, 2))
    return np.asarray(is_ahead)


def _seeing_corner(polygon: Points) -> int:
    """Return the first corner of a large polygon, shape (k, 3), whose fan nowhere folds back.

    -1 if there is none. How far ahead the triangle of a side and a corner looks is linear in the
    corner. So is the sum over the sides that one corner does not see: with that corner go all
    others for which this sum alone is too far behind.
    """
    centred = polygon - polygon.mean(axis=0)
    following = np.roll(centred, -1, axis=0)
    normals = np.cross(centred, following)
    whole = normals.sum(axis=0)
    slopes = np.cross(whole, following - centred)
    offsets = normals @ whole
    most_folded = _FOLDED * (whole @ whole)
    untried = np.arange(len(polygon))
    n_fans = 0
    for _ in range(_MOST_TRIES):
        if not untried.size or n_fans == _MOST_FANS:
            return -1
        corner = untried[0]
        untried = untried[1:]
        ahead = offsets + slopes @ centred[corner]
        behind = ahead < 0
        if -ahead[behind].sum() > most_folded:
            offset = offsets[behind].sum()
            slope = slopes[behind].sum(axis=0)
            untried = untried[offset + centred[untried] @ slope >= -most_folded]
        elif _looks_ahead(polygon[None], int(corner))[0]:
            return int(corner)
        else:
            n_fans += 1
    return -1
