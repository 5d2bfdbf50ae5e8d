"""Gaussian and difference-of-Gaussian scale space of SIFT, and its extrema (compiled kernels).

Notation of Lowe 2004: three levels per octave; level s of an octave has the scale 1.6 * 2^(s / 3)
in pixels of that octave. An octave holds the Gaussian levels -1 ... 4, hence five differences and
three levels with both neighbours. Products and sums are rounded separately and in a fixed order, so
that descriptors are the same bytes on any processor.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.geometry.mesh import FloatArray

#: Pixels, and what is computed of them, in single precision.
SingleArray = NDArray[np.float32]

#: Levels per octave.
LEVELS = 3
#: Gaussian levels of an octave.
N_GAUSSIANS = LEVELS + 3
#: Ratio of the scales of neighbouring levels.
STEP = 2.0 ** (1.0 / LEVELS)
#: Scale of the first Gaussian level of an octave, in its pixels.
BASE_SCALE = 1.6
#: Blur of an image before the first octave, in pixels.
NOMINAL_BLUR = 0.5
#: Gaussians are cut off at this many standard deviations.
SUPPORT = 4.0
#: Pixels kept around the foreground in every octave: the widest accumulated blur, 1.6 * 2^(4/3),
#: reaches 16 pixels.
MARGIN = 17
#: Pixels, in whole rows, that are blurred in both directions at once: what they need stays in the
#: nearest cache.
_BLOCK = 2048
#: Octaves stop when the shorter side of the image falls below 16 pixels.
SMALLEST_SIDE = 16
#: Share of the threshold of a peak that its pixel must have: between pixels, it may be higher.
CANDIDATE_SHARE = 0.8
#: Most moves of an extremum to the next pixel.
REFINEMENT_STEPS = 5
#: Offset from a pixel, along either axis, from which an extremum moves to the next one.
NEXT_PIXEL = 0.6
#: Largest offset of an extremum from its pixel and level, in pixels and levels.
LARGEST_OFFSET = 1.5


def _half_kernels() -> SingleArray:
    """Return half of each Gaussian, shape (6, MARGIN).

    The first blurs to the base scale, the others from level to level.
    """
    kernels = np.zeros((N_GAUSSIANS, MARGIN))
    for level, kernel in enumerate(kernels):
        if level == 0:
            sigma = np.sqrt(BASE_SCALE**2 - NOMINAL_BLUR**2)
        else:
            sigma = BASE_SCALE * STEP ** (level - 1) * np.sqrt(STEP**2 - 1.0)
        half = np.exp(-0.5 * (np.arange(int(np.ceil(SUPPORT * sigma)) + 1) / sigma) ** 2)
        kernel[: len(half)] = half / (2.0 * half.sum() - half[0])
    return kernels.astype(np.float32)


#: Half of each Gaussian, and how many weights of it are not zero.
KERNELS = _half_kernels()
SIZES = (KERNELS > 0).sum(axis=1)


@njit(cache=True, nogil=True)
def octave_buffers(height: int, width: int) -> tuple[SingleArray, SingleArray]:
    """Return memory for the images of an octave of at most this size, and for one half blurred."""
    stride = width + 2 * MARGIN
    room = np.empty((2 * N_GAUSSIANS, (height + 3 * MARGIN) * stride), dtype=np.float32)
    return room, np.zeros(height * stride + 2 * MARGIN, dtype=np.float32)


@njit(cache=True, nogil=True)
def octave_in(room: SingleArray, height: int, width: int) -> tuple[SingleArray, SingleArray]:
    """Return the images of one octave in a buffer, with and without their borders.

    Returns
    -------
    numpy.ndarray
        Shape (12, height + 2 MARGIN, width + 2 MARGIN): six Gaussian levels, their five
        differences, and the image.
    numpy.ndarray
        Of the same shape, a view of the same memory whose first rows and columns are the pixels.
    """
    shape = len(room), height + 2 * MARGIN, width + 2 * MARGIN
    size = shape[0] * shape[1] * shape[2]
    first = MARGIN * (shape[2] + 1)
    return room.ravel()[:size].reshape(shape), room.ravel()[first : first + size].reshape(shape)


@njit(cache=True, nogil=True)
def build_octave(octave: SingleArray, half: SingleArray, is_first: bool) -> None:
    """Compute the Gaussian levels of one octave and their differences.

    Parameters
    ----------
    octave
        Images of :func:`octave_in` with their borders, overwritten; given are the image in the
        first octave, level -1 in the others.
    half
        From :func:`octave_buffers`.
    is_first
        Whether this is the first octave.
    """
    first = 0 if is_first else 1
    for level in range(first, N_GAUSSIANS):
        # Of level 0, there is no difference: it is overwritten by that of level 1.
        difference = octave[N_GAUSSIANS - 1 + max(level, 1)]
        _blur(octave[level - 1], octave[level], difference, half, level)


@njit(cache=True, nogil=True)
def _blur(
    image: SingleArray, blurred: SingleArray, difference: SingleArray, half: SingleArray, level: int
) -> None:
    """Blur an image with a Gaussian, and compute the difference of both.

    Beyond the image, its outermost pixels are repeated. The work is done in blocks of whole rows,
    which stay in the cache of the processor.

    Parameters
    ----------
    image
        The image with a border of ``MARGIN`` pixels on each side, shape (height, width),
        contiguous. The upper and the lower border are filled in place, the others are not read.
    blurred
        Overwritten with the blurred image, of the same shape, contiguous; its border is undefined.
    difference
        Overwritten with the blurred image less the image, like ``blurred``.
    half
        Memory for a block that is blurred along columns alone, from :func:`octave_buffers`.
    level
        Number of the Gaussian in :data:`KERNELS`.
    """
    height, stride = image.shape
    # Flat views of the same memory: neighbours in a column are a row apart.
    source = image.ravel()
    target = blurred.ravel()
    result = difference.ravel()
    for row in range(MARGIN):
        image[row] = image[MARGIN]
        image[height - 1 - row] = image[height - MARGIN - 1]
    n_rows = max(_BLOCK // stride, 1)
    for top in range(MARGIN, height - MARGIN, n_rows):
        first = top * stride
        count = min(n_rows, height - MARGIN - top) * stride
        # First along columns, into the half-blurred block; then along rows, into the result.
        _convolve(source, first, half, MARGIN, count, stride, level)
        _repeat_ends(half, count, stride)
        _convolve(half, MARGIN, target, first, count, 1, level)
        before = source[first:]
        after = target[first:]
        out = result[first:]
        for x in range(count):
            out[x] = after[x] - before[x]


@njit(cache=True, nogil=True)
def _repeat_ends(rows: SingleArray, count: int, stride: int) -> None:
    """Fill the borders at both ends of each row of a block with the outermost pixel there.

    Parameters
    ----------
    rows
        Flat array, of which the block begins at index ``MARGIN``; changed in place.
    count
        Number of pixels of the block.
    stride
        Length of a row.
    """
    for begin in range(MARGIN, MARGIN + count, stride):
        end = begin + stride
        rows[begin : begin + MARGIN] = rows[begin + MARGIN]
        rows[end - MARGIN : end] = rows[end - MARGIN - 1]


@njit(cache=True, nogil=True)
def _convolve(
    source: SingleArray,
    start: int,
    target: SingleArray,
    begin: int,
    count: int,
    step: int,
    level: int,
) -> None:
    """Convolve pixels along rows or columns with a symmetric kernel.

    Products are always added from the centre outwards, so that results are equal on all processors.

    Parameters
    ----------
    source
        Flat array of pixels.
    start
        Index in ``source`` of the first pixel to convolve.
    target
        Flat array for the results.
    begin
        Index in ``target`` of the first result.
    count
        Number of pixels to convolve.
    step
        Distance of neighbours in ``source``: 1 along rows, the length of a row along columns.
    level
        Number of the kernel in :data:`KERNELS`, which holds its centre and one half.
    """
    kernel = KERNELS[level]
    centre = source[start : start + count]
    total = target[begin : begin + count]
    for x in range(count):
        total[x] = kernel[0] * centre[x]
    # Two weights in one pass; those beyond the kernel are zero.
    for j in range(1, SIZES[level], 2):
        weight = kernel[j]
        next_weight = kernel[j + 1]
        before = source[start - j * step :]
        after = source[start + j * step :]
        next_before = source[start - (j + 1) * step :]
        next_after = source[start + (j + 1) * step :]
        for x in range(count):
            partial = total[x] + weight * (before[x] + after[x])
            total[x] = partial + next_weight * (next_before[x] + next_after[x])


@njit(cache=True, nogil=True)
def find_extrema(
    differences: SingleArray, peak_threshold: float, edge_ratio: float, points: FloatArray
) -> int:
    """Find the keypoints of SIFT in one octave: extrema of the differences of Gaussians.

    A keypoint is a pixel above or below all its neighbours in space and scale, not on an edge; its
    position is refined by a fit.

    Parameters
    ----------
    differences
        Differences of Gaussians, shape (levels + 2, height + 2 MARGIN, width + 2 MARGIN); the
        pixels are the first rows and columns, see :func:`octave_in`.
    peak_threshold
        Minimum absolute value at the refined extremum, in units of the image.
    edge_ratio
        Maximum ratio of the principal curvatures.
    points
        Overwritten, shape (capacity, 4), float64: x and y in pixels of the octave, level of the
        extremum (0, 1 or 2), and offset of the refined level from it.

    Returns
    -------
    int
        Number of extrema; those beyond the capacity are counted but not stored.
    """
    count = 0
    height = differences.shape[1] - 2 * MARGIN
    width = differences.shape[2] - 2 * MARGIN
    candidate_threshold = np.float32(CANDIDATE_SHARE * peak_threshold)
    # A byte for each pixel of a row, 1 for a candidate. Candidates are rare: the bytes are tested
    # eight at a time, as one integer.
    marks = np.zeros((width + 7) // 8 * 8, dtype=np.uint8)
    eights = marks.view(np.uint64)
    for level in range(1, LEVELS + 1):
        for row in range(1, height - 1):
            _mark_candidates(differences, level, row, marks[1 : width - 1])
            for eight in range(len(eights)):
                if eights[eight] == 0:
                    continue
                # The tests of a candidate come from the cheapest to the most expensive.
                for column in range(8 * eight, 8 * eight + 8):
                    value = differences[level, row, column]
                    if not marks[column] or abs(value) < candidate_threshold:
                        continue
                    if not _is_extremum(differences, level, row, column, value):
                        continue
                    good, x, y, offset = _refine(
                        differences, level, row, column, peak_threshold, edge_ratio
                    )
                    if good and count < len(points):
                        points[count, 0] = x
                        points[count, 1] = y
                        points[count, 2] = level - 1
                        points[count, 3] = offset
                    count += good
    return count


@njit(cache=True, nogil=True)
def _mark_candidates(
    differences: SingleArray, level: int, row: int, marks: NDArray[np.uint8]
) -> None:
    """Mark the pixels of a row that are above or below all of their six nearest neighbours.

    Four of the neighbours lie in the same difference of Gaussians, one in the finer and one in the
    coarser one.

    Parameters
    ----------
    differences
        Differences of Gaussians, shape (levels, height, width).
    level, row
        The row, neither the first nor the last one.
    marks
        Overwritten: 1 for each marked pixel, without the first and the last of the row, shape
        (width - 2,).
    """
    width = len(marks)
    here = differences[level, row]
    above = differences[level, row - 1, 1:]
    below = differences[level, row + 1, 1:]
    left = here[:width]
    middle = here[1:]
    right = here[2:]
    lower = differences[level - 1, row, 1:]
    upper = differences[level + 1, row, 1:]
    for x in range(width):
        value = middle[x]
        a = left[x]
        b = right[x]
        c = above[x]
        d = below[x]
        e = lower[x]
        f = upper[x]
        high = (value > a) & (value > b) & (value > c) & (value > d) & (value > e) & (value > f)
        low = (value < a) & (value < b) & (value < c) & (value < d) & (value < e) & (value < f)
        marks[x] = high | low


@njit(cache=True, nogil=True)
def _is_extremum(
    differences: SingleArray, level: int, row: int, column: int, value: np.float32
) -> bool:
    """Return whether a pixel is above or below all its 26 neighbours in space and scale.

    Parameters
    ----------
    differences
        Differences of Gaussians, shape (levels, height, width).
    level, row, column
        The pixel, on no border.
    value
        Value of the pixel; if positive, it must be above the others, if negative, below them.
    """
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
    differences: SingleArray,
    level: int,
    row: int,
    column: int,
    peak_threshold: float,
    edge_ratio: float,
) -> tuple[bool, float, float, float]:
    """Locate an extremum between pixels by a quadratic fit, and test it [Brown & Lowe 2002].

    Parameters
    ----------
    differences
        Differences of Gaussians, as for :func:`find_extrema`.
    level, row, column
        The pixel of the extremum, on no border; the fit may move to a neighbour.
    peak_threshold, edge_ratio
        As for :func:`find_extrema`.

    Returns
    -------
    is_good : bool
        Whether the extremum lies near its pixel and within the image, is high, and is on no edge.
    x, y : float
        Its place, in pixels.
    offset : float
        Its level, less the level of the pixel.
    """
    height = differences.shape[1] - 2 * MARGIN
    width = differences.shape[2] - 2 * MARGIN
    move_x = 0
    move_y = 0
    # Moves precede fits, so that the last fit belongs to the last pixel.
    for _ in range(REFINEMENT_STEPS):
        column += move_x
        row += move_y
        a = differences[level - 1]
        b = differences[level]
        c = differences[level + 1]
        centre = float(b[row, column])
        gx = 0.5 * (b[row, column + 1] - b[row, column - 1])
        gy = 0.5 * (b[row + 1, column] - b[row - 1, column])
        gs = 0.5 * (c[row, column] - a[row, column])
        hxx = b[row, column + 1] + b[row, column - 1] - 2.0 * centre
        hyy = b[row + 1, column] + b[row - 1, column] - 2.0 * centre
        hss = c[row, column] + a[row, column] - 2.0 * centre
        hxy = 0.25 * (
            b[row + 1, column + 1]
            + b[row - 1, column - 1]
            - b[row + 1, column - 1]
            - b[row - 1, column + 1]
        )
        hxs = 0.25 * (
            c[row, column + 1] + a[row, column - 1] - c[row, column - 1] - a[row, column + 1]
        )
        hys = 0.25 * (
            c[row + 1, column] + a[row - 1, column] - c[row - 1, column] - a[row + 1, column]
        )
        solvable, dx, dy, ds = _solve_symmetric((hxx, hxy, hxs, hyy, hys, hss), -gx, -gy, -gs)
        if not solvable:
            return False, 0.0, 0.0, 0.0
        move_x = int(dx > NEXT_PIXEL and column < width - 2) - int(dx < -NEXT_PIXEL and column > 1)
        move_y = int(dy > NEXT_PIXEL and row < height - 2) - int(dy < -NEXT_PIXEL and row > 1)
        if move_x == 0 and move_y == 0:
            break
    value = centre + 0.5 * (gx * dx + gy * dy + gs * ds)
    determinant = hxx * hyy - hxy * hxy
    on_edge = (
        determinant <= 0 or (hxx + hyy) ** 2 * edge_ratio >= (edge_ratio + 1.0) ** 2 * determinant
    )
    near = max(abs(dx), abs(dy), abs(ds)) < LARGEST_OFFSET
    x = column + dx
    y = row + dy
    inside = 0.0 <= x <= width - 1.0 and 0.0 <= y <= height - 1.0 and level + ds >= 0.0
    return near and inside and not on_edge and abs(value) > peak_threshold, x, y, ds


@njit(cache=True, nogil=True)
def _solve_symmetric(
    matrix: tuple[float, float, float, float, float, float], u: float, v: float, w: float
) -> tuple[bool, float, float, float]:
    """Solve a symmetric system of three linear equations by the adjugate of its matrix.

    Parameters
    ----------
    matrix
        Upper triangle, row by row: entries 00, 01, 02, 11, 12 and 22.
    u, v, w
        Right side.

    Returns
    -------
    is_solvable : bool
        Whether the matrix is regular.
    x, y, z : float
        The solution; 0 if there is none.
    """
    a, b, c, d, e, f = matrix
    # The inverse is the adjugate, whose entries are called cij here, over the determinant.
    c00 = d * f - e * e
    c01 = c * e - b * f
    c02 = b * e - c * d
    determinant = a * c00 + b * c01 + c * c02
    if determinant == 0.0:
        return False, 0.0, 0.0, 0.0
    c11 = a * f - c * c
    c12 = b * c - a * e
    c22 = a * d - b * b
    x = (c00 * u + c01 * v + c02 * w) / determinant
    y = (c01 * u + c11 * v + c12 * w) / determinant
    z = (c02 * u + c12 * v + c22 * w) / determinant
    return True, x, y, z
