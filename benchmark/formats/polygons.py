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
    """Return vertex indices counted from 0, of a file whose format counts from ``first``.

    Parameters
    ----------
    corners
        Vertex indices as they stand in the file.
    n_vertices
        Number of vertices.
    first
        Index of the first vertex in this format, 0 or 1.

    Raises
    ------
    InvalidMesh
        If vertices are missing, or the file evidently counts from the other number.
    """
    low = int(corners.min())
    high = int(corners.max())
    other = 1 - first  # 1 or 0
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
    """Split polygons into fans of triangles, each around the first corner that sees all others.

    Parameters
    ----------
    vertices
        Coordinates, shape (n, 3).
    corners
        Vertices of all polygons one after the other, shape (k,).
    sizes
        Number of corners of each polygon, shape (p,). Some exporters write polygons without
        corners, which are left out.

    Returns
    -------
    numpy.ndarray
        Triangles, shape (m, 3).

    Raises
    ------
    InvalidMesh
        If a polygon has one or two corners, or none that sees all others.
    """
    sizes = sizes[sizes != 0]
    too_few = np.flatnonzero(sizes < 3)
    if too_few.size:
        size = counted(int(sizes[too_few[0]]), "corner")
        problem = f"face {too_few[0] + 1} of {len(sizes)} has {size}"
        raise InvalidMesh(problem, "drop faces of fewer than three corners")
    starts = np.cumsum(sizes) - sizes  # place of the first corner of each polygon
    centres = _fan_centres(vertices, corners, starts, sizes)
    blind = np.flatnonzero(centres < 0)
    if blind.size:
        problem = (
            f"face {blind[0] + 1} of {len(sizes)} is a polygon "
            "without a corner that sees all others"
        )
        raise InvalidMesh(problem, "triangulate the polygons before exporting them")
    return _fans(corners, starts, sizes, centres)


def _fans(corners: IntArray, starts: IntArray, sizes: IntArray, centres: IntArray) -> IntArray:
    """Return the triangles of fans, each around one corner of a polygon, shape (m, 3).

    Parameters
    ----------
    corners
        Vertices of all polygons one after the other, shape (k,).
    starts, sizes
        Where each polygon begins among them, and its number of corners, at least 3, shape (p,).
    centres
        Place of the corner in its polygon around which the fan lies, from 0, shape (p,).
    """
    # The polygon of each triangle, and the triangle's place in the fan: a polygon of k corners has
    # k - 2 triangles.
    numbers = np.arange(len(sizes))
    polygon = np.repeat(numbers, sizes - 2)
    first_triangles = starts - 2 * numbers
    within = np.arange(len(polygon)) - first_triangles[polygon]
    triangle = []
    for steps_from_centre in (0, within + 1, within + 2):
        place = (centres[polygon] + steps_from_centre) % sizes[polygon]
        triangle.append(corners[starts[polygon] + place])
    return np.stack(triangle, axis=1)


def _fan_centres(
    vertices: Points, corners: IntArray, starts: IntArray, sizes: IntArray
) -> IntArray:
    """Find the first corner of each polygon that sees all others, around which it is split.

    Parameters
    ----------
    vertices
        Coordinates, shape (n, 3).
    corners
        Vertices of all polygons one after the other, shape (k,).
    starts, sizes
        Where each polygon begins among them, and its number of corners, shape (p,).

    Returns
    -------
    numpy.ndarray
        Place of that corner in its polygon, from 0; -1 if there is none, shape (p,).
    """
    centres = np.zeros(len(sizes), dtype=np.int64)  # any corner of a triangle sees the others
    extent = np.abs(vertices).max() or 1.0  # products of coordinates stay in range
    if not np.isfinite(extent):
        return centres  # such vertices are refused later
    # Polygons with many corners are tried one by one, with a method that tries few corners. Others
    # of equal size are tried together, in blocks that fit in memory.
    for size in np.unique(sizes[sizes > 3]):
        of_size = np.flatnonzero(sizes == size)
        if size > _MOST_CORNERS:
            for polygon in of_size:
                places = starts[polygon] + np.arange(size)
                centres[polygon] = _seeing_corner(vertices[corners[places]] / extent)
        else:
            for block in np.array_split(of_size, len(of_size) // _MOST_POLYGONS + 1):
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
    """Return the first corner of a large polygon whose fan of triangles nowhere folds back.

    The triangle of side i and a corner at c faces like the polygon if ``offsets[i] + slopes[i] @
    c`` is positive. In a fan, only few and small triangles may face the other way, so that the sum
    of the negative numbers is bounded. If a corner exceeds the bound, the sum over its negative
    sides, which is linear in c, also excludes other corners, without a look at each side.

    Parameters
    ----------
    polygon
        Positions of its corners, shape (k, 3).

    Returns
    -------
    int
        Place of the corner; -1 if there is none, or none was found among those tried.
    """
    centred = polygon - polygon.mean(axis=0)
    following = np.roll(centred, -1, axis=0)
    normals = np.cross(centred, following)
    whole_normal = normals.sum(axis=0)
    # Of each side: by how much its triangle with a corner faces like the polygon.
    slopes = np.cross(whole_normal, following - centred)
    offsets = normals @ whole_normal
    most_folded = _FOLDED * (whole_normal @ whole_normal)
    untried = np.arange(len(polygon))
    n_fans = 0  # that were tried in full, which is slow
    for _ in range(_MOST_TRIES):
        if not untried.size or n_fans == _MOST_FANS:
            return -1
        corner = untried[0]
        untried = untried[1:]
        ahead = offsets + slopes @ centred[corner]
        is_behind = ahead < 0
        if -ahead[is_behind].sum() > most_folded:
            # Leave out corners that cannot see the sides which this corner does not see.
            offset = offsets[is_behind].sum()
            slope = slopes[is_behind].sum(axis=0)
            untried = untried[offset + centred[untried] @ slope >= -most_folded]
        elif _looks_ahead(polygon[None], int(corner))[0]:
            return int(corner)
        else:
            n_fans += 1
    return -1
