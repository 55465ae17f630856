"""The Harris response with the box window of 3x3 pixels, of uint8 images: the shortest way; reference: response.py.

Two rows at a time, block of columns by block, so that everything but the image stays in the nearest cache. Down the
columns gradients are kept in int16, sixteen to a vector, and their products summed over three rows in float32, where
product and sum are one instruction. Even pixels and odd ones are kept apart until the response is stored: then the
sums of three neighbours along the row share the sum of two, and half of them need not be read from odd places.
All sums are whole numbers below 2^24, exact in single precision, but for a factor that is a power of two.
"""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import installed, kernel
from rvc_features.kernels.rows import reflect, row_length, zeros

if installed:
    from rvc_features.kernels.instructions import (
        SCALE,
        all_written,
        expect_to_read,
        expect_to_write,
        scaled_evens,
        scaled_odds,
        stream,
    )
    from rvc_features.kernels.vectors import (
        LANES,
        interleaved,
        load,
        load_half,
        maximum,
        splat_half,
        store,
        to_float32,
        widened,
    )

_BLOCK = 512   # columns
_STRIDE = (_BLOCK + 64) // 2   # from one part of the sums to the next: even or odd columns of a block, and ends
_UINT8, _INT16, _FLOAT32 = np.empty(0, np.uint8), np.empty(0, np.int16), np.empty(0, np.float32)


