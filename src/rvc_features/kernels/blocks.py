"""Blocks of sixteen columns in four rows of an image: which can have a corner, and their response; see corners.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import installed, kernel
from rvc_features.kernels.smallest_box import response_of_sums

if installed:
    from rvc_features.kernels.vectors import (
        LANES,
        converted,
        distance,
        load,
        load_double,
        maximum,
        mean_rounded_up,
        only_even,
        only_odd,
        products_of_pairs,
        splat,
        splat_double,
        splat_half,
        store,
        where_greater,
        where_not_less,
        widened,
    )

ROWS = 4         # of a block
START = 32       # where rows begin in buffers of the image's width
_TOGETHER = 8    # blocks: few enough for their gradients to stay in the nearest cache
GRADIENTS = (2 * _TOGETHER + 1) * 16   # columns of them at the most


@kernel
def steepest_gradients(pixels, lines, width, steepest):
    """Steepest gradients in x and in y of each column in six rows, in grey values, less the 3/4 lost by rounding."""
    y_part = len(steepest) // 2
    for x in range(0, width, 2 * LANES):
        row_0, row_1 = _smoothed_along(pixels, lines[0] + x), _smoothed_along(pixels, lines[1] + x)
        row_2, row_3 = _smoothed_along(pixels, lines[2] + x), _smoothed_along(pixels, lines[3] + x)
        steep = _gradient(row_0, row_1, row_2)
        steep = _steeper(steep, _gradient(row_1, row_2, row_3))
        row_4, row_5 = _smoothed_along(pixels, lines[4] + x), _smoothed_along(pixels, lines[5] + x)
        steep = _steeper(steep, _gradient(row_2, row_3, row_4))
        steep = _steeper(steep, _gradient(row_3, row_4, row_5))
        row_6, row_7 = _smoothed_along(pixels, lines[6] + x), _smoothed_along(pixels, lines[7] + x)
        steep = _steeper(steep, _gradient(row_4, row_5, row_6))
        steep = _steeper(steep, _gradient(row_5, row_6, row_7))
        store(steepest, START + x, steep[0])
        store(steepest, y_part + START + x, steep[1])


@kernel
def _gradient(above, here, below):
    left = mean_rounded_up(mean_rounded_up(above[0], below[0]), here[0])
    right = mean_rounded_up(mean_rounded_up(above[2], below[2]), here[2])
    return distance(left, right), distance(above[1], below[1])


@kernel
def _steeper(a, b):
    return maximum(a[0], b[0]), maximum(a[1], b[1])


@kernel
def _smoothed_along(pixels, at):
    """Pixels to the left, their means with weights 1 2 1 along the row, and pixels to the right."""
    left, right = load_double(pixels, at - 1), load_double(pixels, at + 1)
    return left, mean_rounded_up(mean_rounded_up(left, right), load_double(pixels, at)), right


@kernel
def note_promising(steepest, width, limit, blocks):
    """Note the blocks of sixteen columns where a product of steepest gradients reaches `limit`; returns how many."""
    count, limits, y_part = 0, splat_double(limit), len(steepest) // 2
    for x in range(0, width, 2 * LANES):
        steep_x = converted(_largest_of_three(steepest, START + x), limits)
        steep_y = converted(_largest_of_three(steepest, y_part + START + x), limits)
        # (s + 1) (t + 1) - 1: one grey value makes up for what was lost, but 256 by 256 would be too large.
        bits = where_not_less(steep_x * steep_y + (steep_x + steep_y), limits)
        blocks[count] = x // LANES
        count += (bits & ((1 << LANES) - 1)) != 0
        blocks[count] = x // LANES + 1
        count += bits >> LANES != 0
    return count


@kernel
def _largest_of_three(numbers, at):
    return maximum(load_double(numbers, at), maximum(load_double(numbers, at - 1), load_double(numbers, at + 1)))


@kernel
def responses_of_blocks(pixels, lines, blocks, width, gradients, rows, harris_k, bound, responses, to, length, above):
    """Responses of blocks of sixteen columns in four rows, where any exceeds the bound; notes these, returns how many.

    A few blocks at a time: first the gradients, packed together, then the responses.
    """
    found = 0
    for begin in range(0, len(blocks), _TOGETHER):
        end = min(begin + _TOGETHER, len(blocks))
        at, known = 1, -1   # vectors of gradients begin a column before their block
        for i in range(begin, end):
            block = blocks[i]
            if block != known:
                _gradients(pixels, lines, LANES * block - 1, gradients, at - 1)
            at += LANES
            _gradients(pixels, lines, LANES * block + LANES - 1, gradients, at - 1)
            if block == 0 or LANES * (block + 1) >= width:   # the border reflects
                left, right = at - LANES, at + width - 1 - LANES * (block + 1)
                for start in range(0, len(gradients), GRADIENTS):
                    if block == 0:
                        gradients[start + left - 1] = gradients[start + left + 1]
                    if LANES * (block + 1) >= width:
                        gradients[start + right + 1] = gradients[start + right - 1]
            known = block + 1
            if i + 1 < end and blocks[i + 1] != known:
                at += LANES
        at, known = 1, blocks[begin]
        for i in range(begin, end):
            block = blocks[i]
            if block != known:
                at += LANES
            if _responses_of_block(gradients, rows, at, harris_k, bound, responses, to + START + LANES * block,
                                   length):
                above[found] = block
                found += 1
            at += LANES
            known = block + 1
    return found


@kernel
def _gradients(pixels, lines, x, gradients, at):
    """Sobel gradients of sixteen columns from x on in six rows."""
    across_0, along_0 = _parts_along(pixels, lines[0] + x)
    across_1, along_1 = _parts_along(pixels, lines[1] + x)
    for i in range(2, ROWS + 4):
        across_2, along_2 = _parts_along(pixels, lines[i] + x)
        store(gradients, at, (across_0 + across_2) + (across_1 + across_1))
        store(gradients, at + GRADIENTS, along_2 - along_0)
        at += 2 * GRADIENTS
        across_0, along_0, across_1, along_1 = across_1, along_1, across_2, along_2


@kernel
def _parts_along(pixels, at):
    """Differences -1 0 1 and sums 1 2 1 of sixteen pixels from `at` on."""
    before, here = widened(load(pixels, at - 1)), widened(load(pixels, at))
    after = widened(load(pixels, at + 1))
    return after - before, (before + after) + (here + here)


@kernel
def _responses_of_block(gradients, rows, at, harris_k, bound, responses, to, length):
    """Responses of sixteen columns in four rows, if any exceeds the bound; returns whether one does."""
    scale = np.float32(1 / 81)
    harris_k, scale = splat_half(harris_k * scale), splat_half(scale)
    sums_0 = _sums_along_the_row(gradients, rows[0] + at, rows[0] + GRADIENTS + at)
    sums_1 = _sums_along_the_row(gradients, rows[1] + at, rows[1] + GRADIENTS + at)
    sums_2 = _sums_along_the_row(gradients, rows[2] + at, rows[2] + GRADIENTS + at)
    pairs = _added(sums_1, sums_2)
    response_0 = response_of_sums(_added(sums_0, pairs), harris_k, scale)
    sums_3 = _sums_along_the_row(gradients, rows[3] + at, rows[3] + GRADIENTS + at)
    response_1 = response_of_sums(_added(pairs, sums_3), harris_k, scale)
    sums_4 = _sums_along_the_row(gradients, rows[4] + at, rows[4] + GRADIENTS + at)
    pairs = _added(sums_3, sums_4)
    response_2 = response_of_sums(_added(sums_2, pairs), harris_k, scale)
    sums_5 = _sums_along_the_row(gradients, rows[5] + at, rows[5] + GRADIENTS + at)
    response_3 = response_of_sums(_added(pairs, sums_5), harris_k, scale)
    most = maximum(maximum(response_0, response_1), maximum(response_2, response_3))
    if where_greater(most, splat(bound)) == 0:
        return False
    store(responses, to, response_0)
    store(responses, to + length, response_1)
    store(responses, to + 2 * length, response_2)
    store(responses, to + 3 * length, response_3)
    return True


@kernel
def _sums_along_the_row(gradients, x, y):
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
def _added(a, b):
    """Sums of six and six half vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]
