"""Gaussian and difference-of-Gaussian scale space of SIFT, and its extrema (compiled kernels).

Notation of Lowe 2004: three levels per octave; level s of an octave has the scale 1.6 * 2^(s / 3) in pixels of that
octave. An octave holds the Gaussian levels -1 ... 4, hence five differences and three levels with both neighbours.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from retrieval.gaussian_blur import HAS_VECTORS, blur, gaussian_kernel

#: Number of pixels tested together.
LANES = 16
_VECTOR = ir.VectorType(ir.FloatType(), LANES)


@intrinsic
def mark_candidates(_context, stack, level, row, column, threshold):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Mark the pixels from (level, row, column) on that may be extrema.

    A marked pixel is at least as far from zero as the threshold and beyond its neighbours in four directions and in
    both levels. This rejects nearly every pixel; most blocks have none far from zero, and their neighbours are not
    read.

    Parameters
    ----------
    stack
        Shape (levels, height, width), float32, contiguous. The block and all its neighbours must lie inside.
    level, row, column
        The first pixel.
    threshold
        Float32, not negative.

    Returns
    -------
    int
        Bit k belongs to pixel k of the block.
    """
    return types.int64(stack, types.intp, types.intp, types.intp, types.float32), _build_marks


def _build_marks(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
    stack = context.make_array(signature.args[0])(context, builder, args[0])
    _, height, width = (builder.extract_value(stack.shape, axis) for axis in range(3))
    area = builder.mul(height, width)
    rows = builder.add(builder.mul(args[1], area), builder.mul(args[2], width))
    first = builder.add(rows, args[3])
    one = ir.Constant(width.type, 1)

    def load(step: Any) -> Any:
        place = builder.gep(stack.data, [builder.add(first, step)])
        return builder.load(builder.bitcast(place, _VECTOR.as_pointer()), align=4)

    def splat(value: Any) -> Any:
        nothing = ir.Constant(_VECTOR, ir.Undefined)
        single = builder.insert_element(nothing, value, ir.Constant(ir.IntType(32), 0))
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(single, nothing, lanes)

    def bits(mask: Any) -> Any:
        return builder.bitcast(mask, ir.IntType(LANES))

    pixels = load(ir.Constant(width.type, 0))
    high = builder.fcmp_ordered(">=", pixels, splat(args[4]))
    low = builder.fcmp_ordered("<=", pixels, splat(builder.fneg(args[4])))
    far = builder.icmp_unsigned("!=", bits(builder.or_(high, low)), ir.Constant(ir.IntType(LANES), 0))
    before = builder.block
    with builder.if_then(far, likely=False):
        for step in (one, width, area):
            for neighbours in (load(step), load(builder.neg(step))):
                high = builder.and_(high, builder.fcmp_ordered(">", pixels, neighbours))
                low = builder.and_(low, builder.fcmp_ordered("<", pixels, neighbours))
        extrema = bits(builder.or_(high, low))
        inside = builder.block
    marks = builder.phi(ir.IntType(LANES))
    marks.add_incoming(ir.Constant(ir.IntType(LANES), 0), before)
    marks.add_incoming(extrema, inside)
    return builder.zext(marks, ir.IntType(64))


FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]

LEVELS = 3
N_GAUSSIANS = LEVELS + 3
STEP = 2.0 ** (1.0 / LEVELS)
BASE_SCALE = 1.6
NOMINAL_BLUR = 0.5
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
        blur(base, gaussians[0], gaussian_kernel(np.sqrt(BASE_SCALE**2 - NOMINAL_BLUR**2)))
    else:
        for row in range(base.shape[0]):  # an assignment of the whole array takes a second to compile
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
            for block in range(1, width - 1, LANES):
                # The pixels and their neighbours lie inside the array; those of the previous block are shifted out.
                begin = min(block, width - 1 - LANES)
                if HAS_VECTORS and begin > 0:
                    marks = mark_candidates(differences, level, row, begin, candidate_threshold) >> (block - begin)
                else:
                    marks = (1 << min(LANES, width - 1 - block)) - 1
                column = block - 1
                while marks:
                    column += 1
                    marked = marks & 1
                    marks >>= 1
                    value = differences[level, row, column]
                    if not marked or not abs(value) >= candidate_threshold:
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