@kernel
def response(harris_k, image, out, streamed, first, last):
    """Fill in the rows from `first` to before `last`; returns the largest value in them.

    `streamed`: past the caches; `out` begins at a cache line, and so does each row.
    """
    height, width = image.shape
    length = row_length(width, LANES)
    pixels, kept = zeros(2 * length, _UINT8), zeros(8 * length, _INT16)
    sums = zeros(2 * 6 * _STRIDE, _FLOAT32)   # of two rows: A, B and C, each of even and of odd columns
    largest = np.full(LANES, -np.inf, np.float32)
    last_responses = zeros(LANES, _FLOAT32)
    for y in range(first - 4, last, 2):   # the first two times there are no gradients of rows y - 1 and y yet
        for row in range(2):
            _copy_ends(image, reflect(y + 2 + row, height), pixels, row * length + LANES)
        for start in range(0, width + LANES, _BLOCK):
            _sums_down_the_columns(image, pixels, kept, y, start, min(start + _BLOCK, width), sums)
            if y >= first:
                _reflect_ends(sums, start, width)
                _responses(sums, min(2, last - y), harris_k, out, streamed, y, start, largest)
                if width % LANES > 0 and start + _BLOCK >= width + LANES:
                    _last_responses(sums, min(2, last - y), harris_k, out, y, start, largest, last_responses)
                for part in range(0, len(sums), _STRIDE):   # the block's last columns are the next one's lead
                    store(sums, part, load(sums, part + _BLOCK // 2))
    all_written()
    return largest.max()


@kernel
def _copy_ends(image, y, pixels, start):
    """The first and last columns of a row, with one more on either side."""
    width = image.shape[1]
    for x in (0, min(LANES, width - LANES), max(width - 2 * LANES, 0), width - LANES):
        store(pixels, start + x, load(image, y * width + x))
    pixels[start - 1], pixels[start + width] = pixels[start + 1], pixels[start + width - 2]


@kernel
def _sums_down_the_columns(image, pixels, kept, y, start, end, sums):
    """Sums of products over three rows, for the columns from `start` to before `end` of rows y and y + 1."""
    height, width = image.shape
    length = len(kept) // 8
    above, below = reflect(y + 2, height) * width, reflect(y + 3, height) * width
    for x in range(start, end, LANES):
        x_0, y_0, x_1, y_1 = (load(kept, x), load(kept, length + x), load(kept, 2 * length + x),
                              load(kept, 3 * length + x))
        if 0 < x < width - LANES:
            expect_to_read(image, above + 2 * width + x)
            expect_to_read(image, below + 2 * width + x)
            next_rows = _along_the_row(image, above + x), _along_the_row(image, below + x)
        else:
            next_rows = _along_the_row(pixels, LANES + x), _along_the_row(pixels, length + LANES + x)
        x_2, y_2, x_3, y_3 = _next_gradients(next_rows, kept, length, x)
        if y == 0:   # beyond the edges products are those of the rows within
            x_0, y_0 = x_2, y_2
        if y + 1 == height:
            x_2, y_2 = x_0, y_0
        if y + 2 == height:
            x_3, y_3 = x_1, y_1
        at = LANES + (x - start) // 2
        _sums_of_rows(sums, at, scaled_evens(x_0), scaled_evens(y_0), scaled_evens(x_1), scaled_evens(y_1),
                      scaled_evens(x_2), scaled_evens(y_2), scaled_evens(x_3), scaled_evens(y_3))
        _sums_of_rows(sums, at + _STRIDE, scaled_odds(x_0), scaled_odds(y_0), scaled_odds(x_1), scaled_odds(y_1),
                      scaled_odds(x_2), scaled_odds(y_2), scaled_odds(x_3), scaled_odds(y_3))


@kernel
def _next_gradients(next_rows, kept, length, x):
    """Gradients in x and in y of sixteen columns of the next two rows; what the ones after them need is kept."""
    difference_0, difference_1 = load(kept, 4 * length + x), load(kept, 5 * length + x)
    sum_0, sum_1 = load(kept, 6 * length + x), load(kept, 7 * length + x)
    (difference_2, sum_2), (difference_3, sum_3) = next_rows
    pair = difference_1 + difference_2
    x_2, y_2 = (difference_0 + difference_1) + pair, sum_2 - sum_0
    x_3, y_3 = pair + (difference_2 + difference_3), sum_3 - sum_1
    store(kept, x, x_2)
    store(kept, length + x, y_2)
    store(kept, 2 * length + x, x_3)
    store(kept, 3 * length + x, y_3)
    store(kept, 4 * length + x, difference_2)
    store(kept, 5 * length + x, difference_3)
    store(kept, 6 * length + x, sum_2)
    store(kept, 7 * length + x, sum_3)
    return x_2, y_2, x_3, y_3


@kernel
def _along_the_row(pixels, at):
    """Differences -1 0 1 and sums 1 2 1 of sixteen pixels from `at` on."""
    before, here, after = widened(load(pixels, at - 1)), widened(load(pixels, at)), widened(load(pixels, at + 1))
    return after - before, (before + after) + (here + here)


@kernel
def _sums_of_rows(sums, at, x_0, y_0, x_1, y_1, x_2, y_2, x_3, y_3):
    a, b, c = x_1 * x_1 + x_2 * x_2, x_1 * y_1 + x_2 * y_2, y_1 * y_1 + y_2 * y_2
    store(sums, at, a + x_0 * x_0)
    store(sums, at + 2 * _STRIDE, b + x_0 * y_0)
    store(sums, at + 4 * _STRIDE, c + y_0 * y_0)
    store(sums, at + 6 * _STRIDE, a + x_3 * x_3)
    store(sums, at + 8 * _STRIDE, b + x_3 * y_3)
    store(sums, at + 10 * _STRIDE, c + y_3 * y_3)


@kernel
def _reflect_ends(sums, start, width):
    """Continue the rows by a column on either side, where their ends lie in the block."""
    for part in range(0, len(sums), 2 * _STRIDE):
        if start == 0:
            sums[part + _STRIDE + LANES - 1] = sums[part + _STRIDE + LANES]
        if width < start + _BLOCK:
            end = part + width % 2 * _STRIDE + LANES + (width - start) // 2
            sums[end] = sums[end - 1]


@kernel
def _responses(sums, rows, harris_k, out, streamed, y, start, largest):
    """One row of the response, or two, from sixteen columns before the block to sixteen before its end."""
    width = out.shape[1]
    scale = np.float32(1 / (81 * SCALE ** 4))
    harris_k, scale = splat_half(harris_k * scale), splat_half(scale)
    most = load(largest, 0)
    end = min(start + _BLOCK - LANES, width)
    for x in range(max(start - LANES, 0), end - end % LANES, LANES):
        at, to = LANES + (x - start) // 2, y * width + x
        response = _response(sums, at, harris_k, scale)
        _write(out, to, response, streamed, 2 * width)
        most = maximum(response, most)
        if rows > 1:
            response = _response(sums, at + 6 * _STRIDE, harris_k, scale)
            _write(out, to + width, response, streamed, 2 * width)
            most = maximum(response, most)
    store(largest, 0, most)


@kernel
def _write(out, to, response, streamed, ahead):
    """Store sixteen responses; where they go through the caches, what is written later is fetched."""
    if streamed:
        stream(out, to, response)
    else:
        expect_to_write(out, to + ahead)
        store(out, to, response)


@kernel
def _last_responses(sums, rows, harris_k, out, y, start, largest, last):
    """Those of the columns after the last whole vector."""
    width = out.shape[1]
    scale = np.float32(1 / (81 * SCALE ** 4))
    whole = width - width % LANES
    for row in range(rows):
        at = row * 6 * _STRIDE + LANES + (whole - start) // 2
        store(last, 0, _response(sums, at, splat_half(harris_k * scale), splat_half(scale)))
        for x in range(whole, width):
            out[y + row, x] = last[x - whole]
            largest[0] = max(largest[0], last[x - whole])


@kernel
def _response(sums, at, harris_k, scale):
    a, b, c = _along(sums, at), _along(sums, at + 2 * _STRIDE), _along(sums, at + 4 * _STRIDE)
    return response_of_sums((a[0], a[1], b[0], b[1], c[0], c[1]), harris_k, scale)


@kernel
def _along(sums, at):
    """Sums of three neighbours along the row, of eight even columns and of eight odd ones."""
    even, odd = load_half(sums, at), load_half(sums, at + _STRIDE)
    pair = even + odd
    return load_half(sums, at + _STRIDE - 1) + pair, pair + load_half(sums, at + 1)


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
