"""The Harris response with larger box windows, of uint8 images: as long for any window; reference: response.py.

Products of the gradients are summed up along the row from its beginning on, and down the columns of a window by what
comes in less what goes; a window's sum is then the difference of two. One instruction multiplies sixteen gradients and
adds neighbours, so that only half as many sums are summed up: those that end with an odd column. Those that end with an
even one have their last product less. All are whole numbers, and may wrap round, but the windows' do not.
"""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import installed, kernel
from rvc_features.kernels.rows import (
    gradient_buffers,
    next_gradient_parts,
    reflect,
    reflect_ends,
    row_lead,
    row_length,
    running_sums,
    sobel_gradient,
    zeros,
)
from rvc_features.kernels.smallest_box import response_of_sums

if installed:
    from rvc_features.kernels.instructions import expect_to_write
    from rvc_features.kernels.vectors import (
        LANES,
        converted,
        load,
        load_half,
        maximum,
        only_odd,
        products_of_pairs,
        splat_half,
        store,
    )

_INT16, _INT32, _FLOAT32 = np.empty(0, np.int16), np.empty(0, np.int32), np.empty(0, np.float32)


@kernel
def response(image, window_size, harris_k, out, first, last):
    """Fill in the rows from `first` to before `last`; returns the largest value in them."""
    height, width = image.shape
    radius = window_size // 2
    lead, slots = row_lead(radius + 1), min(height, window_size + 1)
    length, end = row_length(width, lead), lead + width + radius + 1
    smoothed, rows, parts = gradient_buffers(width, None, _INT16)
    gradients = zeros((slots + 1) * 2 * length, _INT16).reshape((slots + 1, 2, length))
    nothing = slots   # the last row stays zero: what the first windows have nothing to subtract from
    sums = zeros(3 * length, _INT32)   # of A, B and C, each up to odd columns and up to even ones
    largest, last_responses = np.full(LANES, -np.inf, np.float32), zeros(LANES, _FLOAT32)
    done = begin = max(0, first - radius)
    for y in range(first, last):
        while done <= min(height - 1, y + radius):
            next_gradient_parts(image, done, done == begin, None, smoothed, rows, parts)
            slot = done % slots
            at = slot * 2 * length + lead
            for i in range(0, width, LANES):
                x_gradient, y_gradient = sobel_gradient(parts, i)
                store(gradients, at + i, x_gradient)
                store(gradients, at + length + i, y_gradient)
            for part in range(2):   # beyond the edges products are those of the columns within
                reflect_ends(gradients[slot, part], lead, width, radius)
            done += 1
        if y == first:
            for j in range(-radius, radius + 1):
                _slide(sums, gradients, reflect(y + j, height) % slots, nothing, end)
        else:
            _slide(sums, gradients, reflect(y + radius, height) % slots, reflect(y - 1 - radius, height) % slots, end)
        _responses(sums, length // 2, lead, window_size, harris_k, out, y, largest, last_responses)
    return largest.max()


@kernel
def _slide(sums, gradients, new, old, end):
    """Move the windows down by one row: the products of the new row come in, those of the old one go."""
    length = gradients.shape[2]
    stride = length // 2
    new, old = new * 2 * length, old * 2 * length
    a_before = b_before = c_before = converted(splat_half(np.int16(0)), sums)
    for i in range(0, end, LANES):
        x_new, y_new = load(gradients, new + i), load(gradients, new + length + i)
        x_old, y_old = load(gradients, old + i), load(gradients, old + length + i)
        x_less, x_more, y_less, y_more = x_new - x_old, x_new + x_old, y_new - y_old, y_new + y_old
        at = i // 2
        a_before = _add(sums, at, stride, a_before, products_of_pairs(x_less, x_more),
                        products_of_pairs(only_odd(x_less), x_more))
        b_before = _add(sums, at + 2 * stride, stride, b_before,
                        products_of_pairs(x_new, y_new) - products_of_pairs(x_old, y_old),
                        products_of_pairs(only_odd(x_new), y_new) - products_of_pairs(only_odd(x_old), y_old))
        c_before = _add(sums, at + 4 * stride, stride, c_before, products_of_pairs(y_less, y_more),
                        products_of_pairs(only_odd(y_less), y_more))


@kernel
def _add(sums, at, stride, before, pairs, odd):
    """Add products of eight pairs of columns, and of the odd one of each, to the sums; returns what comes before more.
    """
    total, before = running_sums(before, pairs)
    store(sums, at, load_half(sums, at) + total)
    store(sums, at + stride, load_half(sums, at + stride) + (total - odd))
    return before


@kernel
def _responses(sums, stride, lead, window_size, harris_k, out, y, largest, last_responses):
    """One row of the response."""
    width, radius = out.shape[1], window_size // 2
    scale = np.float32(1 / window_size ** 4)
    harris_k, scale = splat_half(harris_k * scale), splat_half(scale)
    ends = (_place(radius, stride), _place(-radius - 1, stride), _place(radius + 1, stride), _place(-radius, stride))
    most = load(largest, 0)
    whole = width - width % LANES
    for x in range(0, whole, LANES):
        expect_to_write(out, (y + 2) * width + x)
        response = _response(sums, (lead + x) // 2, stride, ends, harris_k, scale)
        store(out, y * width + x, response)
        most = maximum(response, most)
    store(largest, 0, most)
    if whole < width:
        store(last_responses, 0, _response(sums, (lead + whole) // 2, stride, ends, harris_k, scale))
        for x in range(whole, width):
            out[y, x] = last_responses[x - whole]
            largest[0] = max(largest[0], last_responses[x - whole])


@kernel
def _place(column, stride):
    """Where the sums up to that column are, of even column 0."""
    return (column >> 1) + (0 if column & 1 else stride)


@kernel
def _response(sums, at, stride, ends, harris_k, scale):
    a, b, c = _in_windows(sums, at, ends), _in_windows(sums, at + 2 * stride, ends), _in_windows(sums, at + 4 * stride,
                                                                                                 ends)
    return response_of_sums((a[0], a[1], b[0], b[1], c[0], c[1]), harris_k, scale)


@kernel
def _in_windows(sums, at, ends):
    """Of eight even columns, and of eight odd ones."""
    return (load_half(sums, at + ends[0]) - load_half(sums, at + ends[1]),
            load_half(sums, at + ends[2]) - load_half(sums, at + ends[3]))
