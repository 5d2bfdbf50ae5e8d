"""Separable Gaussian blur in single precision with explicit vectors: the loop in which SIFT spends most of its time.

A compiled Python loop over pixels reloads both pixels of each product and processes the end of each row one by one.
Here a block of four rows and eight columns stays in registers while the weights pass over it: the rows above and below
slide from one weight to the next, so that each weight loads two new rows for four sums. A pass transposes its result,
so two passes blur in both directions.

Products and sums are rounded separately, in the order of the weights: fused operations, which only some processors
have, would give other bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import config, njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

SingleArray = NDArray[np.float32]

#: Gaussians are cut off at this many standard deviations.
SUPPORT = 4.0
#: As plain Python, for a debugger or a tracer, kernels have no vectors and use the loops for small images.
HAS_VECTORS = not config.DISABLE_JIT
#: Rows and columns of a block.
ROWS, LANES = 4, 8
_INDEX = ir.IntType(32)
_VECTOR = ir.VectorType(ir.FloatType(), LANES)


@njit(cache=True, nogil=True)
def gaussian_kernel(sigma: float) -> SingleArray:
    """Return the right half of a sampled Gaussian of unit sum, float32, shape (radius + 1,)."""
    radius = int(np.ceil(SUPPORT * sigma))
    half = np.exp(-0.5 * (np.arange(radius + 1) / sigma) ** 2)
    half /= 2.0 * half.sum() - half[0]
    return half.astype(np.float32)


@njit(cache=True, nogil=True)
def blur(source: SingleArray, target: SingleArray, kernel: SingleArray) -> None:
    """Convolve an image with a separable Gaussian; the border is repeated.

    Parameters
    ----------
    source, target
        Shape (height, width), float32, contiguous; ``target`` is overwritten.
    kernel
        From :func:`gaussian_kernel`.
    """
    height, width = source.shape
    # Rows with a power-of-two length would all map to the same few cache sets.
    stride = height + 16 if height % 128 == 0 else height
    turned = np.empty((width, stride), dtype=np.float32)
    _blur_columns(source, height, kernel, turned)
    _blur_columns(turned[:, :height], width, kernel, target)


@njit(cache=True, nogil=True)
def _blur_columns(source: SingleArray, height: int, kernel: SingleArray, target: SingleArray) -> None:
    """Convolve along the first axis; write the transposed result to ``target``, shape (width, at least height)."""
    width, radius = source.shape[1], len(kernel) - 1
    # Blocks at the end overlap the previous ones; values written twice are equal.
    for block in range(0, height, ROWS):
        row = min(block, height - ROWS)
        if not HAS_VECTORS or row < 0 or width < LANES:
            _blur_few(source, height, kernel, target, block)
            continue
        for begin in range(0, width, LANES):
            # Row indices are clamped and blocks lie inside: nothing outside the arrays is read or written.
            _blur_block(source, height, kernel, radius, row, min(begin, width - LANES), target)


@njit(cache=True, nogil=True)
def _blur_few(source: SingleArray, height: int, kernel: SingleArray, target: SingleArray, first: int) -> None:
    """Compute the same sums one by one, for the rows from ``first`` on of an image smaller than a block."""
    for row in range(first, min(first + ROWS, height)):
        total = kernel[0] * source[row]
        for j in range(1, len(kernel)):
            total += kernel[j] * (source[max(row - j, 0)] + source[min(row + j, height - 1)])
        target[: source.shape[1], row] = total


@intrinsic
def _blur_block(  # type: ignore[no-untyped-def]  # noqa: ANN202
    _context,  # noqa: ANN001
    source,  # noqa: ANN001
    height,  # noqa: ANN001
    kernel,  # noqa: ANN001
    radius,  # noqa: ANN001
    row,  # noqa: ANN001
    column,  # noqa: ANN001
    target,  # noqa: ANN001
):
    """Blur the block of ``ROWS`` rows and ``LANES`` columns at (row, column); write its transpose to ``target``."""
    signature = types.void(source, types.intp, kernel, types.intp, types.intp, types.intp, target)
    return signature, _build_block


def _build_block(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
    index = context.get_value_type(types.intp)

    def array(argument: int) -> tuple[Any, Any]:
        """Return the start of an array, and the number of elements between its rows."""
        array_of = context.make_array(signature.args[argument])(context, builder, args[argument])
        size = context.get_constant(types.intp, 4)
        return array_of.data, builder.sdiv(cgutils.unpack_tuple(builder, array_of.strides, 2)[0], size)

    def plus(value: Any, amount: int) -> Any:
        return builder.add(value, ir.Constant(index, amount))

    def at(base: Any, offset: Any, kind: Any) -> Any:
        return builder.bitcast(builder.gep(base, [offset]), kind.as_pointer())

    (source, stride), (target, target_stride) = array(0), array(6)
    weights = context.make_array(signature.args[2])(context, builder, args[2]).data
    last, radius, row, column = plus(args[1], -1), args[3], args[4], args[5]
    zero = ir.Constant(index, 0)

    def load(of_row: Any, *, cut: bool = False) -> Any:
        """Load eight pixels of a row; with ``cut``, of the nearest row that exists."""
        if cut:
            of_row = builder.select(builder.icmp_signed("<", of_row, last), of_row, last)
            of_row = builder.select(builder.icmp_signed(">", of_row, zero), of_row, zero)
        return builder.load(at(source, builder.add(builder.mul(of_row, stride), column), _VECTOR), align=4)

    def weight(place: Any) -> Any:
        nothing = ir.Constant(_VECTOR, ir.Undefined)
        first = builder.insert_element(nothing, builder.load(builder.gep(weights, [place])), ir.Constant(_INDEX, 0))
        return builder.shuffle_vector(first, nothing, _mask([0] * LANES))

    sums, above, below = ([cgutils.alloca_once(builder, _VECTOR) for _ in range(ROWS)] for _ in range(3))
    for k in range(ROWS):
        pixels = load(plus(row, k))
        for pointers, value in ((above, pixels), (below, pixels), (sums, builder.fmul(weight(zero), pixels))):
            builder.store(value, pointers[k])

    def add_neighbours(*, cut: bool) -> None:
        with cgutils.for_range(builder, radius, intp=index) as loop:
            j = plus(loop.index, 1)
            factor = weight(j)
            aboves = [load(builder.sub(row, j), cut=cut), *(builder.load(pointer) for pointer in above[:-1])]
            top = load(builder.add(plus(row, ROWS - 1), j), cut=cut)
            belows = [*(builder.load(pointer) for pointer in below[1:]), top]
            for k in range(ROWS):
                builder.store(aboves[k], above[k])
                builder.store(belows[k], below[k])
                product = builder.fmul(factor, builder.fadd(aboves[k], belows[k]))
                builder.store(builder.fadd(builder.load(sums[k]), product), sums[k])

    reach = builder.add(plus(row, ROWS - 1), radius)
    inside = builder.and_(builder.icmp_signed(">=", row, radius), builder.icmp_signed("<=", reach, last))
    # Row indices are clamped only at the border.
    with builder.if_else(inside) as (then, otherwise):
        with then:
            add_neighbours(cut=False)
        with otherwise:
            add_neighbours(cut=True)
    four = ir.VectorType(ir.FloatType(), ROWS)
    for lane, pixels in enumerate(_transposed(builder, [builder.load(pointer) for pointer in sums])):
        offset = builder.add(builder.mul(plus(column, lane), target_stride), row)
        builder.store(pixels, at(target, offset, four), align=4)
    return context.get_dummy_value()


def _mask(places: list[int]) -> ir.Constant:
    return ir.Constant(ir.VectorType(_INDEX, len(places)), places)


def _transposed(builder: ir.IRBuilder, rows: list[Any]) -> list[Any]:
    """Return the columns of four rows as vectors of four, by interleaving, for which processors have instructions."""

    def mixed(first: Any, second: Any, places: tuple[int, ...]) -> Any:
        """Return the lanes at the given places of each group of four; places 4 to 7 refer to the second vector."""
        return builder.shuffle_vector(
            first,
            second,
            _mask([begin + (p if p < 4 else p - 4 + LANES) for begin in range(0, LANES, 4) for p in places]),
        )

    pairs = [[mixed(rows[k], rows[k + 1], places) for k in (0, 2)] for places in ((0, 4, 1, 5), (2, 6, 3, 7))]
    columns = [mixed(first, second, places) for first, second in pairs for places in ((0, 1, 4, 5), (2, 3, 6, 7))]
    return [
        builder.shuffle_vector(column, column, _mask(list(range(begin, begin + ROWS))))
        for begin in range(0, LANES, 4)
        for column in columns
    ]
