"""Rows to columns, for Numba: what lies one below the other in memory comes to lie side by side.

Indices count elements from the beginning of a contiguous array. Nothing checks them.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types

from rvc_features.kernels.vectors import indices, intrinsic


def _places(context: Any, builder: Any, array_type: Any, array: Any, start: Any, step: Any, count: int,
            vector_type: Any) -> list[Any]:
    """Pointers to vectors that begin at `start`, `start + step` and so on."""
    data = context.make_array(array_type)(context, builder, array).data
    indices = [builder.add(start, builder.mul(step, ir.Constant(step.type, i))) for i in range(count)]
    return [builder.bitcast(builder.gep(data, [index]), vector_type.as_pointer()) for index in indices]


def _interleaved(builder: Any, rows: list[Any], times: int, blocks: int) -> list[Any]:
    """So many times the first half of all numbers and the second in turn, each block of a vector by itself.

    log2 of the number of rows of times transpose a matrix.
    """
    lanes, half = rows[0].type.count, len(rows) // 2
    size = lanes // blocks
    low, high = (indices(block * size + first + i + other for block in range(blocks) for i in range(size // 2)
                         for other in (0, lanes)) for first in (0, size // 2))
    for _ in range(times):
        rows = [builder.shuffle_vector(rows[i], rows[i + half], lanes) for i in range(half) for lanes in (low, high)]
    return rows


@intrinsic
def transpose_bytes(typing_context, source, start, step, target, to):
    """Eight rows of sixteen bytes, `step` apart, become sixteen rows of eight bytes, one after the other."""
    def emit(context, builder, signature, arguments):
        array, first, apart, out, at = arguments
        kind = ir.VectorType(ir.IntType(8), 16)
        rows = [builder.load(place, align=1)
                for place in _places(context, builder, source, array, first, apart, 8, kind)]
        two_rows = ir.Constant(at.type, 16)
        places = _places(context, builder, target, out, at, two_rows, 8, kind)
        for row, place in zip(_interleaved(builder, rows, 3, 1), places):
            builder.store(row, place, align=1)
        return context.get_dummy_value()
    return types.void(source, start, step, target, to), emit


@intrinsic
def transpose_floats(typing_context, source, start, step, target, to, target_step):
    """Eight rows of four float32, `step` apart, become four rows of eight, `target_step` apart."""
    def emit(context, builder, signature, arguments):
        array, first, apart, out, at, out_apart = arguments
        four, eight = (ir.VectorType(ir.FloatType(), count) for count in (4, 8))
        rows = [builder.load(place, align=4)
                for place in _places(context, builder, source, array, first, apart, 8, four)]
        rows = [builder.shuffle_vector(rows[i], rows[i + 4], indices(range(8))) for i in range(4)]
        for row, place in zip(_interleaved(builder, rows, 2, 2),
                              _places(context, builder, target, out, at, out_apart, 4, eight)):
            builder.store(row, place, align=4)
        return context.get_dummy_value()
    return types.void(source, start, step, target, to, target_step), emit
