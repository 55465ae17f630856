"""Vectors of sixteen numbers against NumPy, which does the same to arrays of that length."""

import numpy as np
import pytest

from rvc_features.kernels import compiler

if not compiler.available():
    pytest.skip('Numba is not installed', allow_module_level=True)

import numba

from rvc_features.kernels import instructions, vectors
from rvc_features.kernels.vectors import LANES, load, load_double, load_half, splat, store

random = np.random.default_rng(0)
TYPES = [np.uint8, np.int16, np.int32, np.float32, np.float64]
FLOATS = [np.float32, np.float64]


def numbers(dtype, count=LANES):
    return random.integers(0, 200, count).astype(dtype)


def applied(function, result_type, *operands):
    """What a function of vectors gives for arrays of LANES numbers."""
    out = np.zeros(LANES, result_type)
    if len(operands) == 1:
        @numba.njit
        def run(a, out):
            store(out, 0, function(load(a, 0)))
    else:
        @numba.njit
        def run(a, b, out):
            store(out, 0, function(load(a, 0), load(b, 0)))
    run(*operands, out)
    return out


@pytest.mark.parametrize('dtype', TYPES)
def test_load_and_store_take_and_leave_what_is_there(dtype):
    @numba.njit
    def copy(source, start, target, to):
        store(target, to, load(source, start))

    source, target = numbers(dtype, 64).reshape(4, 16), np.zeros((4, 16), dtype)
    copy(source, 21, target, 7)   # from and to the middle of a row, and across its end
    expected = np.zeros(64, dtype)
    expected[7:23] = source.ravel()[21:37]
    assert np.array_equal(target.ravel(), expected)


@pytest.mark.parametrize('dtype', TYPES)
def test_splat(dtype):
    @numba.njit
    def fill(number, out):
        store(out, 0, splat(number))

    out = np.zeros(LANES, dtype)
    fill(dtype(7), out)
    assert np.array_equal(out, np.full(LANES, 7, dtype))


@pytest.mark.parametrize('dtype', TYPES[1:])
@pytest.mark.parametrize('operation', [lambda a, b: a + b, lambda a, b: a - b, lambda a, b: a * b])
def test_arithmetic(operation, dtype):
    a, b = numbers(dtype), numbers(dtype)
    assert np.array_equal(applied(numba.njit(operation), dtype, a, b), operation(a, b))


def test_operands_of_different_types_are_an_error():
    with pytest.raises(numba.TypingError):
        applied(numba.njit(lambda a, b: a + b), np.float32, numbers(np.float32), numbers(np.int32))


@pytest.mark.parametrize('dtype', TYPES)
def test_conversions(dtype):
    a = numbers(dtype) if dtype == np.uint8 else -numbers(dtype)
    for convert, target in ((vectors.to_float32, np.float32), (vectors.to_float64, np.float64)):
        assert np.array_equal(applied(convert, target, a), a.astype(target))
    if dtype != np.int32:
        target = {np.uint8: np.int16, np.int16: np.int32}.get(dtype, np.float64)
        assert np.array_equal(applied(vectors.widened, target, a), a.astype(target))


@pytest.mark.parametrize('dtype', FLOATS)
def test_comparisons_and_maximum(dtype):
    a, b = numbers(dtype), numbers(dtype)
    a[3], b[5], a[7] = np.nan, np.nan, b[7]
    bits = numba.njit(lambda a, b: (vectors.where_greater(load(a, 0), load(b, 0)),
                                    vectors.where_not_less(load(a, 0), load(b, 0))))(a, b)
    assert bits == tuple(sum(1 << int(i) for i in np.flatnonzero(where)) for where in (a > b, a >= b))
    np.testing.assert_array_equal(applied(vectors.maximum, dtype, a, b), np.where(a > b, a, b))


@pytest.mark.parametrize('dtype', FLOATS)
def test_sum_of(dtype):
    a = numbers(dtype)
    assert numba.njit(lambda a: vectors.sum_of(load(a, 0)))(a) == a.sum()


def test_lowest_bit():
    lowest_bit = numba.njit(lambda bits: vectors.lowest_bit(bits))
    assert [lowest_bit(1 << i) for i in range(63)] == list(range(63))
    assert lowest_bit(0b101000) == 3


@pytest.mark.parametrize('has_avx2', [True, False])
def test_products_of_pairs(monkeypatch, has_avx2):
    """With x86's instruction, where it is there, and without."""
    monkeypatch.setattr(vectors, '_HAS_AVX2', has_avx2 and vectors._HAS_AVX2)

    @numba.njit
    def run(a, b, out):
        store(out, 0, vectors.products_of_pairs(load(a, 0), load(b, 0)))

    a, b = random.integers(-2040, 2041, (2, LANES)).astype(np.int16)
    a[:4], b[:4] = -2040, 2040
    out = np.zeros(LANES, np.int32)
    run(a, b, out)
    products = a.astype(np.int32) * b
    assert np.array_equal(out[:LANES // 2], products[0::2] + products[1::2])
    assert not out[LANES // 2:].any()   # half a vector is half as much


def test_lanes_apart_and_together():
    @numba.njit
    def run(a, halves, odd, together, seven):
        store(odd, 0, vectors.only_odd(load(a, 0)))
        store(together, 0, vectors.interleaved(vectors.load_half(halves, 0), vectors.load_half(halves, 8)))
        store(seven, 0, vectors.splat_half(np.float32(7)))

    a, halves = random.integers(-99, 99, LANES).astype(np.int16), numbers(np.float32)
    odd, together, seven = np.zeros(LANES, np.int16), np.zeros(LANES, np.float32), np.zeros(LANES, np.float32)
    run(a, halves, odd, together, seven)
    assert np.array_equal(odd, np.where(np.arange(LANES) % 2, a, 0))
    assert np.array_equal(together, halves.reshape(2, 8).T.ravel())
    assert np.array_equal(seven, [7] * 8 + [0] * 8)


@pytest.mark.parametrize(('source', 'target'), [(np.uint8, np.int16), (np.int16, np.int32), (np.int32, np.float32),
                                                (np.float64, np.float32), (np.float64, np.float64)])
def test_converted_takes_the_type_of_another(source, target):
    @numba.njit
    def run(a, like, out):
        store(out, 0, vectors.converted(load(a, 0), load(like, 0)))

    a, out = numbers(source), np.zeros(LANES, target)
    run(a, numbers(target), out)
    assert np.array_equal(out, a.astype(target))


def test_every_second_byte_and_four_vectors_in_turn():
    @numba.njit
    def part(source, even, odd):
        store(even, 0, instructions.even_bytes(load_double(source, 0)))
        store(odd, 0, instructions.odd_bytes(load_double(source, 0)))

    @numba.njit
    def join(source, out):
        instructions.store_in_turn(out, 1, load_half(source, 0), load_half(source, 8), load_half(source, 16),
                                   load_half(source, 24))

    source = np.arange(200, 232).astype(np.uint8)
    even, odd, out = np.zeros(LANES, np.int16), np.zeros(LANES, np.int16), np.zeros(34, np.float32)
    part(source, even, odd)
    assert np.array_equal(np.column_stack((even, odd)).ravel(), source)
    join(source.astype(np.float32), out)
    assert np.array_equal(out[1:-1], source.reshape(4, 8).T.ravel())
    assert out[0] == out[-1] == 0
