"""Orthographic z-buffer rendering of a triangle mesh."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from benchmark.errors import InvalidMesh

DepthImage = NDArray[np.float32]

#: Minimum length in pixels of a span for branch-free drawing, which does not pay off for shorter ones.
LONG_SPAN = 8
#: Placeholder for no image from behind.
NOT_BEHIND: DepthImage = np.empty((0, 0), dtype=np.float32)


def depth_buffer(points: ArrayLike, faces: ArrayLike, size: int, background: float) -> DepthImage:
    """Render the depth of the nearest surface at every pixel centre.

    Triangles are two-sided, depth is interpolated linearly, and there is no anti-aliasing. Triangles that share an edge
    leave no crack: the intersection of an edge with a pixel row is computed from the edge alone.

    Parameters
    ----------
    points
        Projected vertices, shape (n, 3): x to the right (columns) and y downwards (rows), both in pixels; z is the
        depth in any unit, smaller is nearer. The centre of pixel (row r, column c) lies at x = c + 0.5, y = r + 0.5.
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

    Raises
    ------
    InvalidMesh
        If the arrays have the wrong shape, a coordinate is not finite, or a vertex index is out of range.

    References
    ----------
    Catmull, "A subdivision algorithm for computer display of curved surfaces", 1974 (the z-buffer).
    """
    positions = np.ascontiguousarray(points, dtype=np.float64)
    triangles = np.ascontiguousarray(faces, dtype=np.int32)
    if not np.isfinite(positions).all():
        raise InvalidMesh("a projected point is NaN or infinite", "check the camera and the vertices")
    if triangles.size and (triangles.min() < 0 or triangles.max() >= len(positions)):
        raise InvalidMesh("a face names a vertex that does not exist", "check whether the file counts from 1")
    image = np.full((size, size), np.inf, dtype=np.float32)
    draw_triangles(positions, triangles, image, NOT_BEHIND)
    image[np.isinf(image)] = background
    return image


@njit(cache=True, nogil=True, error_model="numpy")
def draw_triangles(
    points: NDArray[np.float64], faces: NDArray[np.int32], image: DepthImage, behind: DepthImage
) -> None:
    """Lower every pixel of ``image`` to the depth of the nearest triangle over its centre.

    The view from behind is drawn in the same pass, because a triangle covers the same pixels from both sides.

    Parameters
    ----------
    points
        As in :func:`depth_buffer`, float64.
    faces
        As in :func:`depth_buffer`, int32; indices are not checked.
    image
        Shape (height, width), float32, changed in place; initialise it with a depth behind everything.
    behind
        Like ``image``, for the opposite camera with the same up direction; depths run from 0 to 1, measured from that
        camera. :data:`NOT_BEHIND` for none.
    """
    # Rows and columns are clipped to the image before drawing, so vertices may lie arbitrarily far outside.
    height, width = image.shape
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        # Sorted by y: edges are always traversed from the upper end, so both adjacent triangles compute the same x.
        if points[j, 1] < points[i, 1]:
            i, j = j, i
        if points[k, 1] < points[j, 1]:
            j, k = k, j
            if points[j, 1] < points[i, 1]:
                i, j = j, i
        x0, y0, z0 = points[i, 0], points[i, 1], points[i, 2]
        x1, y1, z1 = points[j, 0], points[j, 1], points[j, 2]
        x2, y2, z2 = points[k, 0], points[k, 1], points[k, 2]
        first = max(0, int(np.ceil(y0 - 0.5)))
        last = min(height - 1, int(np.floor(y2 - 0.5)))
        if first > last or y0 == y2:
            continue
        for row in range(first, last + 1):
            y = row + 0.5
            t = (y - y0) / (y2 - y0)
            left, left_depth = x0 + t * (x2 - x0), z0 + t * (z2 - z0)
            # At the height of the middle vertex, use both short edges: a neighbour may share either of them.
            for short in range(2):
                if short == 0:
                    if y > y1 or y0 == y1:
                        continue
                    t = (y - y0) / (y1 - y0)
                    right, right_depth = x0 + t * (x1 - x0), z0 + t * (z1 - z0)
                else:
                    if y < y1 or y1 == y2:
                        continue
                    t = (y - y1) / (y2 - y1)
                    right, right_depth = x1 + t * (x2 - x1), z1 + t * (z2 - z1)
                _draw_span(image, behind, row, width, left, left_depth, right, right_depth)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _draw_span(
    image: DepthImage, behind: DepthImage, row: int, width: int, x0: float, z0: float, x1: float, z1: float
) -> None:
    if x1 < x0:
        x0, x1, z0, z1 = x1, x0, z1, z0
    first = max(0, int(np.ceil(x0 - 0.5)))
    last = min(width - 1, int(np.floor(x1 - 0.5)))
    slope = (z1 - z0) / (x1 - x0) if x1 > x0 else 0.0
    if last - first >= LONG_SPAN:
        _draw_long_span(image[row], first, last, x0, z0, slope)
        if behind.shape[0] > 0:
            _draw_long_span_behind(behind[row], first, last, x0, z0, slope)
    elif behind.shape[0] == 0:
        for column in range(first, last + 1):
            depth = np.float32(z0 + (column + 0.5 - x0) * slope)
            if depth < image[row, column]:
                image[row, column] = depth
    else:
        for column in range(first, last + 1):
            exact = z0 + (column + 0.5 - x0) * slope
            depth, other = np.float32(exact), np.float32(1.0 - exact)
            if depth < image[row, column]:
                image[row, column] = depth
            if other < behind[row, width - 1 - column]:
                behind[row, width - 1 - column] = other


@njit(cache=True, nogil=True, error_model="numpy")
def _draw_long_span(pixels: DepthImage, first: int, last: int, x0: float, z0: float, slope: float) -> None:
    # Branch-free and on contiguous memory, so that the loop is vectorised.
    target = pixels[first : last + 1]
    start = np.int32(first)
    for k in range(target.size):
        depth = np.float32(z0 + (np.float64(start + np.int32(k)) + 0.5 - x0) * slope)
        target[k] = depth if depth < target[k] else target[k]


@njit(cache=True, nogil=True, error_model="numpy")
def _draw_long_span_behind(pixels: DepthImage, first: int, last: int, x0: float, z0: float, slope: float) -> None:
    target = pixels[pixels.size - 1 - last : pixels.size - first]
    start = np.int32(last)
    for k in range(target.size):
        other = np.float32(1.0 - (z0 + (np.float64(start - np.int32(k)) + 0.5 - x0) * slope))
        target[k] = other if other < target[k] else target[k]
