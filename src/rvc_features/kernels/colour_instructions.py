"""Vector operations on pixels of three bytes; see vectors.py."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types

from rvc_features.kernels.vectors import Vector, indices, intrinsic

PIXELS = 32       # at once: what `bytes_of_sums` gives fills a register
_AT_ONCE = 8      # of which two bytes of each make a vector of int16
_QUARTER = 16     # bytes of a load: four pixels and the beginning of the fifth
_ZERO = 2 * _QUARTER   # place of a zero, behind the bytes of two loads


def _picking(*bytes_of_pixel: int | None) -> Any:
    """An intrinsic: of each of eight pixels from pixels[at] on two bytes as int16, zero for None.

    It reads four bytes more than the eight pixels have.
    """
    places = []
    for pixel in range(_AT_ONCE):
        quarter, place = divmod(pixel, _AT_ONCE // 2)
        for which in bytes_of_pixel:
            places += [_ZERO if which is None else quarter * _QUARTER + 3 * place + which, _ZERO]

    @intrinsic
    def pick(typing_context, pixels, at):
        def emit(context, builder, signature, arguments):
            byte, integer = ir.IntType(8), arguments[1].type
            data = context.make_array(pixels)(context, builder, arguments[0]).data
            loaded = []
            for offset in (0, 3 * _AT_ONCE // 2):
                place = builder.gep(data, [builder.add(arguments[1], integer(offset))])
                loaded.append(builder.load(builder.bitcast(place, ir.VectorType(byte, _QUARTER).as_pointer()), align=1))
            both = builder.shuffle_vector(*loaded, indices(range(2 * _QUARTER)))
            zeros = ir.Constant(both.type, [0] * 2 * _QUARTER)
            picked = builder.shuffle_vector(both, zeros, indices(places))
            return builder.bitcast(picked, context.get_value_type(signature.return_type))
        return Vector(types.int16, 2 * _AT_ONCE)(pixels, at), emit
    return pick


blues_and_greens, reds = _picking(0, 1), _picking(2, None)


def bytes_of_sums(rounding: int, shift: int) -> Any:
    """An intrinsic: (sum + rounding) >> shift of four vectors of eight int32 each, one after the other, as uint8."""
    @intrinsic
    def narrow(typing_context, a, b, c, d):
        def emit(context, builder, signature, arguments):
            halves = [builder.shuffle_vector(*two, indices(range(2 * _AT_ONCE)))
                      for two in (arguments[:2], arguments[2:])]
            sums = builder.shuffle_vector(*halves, indices(range(PIXELS)))
            rounded = builder.add(sums, ir.Constant(sums.type, [rounding] * PIXELS))
            shifted = builder.lshr(rounded, ir.Constant(sums.type, [shift] * PIXELS))
            # That they are bytes tells LLVM to pack them with the instructions that would cut off what is larger.
            known = builder.and_(shifted, ir.Constant(sums.type, [255] * PIXELS))
            return builder.trunc(known, context.get_value_type(signature.return_type))
        return Vector(types.uint8, PIXELS)(a, b, c, d), emit
    return narrow
