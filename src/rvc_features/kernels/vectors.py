"""A vector of sixteen numbers for Numba: what a processor works on at once, written like one number.

    for i in range(0, len(a), LANES):
        store(out, i, load(a, i) * splat(np.float32(2)) + load(b, i))

Loops over single numbers become vectors only where the compiler finds a proof that they may, and how hard it looks
differs between versions; a loop over these is what it says everywhere. Sixteen numbers are one register or several,
according to the processor and their type: LLVM splits them as needed.

Indices count elements from the beginning of a contiguous array of any number of dimensions. Nothing checks them.
"""

from __future__ import annotations

import operator
from typing import Any, Callable, Iterable

import llvmlite.binding
from llvmlite import ir
from numba import extending, types
from numba.extending import models, overload, register_model

LANES = 16

_HAS_AVX2 = bool(llvmlite.binding.get_host_cpu_features().get('avx2'))

intrinsic: Any = extending.intrinsic   # calls leave out the first argument, which type checkers miss


class Vector(types.Type):
    """Numba's type of a vector; `dtype` is that of its numbers, `lanes` how many there are."""

    def __init__(self, dtype: Any, lanes: int = LANES) -> None:
        super().__init__(f'Vector({dtype} x {lanes})')
        self.dtype = dtype
        self.lanes = lanes


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, ir.VectorType(dmm.lookup(fe_type.dtype).get_data_type(), fe_type.lanes))


# ---- Memory ----

def _pointer(context: Any, builder: Any, array_type: Any, vector_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector_type.as_pointer())


