"""Orthographic z-buffer rendering of a triangle mesh."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

DepthImage = NDArray[np.float32]

#: Placeholder for no image from behind.
NOT_BEHIND: DepthImage = np.empty((0, 0), dtype=np.float32)


def depth_buffer(points: ArrayLike, faces: ArrayLike, size: int, background: float) -> DepthImage:
    """Render the depth of the nearest surface at every pixel centre.

    Triangles are two-sided, depth is interpolated linearly, and there is no anti-aliasing.
    Triangles that share an edge leave no crack: the intersection of an edge with a pixel row is
    computed from the edge alone.

    Parameters
    ----------
    points
        Projected vertices, shape (n, 3): x to the right (columns) and y downwards (rows), both in
        pixels; z is the depth in any unit, smaller is nearer. The centre of pixel (row r, column c)
        lies at x = c + 0.5, y = r + 0.5.
    faces
        Vertex indices, shape (m, 3), 0-based.
    size
        Height and width of the image in pixels.
    background
        Value of pixels without a triangle.

    Returns
    -------
    numpy.ndarray
        Shape (size, size), float32. Parts outside the image are clipped.

    References
    ----------
    Catmull, "A subdivision algorithm for computer display of curved surfaces", 1974 (the z-buffer).
    """
    positions = np.ascontiguousarray(points, dtype=np.float64)
    triangles = np.ascontiguousarray(faces, dtype=np.int32)
    image = np.full((size, size), np.inf, dtype=np.float32)
    draw_triangles(positions, triangles, image, NOT_BEHIND)
    image[np.isinf(image)] = background
    return image


@njit(cache=True, nogil=True, error_model="numpy")
def draw_triangles(
    points: NDArray[np.float64], faces: NDArray[np.int32], image: DepthImage, behind: DepthImage
) -> None:
    """Draw the depths of triangles into an image, in which the nearest one counts.

    A triangle covers the pixels whose centres it contains. It is drawn row by row, as spans between
    two of its edges. The view from behind is drawn in the same pass, because a triangle covers the
    same pixels from both sides.

    Parameters
    ----------
    points
        Projected vertices, shape (n, 3), float64: x to the right and y downwards in pixels, and the
        depth; vertices may lie outside the image.
    faces
        Vertex indices, shape (m, 3), int32; they are not checked.
    image
        Shape (height, width), float32, changed in place; initialise it with a depth behind
        everything.
    behind
        Like ``image``, for the opposite camera with the same up direction; depths run from 0 to 1,
        measured from that camera. :data:`NOT_BEHIND` for none.
    """
    height, width = image.shape
    for f in range(faces.shape[0]):
        # Corners by y, the upper one first: an edge is always traversed from its upper end, so that
        # both triangles at it compute the same x.
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        if points[j, 1] < points[i, 1]:
            i, j = j, i
        if points[k, 1] < points[j, 1]:
            j, k = k, j
            if points[j, 1] < points[i, 1]:
                i, j = j, i
        x0, y0, z0 = points[i, 0], points[i, 1], points[i, 2]
        x1, y1, z1 = points[j, 0], points[j, 1], points[j, 2]
        x2, y2, z2 = points[k, 0], points[k, 1], points[k, 2]
        # Rows whose centres lie in the triangle and in the image.
        first = max(0, int(np.ceil(y0 - 0.5)))
        last = min(height - 1, int(np.floor(y2 - 0.5)))
        if first > last or y0 == y2:
            continue
        for row in range(first, last + 1):
            y = row + 0.5
            # One end of the span lies on the long edge, from the upper to the lower corner, and the
            # other one on a short edge.
            t = (y - y0) / (y2 - y0)
            long_x = x0 + t * (x2 - x0)
            long_depth = z0 + t * (z2 - z0)
            # At the height of the middle corner, both short edges are used: a neighbour may share
            # either of them.
            if y <= y1 and y0 != y1:
                t = (y - y0) / (y1 - y0)
                short_x = x0 + t * (x1 - x0)
                short_depth = z0 + t * (z1 - z0)
                _draw_span(image, behind, row, width, long_x, long_depth, short_x, short_depth)
            if y >= y1 and y1 != y2:
                t = (y - y1) / (y2 - y1)
                short_x = x1 + t * (x2 - x1)
                short_depth = z1 + t * (z2 - z1)
                _draw_span(image, behind, row, width, long_x, long_depth, short_x, short_depth)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _draw_span(
    image: DepthImage,
    behind: DepthImage,
    row: int,
    width: int,
    x0: float,
    z0: float,
    x1: float,
    z1: float,
) -> None:
    """Draw the span of a triangle in one row of an image, in which the least depth counts.

    Parameters
    ----------
    image
        Depths of the nearest triangles so far, shape (height, width); changed in place.
    behind
        The same for the opposite camera, whose columns run the other way; without rows for none.
    row
        Number of the row.
    width
        Number of columns of the image.
    x0, z0
        Column in pixels, and depth, at one end of the span.
    x1, z1
        The same at its other end; depths are linear in between.
    """
    if x1 < x0:
        x0, x1 = x1, x0
        z0, z1 = z1, z0
    first = max(0, int(np.ceil(x0 - 0.5)))
    last = min(width - 1, int(np.floor(x1 - 0.5)))
    slope = (z1 - z0) / (x1 - x0) if x1 > x0 else 0.0
    for column in range(first, last + 1):
        depth = z0 + (column + 0.5 - x0) * slope
        image[row, column] = min(np.float32(depth), image[row, column])
        if behind.shape[0]:
            opposite = width - 1 - column
            behind[row, opposite] = min(np.float32(1.0 - depth), behind[row, opposite])
