"""Vector operations that are one or two instructions, but not arithmetic as one would write it; see vectors.py."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types

from rvc_features.kernels.vectors import LANES, Vector, indices, intrinsic

HALF = LANES // 2
_BITS = 16   # of the integers that are widened in place


def _widened_in_place(is_even: bool) -> Any:
    """An intrinsic: every second of sixteen int16, from 0 or from 1 on, times 2^16, as float32; exact.

    In the upper half of 32 bits they need not be moved there, or by one shift, and no number crosses the register.
    """
    @intrinsic
    def widen(typing_context, vector):
        if vector.dtype != types.int16:
            return None

        def emit(context, builder, signature, arguments):
            wide = ir.VectorType(ir.IntType(2 * _BITS), HALF)
            pairs = builder.bitcast(arguments[0], wide)
            if is_even:
                upper = builder.shl(pairs, ir.Constant(wide, [_BITS] * HALF))
            else:
                upper = builder.and_(pairs, ir.Constant(wide, [-1 << _BITS] * HALF))
            return builder.sitofp(upper, context.get_value_type(signature.return_type))
        return Vector(types.float32, HALF)(vector), emit
    return widen


scaled_evens, scaled_odds = _widened_in_place(True), _widened_in_place(False)
SCALE = 2.0 ** _BITS   # of what they give


def _of_bytes(is_even: bool) -> Any:
    """An intrinsic: every second of thirty-two bytes, from 0 or from 1 on, as int16."""
    @intrinsic
    def widen(typing_context, vector):
        if vector.dtype != types.uint8:
            return None

        def emit(context, builder, signature, arguments):
            wide = context.get_value_type(signature.return_type)
            pairs = builder.bitcast(arguments[0], wide)
            if is_even:
                return builder.and_(pairs, ir.Constant(wide, [255] * LANES))
            return builder.lshr(pairs, ir.Constant(wide, [8] * LANES))
        return Vector(types.int16)(vector), emit
    return widen


even_bytes, odd_bytes = _of_bytes(True), _of_bytes(False)


@intrinsic
def element(typing_context, array, index):
    """array[index] of a contiguous array, where Python, and so Numba, would first see whether the index is negative."""
    def emit(context, builder, signature, arguments):
        data = context.make_array(array)(context, builder, arguments[0]).data
        return builder.load(builder.gep(data, [arguments[1]]))
    return array.dtype(array, index), emit


def _write(builder: Any, value: Any, pointer: Any, is_streamed: bool) -> None:
    """Store a vector of float32; streamed: past the caches, to an address that is a multiple of the vector's size."""
    written = builder.store(value, pointer, align=4 * value.type.count if is_streamed else 4)
    if is_streamed:
        written.set_metadata('nontemporal', builder.module.add_metadata([ir.IntType(32)(1)]))


@intrinsic
def stream(typing_context, array, index, vector):
    """`store` past the caches, which are neither filled nor asked for what was there; float32, in aligned places."""
    def emit(context, builder, signature, arguments):
        target, first, value = arguments
        place = builder.gep(context.make_array(array)(context, builder, target).data, [first])
        _write(builder, value, builder.bitcast(place, value.type.as_pointer()), True)
        return context.get_dummy_value()
    return types.void(array, index, vector), emit


@intrinsic
def all_written(typing_context):
    """What was streamed can be read by other threads from here on."""
    def emit(context, builder, signature, arguments):
        builder.fence('seq_cst')
        return context.get_dummy_value()
    return types.void(), emit


def _in_turn(is_streamed: bool) -> Any:
    """An intrinsic: store a[0], b[0], c[0], d[0], a[1] and so on, 32 numbers of four vectors of eight.

    Said so that no number crosses from one half of a register to the other but where halves are put together; of
    shuffles of longer vectors LLVM makes twice as many.
    """
    @intrinsic
    def store_in_turn(typing_context, array, index, a, b, c, d):
        def emit(context, builder, signature, arguments):
            target, first, *rows = arguments
            low, high = indices([0, 8, 1, 9, 4, 12, 5, 13]), indices([2, 10, 3, 11, 6, 14, 7, 15])
            for _ in range(2):
                rows = [builder.shuffle_vector(rows[i], rows[i + 2], lanes) for i in range(2) for lanes in (low, high)]
            data = context.make_array(array)(context, builder, target).data
            halves = indices([0, 1, 2, 3, 8, 9, 10, 11]), indices([4, 5, 6, 7, 12, 13, 14, 15])
            for i, (half, pair) in enumerate((half, pair) for half in halves for pair in (rows[:2], rows[2:])):
                place = builder.gep(data, [builder.add(first, ir.Constant(first.type, i * HALF))])
                eight = builder.shuffle_vector(*pair, half)
                _write(builder, eight, builder.bitcast(place, eight.type.as_pointer()), is_streamed)
            return context.get_dummy_value()
        return types.void(array, index, a, b, c, d), emit
    return store_in_turn


store_in_turn, stream_in_turn = _in_turn(False), _in_turn(True)


def _expecting(is_write: bool) -> Any:
    """An intrinsic: fetch the cache line of array[index], which will be used soon; it may lie beyond the end."""
    @intrinsic
    def expect(typing_context, array, index):
        def emit(context, builder, signature, arguments):
            data = context.make_array(array)(context, builder, arguments[0]).data
            pointer = builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(8).as_pointer())
            integer, name = ir.IntType(32), 'llvm.prefetch'
            function_type = ir.FunctionType(ir.VoidType(), [pointer.type, integer, integer, integer])
            function = builder.module.globals.get(name) or ir.Function(builder.module, function_type, name)
            is_data, nearest = integer(1), integer(3)
            builder.call(function, [pointer, integer(int(is_write)), nearest, is_data])
            return context.get_dummy_value()
        return types.void(array, index), emit
    return expect


expect_to_read, expect_to_write = _expecting(False), _expecting(True)


# ---- Sums of neighbours ----

def _picking(*places: int) -> Any:
    """An intrinsic: of half a vector the numbers in those places; zero where they name the one after the last."""
    @intrinsic
    def pick(typing_context, vector):
        def emit(context, builder, signature, arguments):
            value = arguments[0]
            nothing = ir.Constant(value.type, [value.type.element(0)] * vector.lanes)
            return builder.shuffle_vector(value, nothing, indices(places))
        return vector(vector), emit
    return pick


# Among four, which lie together in 128 bits of 32-bit numbers, places are changed sooner than beyond them.
one_later, two_later = _picking(HALF, 0, 1, 2, HALF, 4, 5, 6), _picking(HALF, HALF, 0, 1, HALF, HALF, 4, 5)
last_of_four = _picking(3, 3, 3, 3, 7, 7, 7, 7)
fours_swapped, second_four = _picking(4, 5, 6, 7, 0, 1, 2, 3), _picking(HALF, HALF, HALF, HALF, 4, 5, 6, 7)


@intrinsic
def with_next(typing_context, vector):
    """Each number of a vector of integers plus the one after it; after the last one comes zero."""
    def emit(context, builder, signature, arguments):
        value = arguments[0]
        nothing = ir.Constant(value.type, [0] * vector.lanes)
        return builder.add(value, builder.shuffle_vector(value, nothing, indices(range(1, vector.lanes + 1))))
    return vector(vector), emit
