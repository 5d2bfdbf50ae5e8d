"""The Gaussian and difference-of-Gaussian scale space of SIFT, and its extrema (compiled kernels).

Notation of Lowe 2004: three levels per octave; level s of an octave has the scale 1.6 * 2^(s / 3) in pixels of that
octave. An octave holds the Gaussian levels -1 ... 4, hence five differences and three levels with both neighbours.
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
#: Gaussians are cut at four standard deviations.
SUPPORT = 4.0
#: Pixels kept around the foreground in every octave: the widest accumulated blur, 1.6 * 2^(4/3), reaches 16 pixels.
MARGIN = 17
#: Octaves stop when the shorter side of the image falls below 16 pixels.
SMALLEST_SIDE = 16
REFINEMENT_STEPS = 5


@njit(cache=True, nogil=True)
def gaussian_kernel(sigma: float) -> SingleArray:
    """Right half of a sampled Gaussian of unit sum, float32, shape (radius + 1,)."""
    radius = int(np.ceil(SUPPORT * sigma))
    half = np.exp(-0.5 * (np.arange(radius + 1) / sigma) ** 2)
    half /= 2.0 * half.sum() - half[0]
    return half.astype(np.float32)


@njit(cache=True, nogil=True)
def blur(source: SingleArray, target: SingleArray, kernel: SingleArray) -> None:
    """Convolve an image with a separable Gaussian; the border is repeated.

    Products and sums are rounded one by one: fused where the processor can, they would give other bits on another one.

    Parameters
    ----------
    source, target
        Shape (height, width), float32; ``target`` is overwritten.
    kernel
        From :func:`gaussian_kernel`.
    """
    height, width = source.shape
    radius = len(kernel) - 1
    padded = np.empty(width + 2 * radius, dtype=np.float32)  # a weight reaches at most ``radius`` to either side
    for row in range(height):
        column_sum = padded[radius : radius + width]
        middle = source[row]
        for x in range(width):
            column_sum[x] = kernel[0] * middle[x]
        last = height - 1
        in_threes, in_fours = radius - radius % 3, radius - radius % 4
        # Several weights at a time, so that a sum is loaded and stored less often; the order of its terms is the same.
        for j in range(1, in_threes, 3):
            p, q, r = kernel[j], kernel[j + 1], kernel[j + 2]
            a, b = source[max(row - j, 0)], source[min(row + j, last)]
            c, d = source[max(row - j - 1, 0)], source[min(row + j + 1, last)]
            e, f = source[max(row - j - 2, 0)], source[min(row + j + 2, last)]
            for x in range(width):
                column_sum[x] = column_sum[x] + p * (a[x] + b[x]) + q * (c[x] + d[x]) + r * (e[x] + f[x])
        for j in range(in_threes + 1, radius + 1):
            weight, above, below = kernel[j], source[max(row - j, 0)], source[min(row + j, last)]
            for x in range(width):
                column_sum[x] += weight * (above[x] + below[x])
        padded[:radius] = column_sum[0]
        padded[radius + width :] = column_sum[width - 1]
        result = target[row]
        for x in range(width):
            result[x] = kernel[0] * column_sum[x]
        for j in range(1, in_fours, 4):
            p, q, r, s = kernel[j], kernel[j + 1], kernel[j + 2], kernel[j + 3]
            left = padded[radius - j - 3 : radius - j + width]
            right = padded[radius + j : radius + j + width + 3]
            for x in range(width):
                inner = result[x] + p * (left[x + 3] + right[x]) + q * (left[x + 2] + right[x + 1])
                result[x] = inner + r * (left[x + 1] + right[x + 2]) + s * (left[x] + right[x + 3])
        for j in range(in_fours + 1, radius + 1):
            weight, left = kernel[j], padded[radius - j : radius - j + width]
            right = padded[radius + j : radius + j + width]
            for x in range(width):
                result[x] += weight * (left[x] + right[x])


@njit(cache=True, nogil=True)
def build_octave(base: SingleArray, gaussians: SingleArray, differences: SingleArray, is_first: bool) -> None:
    """Fill the Gaussian levels and their differences of one octave.

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
        blur(base, gaussians[0], gaussian_kernel(np.sqrt(BASE_SCALE**2 - NOMINAL_BLUR**2)))
    else:
        for row in range(base.shape[0]):  # assigned as a whole, it takes a second to compile
            for x in range(base.shape[1]):
                gaussians[0, row, x] = base[row, x]
    for level in range(1, N_GAUSSIANS):
        sigma = BASE_SCALE * STEP ** (level - 1) * np.sqrt(STEP**2 - 1.0)
        blur(gaussians[level - 1], gaussians[level], gaussian_kernel(sigma))
    for level in range(N_GAUSSIANS - 1):
        for row in range(base.shape[0]):
            upper, lower, result = gaussians[level + 1, row], gaussians[level, row], differences[level, row]
            for x in range(base.shape[1]):
                result[x] = upper[x] - lower[x]


