"""Gaussian and difference-of-Gaussian scale space of SIFT, and its extrema (compiled kernels).

Notation of Lowe 2004: three levels per octave; level s of an octave has the scale 1.6 * 2^(s / 3) in pixels of that
octave. An octave holds the Gaussian levels -1 ... 4, hence five differences and three levels with both neighbours.
Products and sums are rounded separately and in a fixed order, so that descriptors are the same bytes on any processor.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]

LEVELS = 3
N_GAUSSIANS = LEVELS + 3
STEP = 2.0 ** (1.0 / LEVELS)
BASE_SCALE = 1.6
NOMINAL_BLUR = 0.5
#: Gaussians are cut off at this many standard deviations.
SUPPORT = 4.0
#: Pixels kept around the foreground in every octave: the widest accumulated blur, 1.6 * 2^(4/3), reaches 16 pixels.
MARGIN = 17
#: Octaves stop when the shorter side of the image falls below 16 pixels.
SMALLEST_SIDE = 16
REFINEMENT_STEPS = 5


@njit(cache=True, nogil=True)
def build_octave(base: SingleArray, gaussians: SingleArray, differences: SingleArray, is_first: bool) -> None:
    """Compute the Gaussian levels of one octave and their differences.

    Parameters
    ----------
    base
        Shape (height, width), float32: the image itself in the first octave, else level -1.
    gaussians, differences
        Shapes (6, height, width) and (5, height, width), float32; overwritten.
    is_first
        Whether ``base`` still has the nominal blur of an image.
    """
    if is_first:
        _blur(base, gaussians[0], np.sqrt(BASE_SCALE**2 - NOMINAL_BLUR**2))
    else:
        for row in range(base.shape[0]):  # an assignment of the whole array takes a second to compile
            for x in range(base.shape[1]):
                gaussians[0, row, x] = base[row, x]
    for level in range(1, N_GAUSSIANS):
        _blur(gaussians[level - 1], gaussians[level], BASE_SCALE * STEP ** (level - 1) * np.sqrt(STEP**2 - 1.0))
        for row in range(base.shape[0]):
            upper, lower, result = gaussians[level, row], gaussians[level - 1, row], differences[level - 1, row]
            for x in range(base.shape[1]):
                result[x] = upper[x] - lower[x]


@njit(cache=True, nogil=True)
def _blur(source: SingleArray, target: SingleArray, sigma: float) -> None:
    """Convolve an image with a separable Gaussian; the border is repeated."""
    half = np.exp(-0.5 * (np.arange(int(np.ceil(SUPPORT * sigma)) + 1) / sigma) ** 2)
    kernel = (half / (2.0 * half.sum() - half[0])).astype(np.float32)
    turned = np.empty((source.shape[1], source.shape[0]), dtype=np.float32)
    _blur_columns(source, kernel, turned)
    _blur_columns(turned, kernel, target)


@njit(cache=True, nogil=True)
def _blur_columns(source: SingleArray, kernel: SingleArray, target: SingleArray) -> None:
    """Convolve along the first axis, and write the transposed result, in the order of the weights of half a kernel."""
    height, width = source.shape
    total = np.empty(width, dtype=np.float32)
    for row in range(height):
        own = source[row]
        for x in range(width):
            total[x] = kernel[0] * own[x]
        for j in range(1, len(kernel)):
            above, below, weight = source[max(row - j, 0)], source[min(row + j, height - 1)], kernel[j]
            for x in range(width):
                total[x] += weight * (above[x] + below[x])
        for x in range(width):
            target[x, row] = total[x]


@njit(cache=True, nogil=True)
def find_extrema(differences: SingleArray, peak_threshold: float, edge_ratio: float, points: FloatArray) -> int:
    """Find the sub-pixel extrema of the differences of one octave.

    Parameters
    ----------
    differences
        Shape (5, height, width), float32.
    peak_threshold
        Minimum absolute value at the refined extremum, in units of the image.
    edge_ratio
        Maximum ratio of the principal curvatures.
    points
        Shape (capacity, 4), float64, overwritten: x, y in pixels of the octave, level 0 ... 2 of the extremum, offset
        of the level.

    Returns
    -------
    int
        Number of extrema; those beyond the capacity are counted but not stored.
    """
    count = 0
    height, width = differences.shape[1:]
    candidate_threshold = np.float32(0.8 * peak_threshold)
    for level in range(1, LEVELS + 1):
        for row in range(1, height - 1):
            here = differences[level, row]
            for column in range(1, width - 1):
                value = here[column]
                # The neighbours in the row reject nearly every pixel.
                high = value > here[column - 1] and value > here[column + 1]
                low = value < here[column - 1] and value < here[column + 1]
                if not (high or low) or abs(value) < candidate_threshold:
                    continue
                if not _is_extremum(differences, level, row, column, value):
                    continue
                good, x, y, offset = _refine(differences, level, row, column, peak_threshold, edge_ratio)
                if not good:
                    continue
                if count < len(points):
                    points[count, 0], points[count, 1], points[count, 2], points[count, 3] = x, y, level - 1, offset
                count += 1
    return count


@njit(cache=True, nogil=True)
def _is_extremum(differences: SingleArray, level: int, row: int, column: int, value: np.float32) -> bool:
    sign = np.float32(1.0) if value > 0 else np.float32(-1.0)
    value = sign * value
    # The row neighbours in the same level reject nearly every pixel.
    for d_level in (0, -1, 1):
        for d_row in (0, -1, 1):
            neighbours = differences[level + d_level, row + d_row]
            for d_column in (-1, 0, 1):
                if d_level == 0 and d_row == 0 and d_column == 0:
                    continue
                if sign * neighbours[column + d_column] >= value:
                    return False
    return True


@njit(cache=True, nogil=True)
def _refine(
    differences: SingleArray, level: int, row: int, column: int, peak_threshold: float, edge_ratio: float
) -> tuple[bool, float, float, float]:
    """Fit a quadratic [Brown & Lowe 2002] and apply the two tests; returns (good, x, y, offset of the level)."""
    height, width = differences.shape[1:]
    hessian = np.empty((3, 3))
    move_x = move_y = 0
    for _ in range(REFINEMENT_STEPS):  # moves precede fits, so that the last fit belongs to the last pixel
        column += move_x
        row += move_y
        a, b, c = differences[level - 1], differences[level], differences[level + 1]
        centre = float(b[row, column])
        gx = 0.5 * (b[row, column + 1] - b[row, column - 1])
        gy = 0.5 * (b[row + 1, column] - b[row - 1, column])
        gs = 0.5 * (c[row, column] - a[row, column])
        hxx = b[row, column + 1] + b[row, column - 1] - 2.0 * centre
        hyy = b[row + 1, column] + b[row - 1, column] - 2.0 * centre
        hss = c[row, column] + a[row, column] - 2.0 * centre
        hxy = 0.25 * (b[row + 1, column + 1] + b[row - 1, column - 1] - b[row + 1, column - 1] - b[row - 1, column + 1])
        hxs = 0.25 * (c[row, column + 1] + a[row, column - 1] - c[row, column - 1] - a[row, column + 1])
        hys = 0.25 * (c[row + 1, column] + a[row - 1, column] - c[row - 1, column] - a[row + 1, column])
        hessian[0, 0], hessian[1, 1], hessian[2, 2] = hxx, hyy, hss
        hessian[0, 1], hessian[0, 2], hessian[1, 2] = hxy, hxs, hys
        solvable, dx, dy, ds = _solve_symmetric(hessian, -gx, -gy, -gs)
        if not solvable:
            return False, 0.0, 0.0, 0.0
        move_x = int(dx > 0.6 and column < width - 2) - int(dx < -0.6 and column > 1)
        move_y = int(dy > 0.6 and row < height - 2) - int(dy < -0.6 and row > 1)
        if move_x == 0 and move_y == 0:
            break
    value = centre + 0.5 * (gx * dx + gy * dy + gs * ds)
    determinant = hxx * hyy - hxy * hxy
    on_edge = determinant <= 0 or (hxx + hyy) ** 2 * edge_ratio >= (edge_ratio + 1.0) ** 2 * determinant
    near = max(abs(dx), abs(dy), abs(ds)) < 1.5
    x, y = column + dx, row + dy
    inside = 0.0 <= x <= width - 1.0 and 0.0 <= y <= height - 1.0 and level + ds >= 0.0
    return near and inside and not on_edge and abs(value) > peak_threshold, x, y, ds


@njit(cache=True, nogil=True)
def _solve_symmetric(matrix: FloatArray, u: float, v: float, w: float) -> tuple[bool, float, float, float]:
    """Solve a symmetric 3 x 3 system given by its upper triangle; returns (solvable, x, y, z)."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * c00 + b * c01 + c * c02
    if determinant == 0.0:
        return False, 0.0, 0.0, 0.0
    c11, c12, c22 = a * f - c * c, b * c - a * e, a * d - b * b
    x = (c00 * u + c01 * v + c02 * w) / determinant
    y = (c01 * u + c11 * v + c12 * w) / determinant
    z = (c02 * u + c12 * v + c22 * w) / determinant
    return True, x, y, z
