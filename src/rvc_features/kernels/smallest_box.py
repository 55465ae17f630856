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
        even_a, odd_a, even_b, odd_b, even_c, odd_c = _sums_of_three(gradients, i, sums, new + 3 * at)
        m, o = middle + 3 * at, old + 3 * at
        even = _harris(even_a + (load_half(sums, m) + load_half(sums, o)),
                       even_b + (load_half(sums, m + 2 * _HALF) + load_half(sums, o + 2 * _HALF)),
                       even_c + (load_half(sums, m + 4 * _HALF) + load_half(sums, o + 4 * _HALF)), harris_k, scale)
        odd = _harris(odd_a + (load_half(sums, m + _HALF) + load_half(sums, o + _HALF)),
                      odd_b + (load_half(sums, m + 3 * _HALF) + load_half(sums, o + 3 * _HALF)),
                      odd_c + (load_half(sums, m + 5 * _HALF) + load_half(sums, o + 5 * _HALF)), harris_k, scale)
        both = interleaved(even, odd)
        store(out, y * width + i, both)
        most = maximum(both, most)
    store(largest, 0, most)


@kernel
def _sums_of_three(gradients, i, sums, to):
    """Products of the gradients in x and y, each summed over a pixel and its neighbours in the row; kept, and returned.

    Of the even pixels 0, 2, 4 and so on of sixteen from i on: -1 with 0, and 1; of the odd ones: 0 with 1, and 2.
    """
    x, y = LANES + i, LANES + gradients.shape[1] + i
    x_before, x_here, x_after = load(gradients, x - 1), load(gradients, x), load(gradients, x + 1)
    y_before, y_here, y_after = load(gradients, y - 1), load(gradients, y), load(gradients, y + 1)
    x_one, y_one, x_two, y_two = only_odd(x_here), only_odd(y_here), only_odd(x_after), only_odd(y_after)
    even_a = products_of_pairs(x_before, x_before) + products_of_pairs(x_one, x_here)
    odd_a = products_of_pairs(x_here, x_here) + products_of_pairs(x_two, x_after)
    even_b = products_of_pairs(x_before, y_before) + products_of_pairs(x_one, y_here)
    odd_b = products_of_pairs(x_here, y_here) + products_of_pairs(x_two, y_after)
    even_c = products_of_pairs(y_before, y_before) + products_of_pairs(y_one, y_here)
    odd_c = products_of_pairs(y_here, y_here) + products_of_pairs(y_two, y_after)
    store(sums, to, even_a)
    store(sums, to + _HALF, odd_a)
    store(sums, to + 2 * _HALF, even_b)
    store(sums, to + 3 * _HALF, odd_b)
    store(sums, to + 4 * _HALF, even_c)
    store(sums, to + 5 * _HALF, odd_c)
    return even_a, odd_a, even_b, odd_b, even_c, odd_c


@kernel
def _harris(a, b, c, harris_k, scale):
    """H of sums instead of averages; k has the scale in it."""
    a, b, c = to_float32(a), to_float32(b), to_float32(c)
    trace = a + c
    return (a * c - b * b) * scale - (trace * harris_k) * trace
