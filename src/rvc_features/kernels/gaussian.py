"""The Harris response with a large Gaussian window, of uint8 images; reference: response.py.

Each row is cut into eight strands, side by side in memory: first all first pixels of the strands, then all second ones.
A neighbour along the row is then a whole vector away, as one down the columns is: no vector straddles two cache lines,
and each that is loaded serves four sums. What lies left and right of a strand is repeated in it.
"""

from __future__ import annotations

import functools

import numpy as np

from rvc_features.kernels.compiler import installed, kernel
from rvc_features.kernels.rows import reflect, reflect_ends, row_lead, zeros

if installed:
    from rvc_features.kernels.transposition import transpose_bytes, transpose_floats
    from rvc_features.kernels.vectors import (
        LANES,
        load,
        load_half,
        maximum,
        splat_half,
        store,
        to_float32,
        widened,
    )

LEAST_WIDTH = 64   # pixels: strands come in eights of vectors
_STRANDS = 8
_ROWS = 4     # of the response, at once: each row of sums is loaded for four
_CHUNK = 8    # vectors of a row, at once
_INT16 = np.empty(0, np.int16)   # for its type: what gradients are kept in


def response(image: np.ndarray, taps: np.ndarray, harris_k: np.float32, out: np.ndarray, first: int,
             last: int) -> float:
    """Fill in the rows from `first` to before `last`; returns the largest value in them.

    `taps` are the window's weights from its centre outwards. Here the first is one, and what that makes of H is undone.
    """
    weights, scale = (taps / taps[0]).astype(np.float32), np.float32(taps[0] ** 4)
    width = image.shape[1]
    length = -(-width // (_CHUNK * _STRANDS)) * _CHUNK
    return _response(image, weights, harris_k, scale, length, _outside(width, length, len(taps) - 1), out, first, last)


@functools.lru_cache(maxsize=64)
def _outside(width: int, length: int, radius: int) -> np.ndarray:
    """Where in strands of that length lies what is up to `radius` pixels outside the image, int64."""
    return np.array([(x - strand * length) * _STRANDS + strand
                     for j in range(1, radius + 1) for x in (-j, width - 1 + j) for strand in range(_STRANDS)
                     if -radius <= x - strand * length < length + radius], np.int64)


@kernel
def _response(image, weights, harris_k, scale, length, outside, out, first, last):
    height, width = image.shape
    radius = len(weights) - 1
    margin = radius + 1
    read_length = -(-(length + 2 * margin) // LANES) * LANES   # of a strand with what lies left and right of it
    lead, padded_width = row_lead(margin), length * _STRANDS
    line = zeros(lead + padded_width + read_length, image)
    strands = zeros(3 * read_length * _STRANDS, image).reshape((3, read_length * _STRANDS))
    parts = zeros(2 * read_length * _STRANDS, _INT16).reshape((2, read_length * _STRANDS))
    stride = read_length * _STRANDS
    gradients = zeros(2 * stride, _INT16).reshape((2, stride))
    products = zeros(3 * stride, weights).reshape((3, stride))
    slots, sum_stride = min(height, 2 * radius + _ROWS), padded_width + LANES
    sums = zeros(slots * 3 * sum_stride, weights)
    block = zeros(3 * _ROWS * _CHUNK * _STRANDS, weights).reshape((3, _ROWS * _CHUNK * _STRANDS))
    lines = zeros(_ROWS * padded_width, weights)
    offsets = np.empty(2 * radius + _ROWS, np.int64)
    largest, of_padded = np.full(LANES, -np.inf, np.float32), np.full(LANES, -np.inf, np.float32)
    responses = out.reshape(-1)
    done = max(0, first - radius)
    read = max(0, done - 1)
    for y in range(first, last, _ROWS):
        while done <= min(height - 1, y + _ROWS - 1 + radius):
            while read <= min(height - 1, done + 1):
                _read_row(image, read, line, lead, margin, length, strands, read % 3)
                read += 1
            above, below = reflect(done - 1, height), reflect(done + 1, height)
            _gradients(strands, above % 3, done % 3, below % 3, parts, gradients)
            for place in outside:   # the product there is that of its mirror image, the gradient in x is not
                gradients[0, radius * _STRANDS + place] = -gradients[0, radius * _STRANDS + place]
            _multiply_row(gradients, products)
            for part in range(3):
                _weigh_along(products, part * stride + radius * _STRANDS, weights, length, sums,
                             (done % slots * 3 + part) * sum_stride)
            done += 1
        for j in range(2 * radius + _ROWS):
            offsets[j] = reflect(y - radius + j, height) % slots * 3 * sum_stride
        count = min(_ROWS, last - y)
        if width == padded_width:
            _respond(sums, offsets, sum_stride, weights, length, block, harris_k, scale, responses, y * width, count,
                     largest)
        else:
            _respond(sums, offsets, sum_stride, weights, length, block, harris_k, scale, lines, 0, count, of_padded)
            most = load(largest, 0)
            for row in range(count):
                for i in range(0, width, LANES):
                    i = min(i, width - LANES)
                    values = load(lines, row * padded_width + i)
                    store(out, (y + row) * width + i, values)
                    most = maximum(values, most)
            store(largest, 0, most)
    return largest.max()


@kernel
def _read_row(image, y, line, lead, margin, length, strands, slot):
    """Row y in strands, from `margin` pixels before their first ones on."""
    width = image.shape[1]
    for i in range(0, width, LANES):
        i = min(i, width - LANES)
        store(line, lead + i, load(image, y * width + i))
    reflect_ends(line, lead, width, margin)
    to = slot * strands.shape[1]
    for t in range(0, strands.shape[1] // _STRANDS, LANES):
        transpose_bytes(line, lead - margin + t, length, strands, to + t * _STRANDS)


@kernel
def _gradients(strands, above, here, below, parts, gradients):
    """3x3 Sobel gradients in x and in y, in strands that begin one pixel after those they are made of."""
    length = strands.shape[1]
    above, here, below = above * length, here * length, below * length
    for i in range(0, length, LANES):
        before, middle = widened(load(strands, above + i)), widened(load(strands, here + i))
        after = widened(load(strands, below + i))
        store(parts, i, (before + after) + (middle + middle))
        store(parts, length + i, after - before)
    stride = gradients.shape[1]
    for i in range(0, length - 2 * _STRANDS, LANES):
        store(gradients, i, load(parts, i + 2 * _STRANDS) - load(parts, i))
        at = length + i
        middle = load(parts, at + _STRANDS)
        store(gradients, stride + i, (load(parts, at) + load(parts, at + 2 * _STRANDS)) + (middle + middle))


@kernel
def _multiply_row(gradients, products):
    """Products of the gradients of one row: I_x^2, I_x I_y, I_y^2."""
    stride = gradients.shape[1]
    for i in range(0, stride, LANES):
        across, down = to_float32(load(gradients, i)), to_float32(load(gradients, stride + i))
        store(products, i, across * across)
        store(products, stride + i, across * down)
        store(products, 2 * stride + i, down * down)


@kernel
def _weigh_along(products, start, weights, length, sums, to):
    """Weighted sums along the row, of four neighbouring vectors at once: two loads to four sums of a pair."""
    last = start + 3 * _STRANDS
    for i in range(0, length * _STRANDS, 4 * _STRANDS):
        a, b = load_half(products, start + i), load_half(products, start + i + _STRANDS)
        c, d = load_half(products, start + i + 2 * _STRANDS), load_half(products, last + i)
        low_a, low_b, low_c, low_d = a, b, c, d
        high_a, high_b, high_c, high_d = a, b, c, d
        for j in range(1, len(weights)):
            low_a, low_b, low_c, low_d = load_half(products, start + i - j * _STRANDS), low_a, low_b, low_c
            high_a, high_b, high_c, high_d = high_b, high_c, high_d, load_half(products, last + i + j * _STRANDS)
            weight = splat_half(weights[j])
            a += weight * (low_a + high_a)
            b += weight * (low_b + high_b)
            c += weight * (low_c + high_c)
            d += weight * (low_d + high_d)
        store(sums, to + i, a)
        store(sums, to + i + _STRANDS, b)
        store(sums, to + i + 2 * _STRANDS, c)
        store(sums, to + i + 3 * _STRANDS, d)


@kernel
def _weigh_down(sums, offsets, start, weights, block, to):
    """The same down the columns, for a chunk of four rows.

    A kernel of its own: one that looks up where the neighbours lie in either case takes an eighth longer for the whole.
    """
    radius, size = len(weights) - 1, _CHUNK * _STRANDS
    for i in range(0, size, _STRANDS):
        at = start + i
        a, b = load_half(sums, at + offsets[radius]), load_half(sums, at + offsets[radius + 1])
        c, d = load_half(sums, at + offsets[radius + 2]), load_half(sums, at + offsets[radius + 3])
        low_a, low_b, low_c, low_d = a, b, c, d
        high_a, high_b, high_c, high_d = a, b, c, d
        for j in range(1, radius + 1):
            low_a, low_b, low_c, low_d = load_half(sums, at + offsets[radius - j]), low_a, low_b, low_c
            high_a, high_b, high_c, high_d = high_b, high_c, high_d, load_half(sums, at + offsets[radius + 3 + j])
            weight = splat_half(weights[j])
            a += weight * (low_a + high_a)
            b += weight * (low_b + high_b)
            c += weight * (low_c + high_c)
            d += weight * (low_d + high_d)
        store(block, to + i, a)
        store(block, to + i + size, b)
        store(block, to + i + 2 * size, c)
        store(block, to + i + 3 * size, d)


@kernel
def _respond(sums, offsets, stride, weights, length, block, harris_k, scale, out, to, count, largest):
    """`count` rows of the response, out of strands again, one after the other from `to` on."""
    harris_k, scale = splat_half(harris_k), splat_half(scale)
    most = load_half(largest, 0)
    part_size, row_size, width = block.shape[1], _CHUNK * _STRANDS, length * _STRANDS
    for first in range(0, length, _CHUNK):
        for part in range(3):
            _weigh_down(sums, offsets, part * stride + first * _STRANDS, weights, block, part * part_size)
        for i in range(0, count * row_size, _STRANDS):
            a, b, c = load_half(block, i), load_half(block, part_size + i), load_half(block, 2 * part_size + i)
            trace = a + c
            values = ((a * c - b * b) - harris_k * (trace * trace)) * scale
            store(block, i, values)
            most = maximum(values, most)
        for row in range(count):
            for strand in range(0, _STRANDS, 4):
                transpose_floats(block, row * row_size + strand, _STRANDS, out,
                                 to + row * width + strand * length + first, length)
    store(largest, 0, most)
