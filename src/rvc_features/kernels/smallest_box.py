"""The Harris response with the box window of 3x3 pixels, of uint8 images: the shortest way; reference: response.py.

Sums of three neighbours are made where products are: one instruction multiplies sixteen gradients and adds two
neighbouring products. Even pixels and odd ones, whose pairs differ, are kept apart until the response is stored. All
sums are whole numbers below 2^24, exact in single precision.
"""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import installed, kernel
from rvc_features.kernels.rows import (
    gradient_buffers,
    next_gradient_parts,
    reflect,
    reflect_ends,
    row_length,
    sobel_gradient,
    zeros,
)

if installed:
    from rvc_features.kernels.vectors import (
        LANES,
        interleaved,
        load,
        load_half,
        maximum,
        only_even,
        only_odd,
        products_of_pairs,
        splat_half,
        store,
        to_float32,
    )

_HALF = 8   # half a vector
_INT16, _INT32 = np.empty(0, np.int16), np.empty(0, np.int32)


@kernel
def response(image, harris_k, out, first, last):
    """Fill in the rows from `first` to before `last`; returns the largest value in them."""
    height, width = image.shape
    smoothed, rows, parts = gradient_buffers(width, None, _INT16)
    length = row_length(width, LANES)
    gradients = zeros(2 * length, _INT16).reshape((2, length))
    sums = zeros(3 * 3 * length, _INT32)   # along the row, of three rows: 3 x 2 half vectors to 16 pixels
    largest = np.full(LANES, -np.inf, np.float32)
    for y in range(first - 1, last + 1):
        next_gradient_parts(image, reflect(y, height), False, None, smoothed, rows, parts)
        for i in range(0, width, LANES):
            x_gradient, y_gradient = sobel_gradient(parts, i)
            store(gradients, LANES + i, x_gradient)
            store(gradients, LANES + length + i, y_gradient)
        for part in range(2):
            reflect_ends(gradients[part], LANES, width, 1)
        new, middle, old = (y + 3) % 3 * 3 * length, (y + 2) % 3 * 3 * length, (y + 1) % 3 * 3 * length
        if y > first:
            _response_of_row(gradients, sums, new, middle, old, harris_k, out, y - 1, largest)
        else:
            for i in range(0, width, LANES):
                _sums_of_three(gradients, min(i, width - LANES), sums, new + 3 * i)
    return largest.max()


@kernel
def _response_of_row(gradients, sums, new, middle, old, harris_k, out, y, largest):
    width = out.shape[1]
    most = load(largest, 0)
    scale = np.float32(1 / 81)
    harris_k, scale = splat_half(harris_k * scale), splat_half(scale)
    for at in range(0, width, LANES):
        i = min(at, width - LANES)
        sums_of_new = _sums_of_three(gradients, i, sums, new + 3 * at)
        older = added(_kept(sums, middle + 3 * at), _kept(sums, old + 3 * at))
        response = response_of_sums(added(sums_of_new, older), harris_k, scale)
        store(out, y * width + i, response)
        most = maximum(response, most)
    store(largest, 0, most)


@kernel
def _sums_of_three(gradients, i, sums, to):
    """`sums_along_the_row` of sixteen pixels from i on; kept, and returned."""
    result = sums_along_the_row(gradients, LANES + i, LANES + gradients.shape[1] + i)
    for part in range(6):
        store(sums, to + part * _HALF, result[part])
    return result


@kernel
def _kept(sums, at):
    return (load_half(sums, at), load_half(sums, at + _HALF), load_half(sums, at + 2 * _HALF),
            load_half(sums, at + 3 * _HALF), load_half(sums, at + 4 * _HALF), load_half(sums, at + 5 * _HALF))


@kernel
def sums_along_the_row(gradients, x, y):
    """Products of sixteen gradients, in x and in y from those places on, summed over a pixel and its neighbours.

    Six half vectors: of A, B and C, each of the even pixels 0, 2, 4 and so on, and of the odd ones. Pixels 0 and 1 are
    in the sums of both; neighbour -1 is added to the even ones, 2 to the odd.
    """
    x_before, x_here, x_after = load(gradients, x - 1), load(gradients, x), load(gradients, x + 1)
    y_before, y_here, y_after = load(gradients, y - 1), load(gradients, y), load(gradients, y + 1)
    x_one, y_one, x_two, y_two = only_even(x_before), only_even(y_before), only_odd(x_after), only_odd(y_after)
    a, b, c = products_of_pairs(x_here, x_here), products_of_pairs(x_here, y_here), products_of_pairs(y_here, y_here)
    return (products_of_pairs(x_one, x_before) + a, a + products_of_pairs(x_two, x_after),
            products_of_pairs(x_one, y_before) + b, b + products_of_pairs(x_two, y_after),
            products_of_pairs(y_one, y_before) + c, c + products_of_pairs(y_two, y_after))


@kernel
def added(a, b):
    """Sums of six and six half vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


@kernel
def response_of_sums(sums, harris_k, scale):
    """H of sums instead of averages, of sixteen pixels; `harris_k` has the scale in it."""
    return interleaved(_harris(sums[0], sums[2], sums[4], harris_k, scale),
                       _harris(sums[1], sums[3], sums[5], harris_k, scale))


@kernel
def _harris(a, b, c, harris_k, scale):
    a, b, c = to_float32(a), to_float32(b), to_float32(c)
    trace = a + c
    return (a * c - b * b) * scale - (trace * harris_k) * trace