def _loading(lanes: int) -> Any:
    """An intrinsic: array[index : index + lanes] of a contiguous array, as if it had one dimension."""
    @intrinsic
    def load(typing_context, array, index):
        def emit(context, builder, signature, arguments):
            vector_type = context.get_value_type(signature.return_type)
            pointer = _pointer(context, builder, array, vector_type, *arguments)
            return builder.load(pointer, align=array.dtype.bitwidth // 8)
        return Vector(array.dtype, lanes)(array, index), emit
    return load


load, load_half, load_double = _loading(LANES), _loading(LANES // 2), _loading(2 * LANES)


@intrinsic
def store(typing_context, array, index, vector):
    """array[index : index + lanes] = vector, of the same type."""
    if vector.dtype != array.dtype:
        return None

    def emit(context, builder, signature, arguments):
        *place, value = arguments
        pointer = _pointer(context, builder, array, value.type, *place)
        builder.store(value, pointer, align=array.dtype.bitwidth // 8)
        return context.get_dummy_value()
    return types.void(array, index, vector), emit


def indices(numbers: Iterable[int]) -> Any:
    """Which lanes of two vectors, counted through, LLVM is to take."""
    chosen = [ir.IntType(32)(number) for number in numbers]
    return ir.Constant(ir.VectorType(ir.IntType(32), len(chosen)), chosen)


def _splatting(lanes: int) -> Any:
    """An intrinsic: a vector of one number, of that number's type."""
    @intrinsic
    def splat(typing_context, number):
        def emit(context, builder, signature, arguments):
            undefined = ir.Constant(context.get_value_type(signature.return_type), ir.Undefined)
            first = builder.insert_element(undefined, arguments[0], ir.IntType(32)(0))
            return builder.shuffle_vector(first, undefined, indices([0] * lanes))
        return Vector(number, lanes)(number), emit
    return splat


splat, splat_half, splat_double = _splatting(LANES), _splatting(LANES // 2), _splatting(2 * LANES)


# ---- Types ----

def _converted(builder: Any, value: Any, source: Any, target: Any, vector_type: Any) -> Any:
    if source == target:
        return value
    if isinstance(source, types.Float) and isinstance(target, types.Integer):
        return builder.fptosi(value, vector_type)
    if isinstance(source, types.Float):
        return (builder.fpext if target.bitwidth > source.bitwidth else builder.fptrunc)(value, vector_type)
    if isinstance(target, types.Float):
        return (builder.sitofp if source.signed else builder.uitofp)(value, vector_type)
    if source.bitwidth == target.bitwidth:
        return value
    return (builder.sext if source.signed else builder.zext)(value, vector_type)


def _conversion(targets: dict[Any, Any]) -> Any:
    """An intrinsic that converts a vector of any of the types that `targets` lists into that it stands for."""
    @intrinsic
    def convert(typing_context, vector):
        if vector.dtype not in targets:
            return None
        target = targets[vector.dtype]

        def emit(context, builder, signature, arguments):
            vector_type = context.get_value_type(signature.return_type)
            return _converted(builder, arguments[0], vector.dtype, target, vector_type)
        return Vector(target, vector.lanes)(vector), emit
    return convert


_numbers = (types.uint8, types.int16, types.int32, types.float32, types.float64)
to_float32 = _conversion(dict.fromkeys(_numbers, types.float32))
to_float64 = _conversion(dict.fromkeys(_numbers, types.float64))
#: Into the type that holds sums of a few such numbers, or products of two int16, without loss.
widened = _conversion({types.uint8: types.int16, types.int16: types.int32, types.float32: types.float64,
                       types.float64: types.float64})


@intrinsic
def converted(typing_context, vector, like):
    """The vector in the type of the numbers of an array or vector; integers get the whole part of floats."""
    def emit(context, builder, signature, arguments):
        vector_type = context.get_value_type(signature.return_type)
        return _converted(builder, arguments[0], vector.dtype, like.dtype, vector_type)
    return Vector(like.dtype, vector.lanes)(vector, like), emit


# ---- Order ----

def _shuffle(first: int, step: int, halves: int = 1) -> Any:
    """An intrinsic that picks sixteen numbers of two vectors, which count as one of twice the length."""
    @intrinsic
    def shuffle(typing_context, a, b):
        def emit(context, builder, signature, arguments):
            places = [first + half * LANES + i * step for i in range(LANES // halves) for half in range(halves)]
            return builder.shuffle_vector(*arguments, indices(places))
        return a(a, b), emit
    return shuffle


evens, odds = _shuffle(0, 2), _shuffle(1, 2)   # every second number
#: First and second half of what has a number of a and one of b in turn.
interleaved_first, interleaved_second = _shuffle(0, 1, 2), _shuffle(LANES // 2, 1, 2)


@intrinsic
def interleaved(typing_context, even, odd):
    """Of two halves the numbers in turn: even[0], odd[0], even[1] and so on."""
    def emit(context, builder, signature, arguments):
        return builder.shuffle_vector(*arguments, indices(i // 2 + i % 2 * LANES // 2 for i in range(LANES)))
    return Vector(even.dtype)(even, odd), emit


# ---- Arithmetic ----

def _arithmetic(of_floats: str, of_integers: str, *symbols: Callable[[Any, Any], Any]) -> None:
    """Let Numba apply binary operators to two vectors of the same type; a sum of a product may be rounded once."""
    @intrinsic
    def apply(typing_context, a, b):
        def emit(context, builder, signature, arguments):
            if isinstance(a.dtype, types.Float):
                return getattr(builder, of_floats)(*arguments, flags=('contract',))
            return getattr(builder, of_integers)(*arguments)
        return a(a, b), emit

    def implementation(a, b):
        return (lambda a, b: apply(a, b)) if isinstance(a, Vector) and a == b else None

    for symbol in symbols:
        overload(symbol)(implementation)


_arithmetic('fadd', 'add', operator.add, operator.iadd)
_arithmetic('fsub', 'sub', operator.sub, operator.isub)
_arithmetic('fmul', 'mul', operator.mul, operator.imul)


@intrinsic
def products_of_pairs(typing_context, a, b):
    """a[0] b[0] + a[1] b[1], a[2] b[2] + a[3] b[3] and so on: half as many int32 of two vectors of int16.

    One instruction on x86, which LLVM does not find on its own whenever it knows something about the operands.
    """
    if not a.dtype == b.dtype == types.int16:
        return None

    def emit(context, builder, signature, arguments):
        wide = context.get_value_type(signature.return_type)
        if _HAS_AVX2:
            function_type = ir.FunctionType(wide, [value.type for value in arguments])
            return builder.call(builder.module.declare_intrinsic('llvm.x86.avx2.pmadd.wd', (), function_type),
                                arguments)
        even, odd = (builder.mul(*(builder.sext(builder.shuffle_vector(value, value, indices(range(first, LANES, 2))),
                                                wide) for value in arguments)) for first in (0, 1))
        return builder.add(even, odd)
    return Vector(types.int32, LANES // 2)(a, b), emit


def _masking(first: int) -> Any:
    """An intrinsic: a vector of integers with zeros in every second lane, from the other one than `first` on."""
    @intrinsic
    def only(typing_context, vector):
        def emit(context, builder, signature, arguments):
            kind = arguments[0].type
            kept = [kind.element(-1 if i % 2 == first else 0) for i in range(vector.lanes)]
            return builder.and_(arguments[0], ir.Constant(kind, kept))
        return vector(vector), emit
    return only


only_even, only_odd = _masking(0), _masking(1)   # zeros in lanes 1, 3, 5 and so on, or in 0, 2, 4 and so on


def _compared(builder: Any, symbol: str, vector: Any, arguments: Any) -> Any:
    if isinstance(vector.dtype, types.Float):
        return builder.fcmp_ordered(symbol, *arguments)
    return (builder.icmp_signed if vector.dtype.signed else builder.icmp_unsigned)(symbol, *arguments)


def _called(builder: Any, name: str, *arguments: Any) -> Any:
    """What LLVM's function of that name gives, which is of the type of its arguments."""
    function = builder.module.globals.get(name)
    if function is None:
        kind = arguments[0].type
        function = ir.Function(builder.module, ir.FunctionType(kind, [kind] * len(arguments)), name)
    return builder.call(function, arguments)


def _of_two(combine: Callable[..., Any]) -> Any:
    """An intrinsic of two vectors of one type, which gives a third."""
    @intrinsic
    def apply(typing_context, a, b):
        return a(a, b), lambda context, builder, signature, arguments: combine(builder, a, *arguments)
    return apply


def _distance(builder: Any, vector: Any, a: Any, b: Any) -> Any:
    name = f'llvm.usub.sat.v{vector.lanes}i{vector.dtype.bitwidth}'   # the difference, or zero
    return builder.or_(_called(builder, name, a, b), _called(builder, name, b, a))


def _mean_rounded_up(builder: Any, vector: Any, a: Any, b: Any) -> Any:
    wide = ir.VectorType(ir.IntType(16), vector.lanes)
    total, one = builder.add(builder.zext(a, wide), builder.zext(b, wide)), ir.Constant(wide, [1] * vector.lanes)
    return builder.trunc(builder.lshr(builder.add(total, one), one), a.type)


#: The greater number in each place; b where a is NaN.
maximum = _of_two(lambda builder, vector, *both: builder.select(_compared(builder, '>', vector, both), *both))
quotient = _of_two(lambda builder, vector, a, b: builder.fdiv(a, b))   # of floats
distance = _of_two(_distance)   # |a - b|, of unsigned integers
mean_rounded_up = _of_two(_mean_rounded_up)   # (a + b + 1) // 2, of uint8


@intrinsic
def square_root(typing_context, vector):
    """Of each number of a vector of floats."""
    def emit(context, builder, signature, arguments):
        return _called(builder, f'llvm.sqrt.v{LANES}f{vector.dtype.bitwidth}', *arguments)
    return vector(vector), emit


@intrinsic
def sum_of(typing_context, vector):
    """Sum of the numbers of a vector of floats."""
    def emit(context, builder, signature, arguments):
        value, lanes = arguments[0], vector.lanes
        while lanes > 1:   # the lower half and the upper half
            lanes //= 2
            halves = [indices(range(first, first + lanes)) for first in (0, lanes)]
            value = builder.fadd(*(builder.shuffle_vector(value, value, half) for half in halves))
        return builder.extract_element(value, ir.IntType(32)(0))
    return vector.dtype(vector), emit


def _comparison(symbol: str) -> Any:
    """An intrinsic that says in the bits of an integer, lowest first, where that holds between two vectors."""
    @intrinsic
    def compare(typing_context, a, b):
        def emit(context, builder, signature, arguments):
            lanes = _compared(builder, symbol, a, arguments)
            return builder.zext(builder.bitcast(lanes, ir.IntType(a.lanes)), ir.IntType(64))
        return types.int64(a, b), emit
    return compare


where_greater = _comparison('>')
where_not_less = _comparison('>=')


@intrinsic
def lowest_bit(typing_context, bits):
    """Number of the lowest bit that is set in an int64 that is not zero."""
    def emit(context, builder, signature, arguments):
        return builder.cttz(arguments[0], ir.IntType(1)(1))
    return types.int64(types.int64), emit
