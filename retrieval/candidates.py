"""Search for pixels that may be extrema of a scale space: many pixels at a time, in vectors."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

#: Pixels that are looked at together.
LANES = 16
_VECTOR = ir.VectorType(ir.FloatType(), LANES)


@intrinsic
def mark_candidates(_context, stack, level, row, column, threshold):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Mark each of the pixels from (level, row, column) on that may be an extremum.

    It is at least as far from zero as the threshold and beyond its neighbours in four directions and in both levels.
    That rejects nearly every pixel; most blocks hold none that is far from zero, and nothing else of them is read.

    Parameters
    ----------
    stack
        Shape (levels, height, width), float32, contiguous. The block and all neighbours of it must lie inside.
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
        found = bits(builder.or_(high, low))
        inside = builder.block
    marks = builder.phi(ir.IntType(LANES))
    marks.add_incoming(ir.Constant(ir.IntType(LANES), 0), before)
    marks.add_incoming(found, inside)
    return builder.zext(marks, ir.IntType(64))