@njit(cache=True, nogil=True)
def find_extrema(differences: SingleArray, peak_threshold: float, edge_ratio: float, found: FloatArray) -> int:
    """Sub-pixel extrema of the differences of one octave.

    Parameters
    ----------
    differences
        Shape (5, height, width), float32.
    peak_threshold
        Smallest absolute value at the refined extremum, in units of the image.
    edge_ratio
        Largest ratio of the principal curvatures.
    found
        Shape (capacity, 4), float64, overwritten: x, y in pixels of the octave, level 0 ... 2 where the extremum lies,
        offset of the level.

    Returns
    -------
    int
        Number of extrema; those beyond the capacity are counted but not stored.
    """
    count = 0
    height, width = differences.shape[1:]
    candidate_threshold = np.float32(0.8 * peak_threshold)
    candidates = np.empty(max(width - 2, 0), dtype=np.uint8)
    for level in range(1, LEVELS + 1):
        finer, same, coarser = differences[level - 1], differences[level], differences[level + 1]
        for row in range(1, height - 1):
            above, below = same[row - 1], same[row + 1]
            _mark_candidates(same[row], above, below, finer[row], coarser[row], candidate_threshold, candidates)
            for column in range(1, width - 1):
                if not candidates[column - 1] or not _is_extremum(differences, level, row, column, same[row, column]):
                    continue
                good, x, y, offset = _refine(differences, level, row, column, peak_threshold, edge_ratio)
                if not good:
                    continue
                if count < len(found):
                    found[count, 0], found[count, 1], found[count, 2], found[count, 3] = x, y, level - 1, offset
                count += 1
    return count


@njit(cache=True, nogil=True)
def _mark_candidates(
    middle: SingleArray,
    above: SingleArray,
    below: SingleArray,
    finer: SingleArray,
    coarser: SingleArray,
    threshold: np.float32,
    candidates: NDArray[np.uint8],
) -> None:
    """Whether each pixel of a row but the ends is far enough from zero and beyond its six nearest neighbours.

    That rejects nearly every pixel without a branch, so that many are looked at together.
    """
    inner = len(candidates)
    left, value, right = middle[:inner], middle[1 : inner + 1], middle[2 : inner + 2]
    above, below = above[1 : inner + 1], below[1 : inner + 1]
    finer, coarser = finer[1 : inner + 1], coarser[1 : inner + 1]
    for x in range(inner):
        highest = max(max(left[x], right[x]), max(max(above[x], below[x]), max(finer[x], coarser[x])))
        lowest = min(min(left[x], right[x]), min(min(above[x], below[x]), min(finer[x], coarser[x])))
        peak = (value[x] > highest) & (value[x] >= threshold)
        candidates[x] = peak | ((value[x] < lowest) & (value[x] <= -threshold))


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
    for _ in range(REFINEMENT_STEPS):
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
        column += move_x
        row += move_y
    value = centre + 0.5 * (gx * dx + gy * dy + gs * ds)
    determinant = hxx * hyy - hxy * hxy
    on_edge = determinant <= 0 or (hxx + hyy) ** 2 * edge_ratio >= (edge_ratio + 1.0) ** 2 * determinant
    near = max(abs(dx), abs(dy), abs(ds)) < 1.5
    x, y = column + dx, row + dy
    inside = 0.0 <= x <= width - 1.0 and 0.0 <= y <= height - 1.0
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
