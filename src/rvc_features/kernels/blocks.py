"""Blocks of fourteen columns in four rows of an image: which can have a corner, and their response; see corners.py.

Of the sixteen gradients in a vector fourteen have both neighbours in it.
"""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import installed, kernel
from rvc_features.kernels.smallest_box import response_of_sums

if installed:
    from rvc_features.kernels.instructions import with_next
    from rvc_features.kernels.vectors import (
        LANES,
        converted,
        distance,
        load,
        load_double,
        lowest_bit,
        maximum,
        mean_rounded_up,
        only_even,
        only_odd,
        products_of_pairs,
        splat,
        splat_double,
        splat_half,
        store,
        to_float32,
        where_greater,
        where_not_less,
        widened,
    )

ROWS = 4         # of a block
COLUMNS = 14     # of a block
START = 32       # where rows begin in buffers of the image's width
_TOGETHER = 8    # blocks: few enough for their gradients to stay in the nearest cache
GRADIENTS = (_TOGETHER + 1) * 16   # columns of them, with room to read beyond
INSIDE = (1 << COLUMNS) - 1   # the bits of a comparison that are of a block


@kernel
def steepest_gradients(pixels, lines, left, right, steepest):
    """Steepest gradients in x and in y of each column in six rows, in grey values, less the 3/4 lost by rounding.

    Those of the first two rows are there: they are the last two of the rows before.
    """
    length = len(steepest) // 4
    for x in range(left, right, 2 * LANES):
        at = START + x
        row_2, row_3 = _smoothed_along(pixels, lines[2] + x), _smoothed_along(pixels, lines[3] + x)
        row_4, row_5 = _smoothed_along(pixels, lines[4] + x), _smoothed_along(pixels, lines[5] + x)
        steep = _steeper(_gradient(row_2, row_3, row_4), _gradient(row_3, row_4, row_5))
        steep = _steeper(steep, (load_double(steepest, 2 * length + at), load_double(steepest, 3 * length + at)))
        row_6, row_7 = _smoothed_along(pixels, lines[6] + x), _smoothed_along(pixels, lines[7] + x)
        last = _steeper(_gradient(row_4, row_5, row_6), _gradient(row_5, row_6, row_7))
        store(steepest, 2 * length + at, last[0])
        store(steepest, 3 * length + at, last[1])
        steep = _steeper(steep, last)
        store(steepest, at, steep[0])
        store(steepest, length + at, steep[1])


@kernel
def steepest_of_first_pair(pixels, lines, left, right, steepest):
    """The same of the first two rows, where no rows are before."""
    length = len(steepest) // 4
    for x in range(left, right, 2 * LANES):
        row_0, row_1 = _smoothed_along(pixels, lines[0] + x), _smoothed_along(pixels, lines[1] + x)
        row_2, row_3 = _smoothed_along(pixels, lines[2] + x), _smoothed_along(pixels, lines[3] + x)
        steep = _steeper(_gradient(row_0, row_1, row_2), _gradient(row_1, row_2, row_3))
        store(steepest, 2 * length + START + x, steep[0])
        store(steepest, 3 * length + START + x, steep[1])


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
def note_promising(steepest, left, right, limit, blocks):
    """Note the first columns of blocks that have all columns where a product of steepest gradients reaches `limit`.

    Returns how many there are.
    """
    count, limits, y_part, free = 0, splat_double(limit), len(steepest) // 4, left
    for x in range(left, right, 2 * LANES):
        steep_x = converted(_largest_of_three(steepest, START + x), limits)
        steep_y = converted(_largest_of_three(steepest, y_part + START + x), limits)
        # (s + 1) (t + 1) - 1: one grey value makes up for what was lost, but 256 by 256 would be too large.
        bits = where_not_less(steep_x * steep_y + (steep_x + steep_y), limits)
        bits &= ((1 << min(right - x, 2 * LANES)) - 1) & (-1 << max(free - x, 0))
        while bits != 0:
            free = x + lowest_bit(bits)
            blocks[count] = free
            count += 1
            free += COLUMNS
            bits &= -1 << (free - x)
    return count


@kernel
def _largest_of_three(numbers, at):
    return maximum(load_double(numbers, at), maximum(load_double(numbers, at - 1), load_double(numbers, at + 1)))


@kernel
def responses_of_blocks(pixels, lines, blocks, width, gradients, rows, harris_k, bound, responses, to, length, above):
    """Responses of blocks, where any exceeds the bound; notes these, returns how many.

    A few blocks at a time: first the gradients, packed together, then the responses.
    """
    found = 0
    for begin in range(0, len(blocks), _TOGETHER):
        end = min(begin + _TOGETHER, len(blocks))
        for i in range(begin, end):
            x, at = blocks[i], 1 + LANES * (i - begin)   # vectors of gradients begin a column before their block
            _gradients(pixels, lines, x - 1, gradients, at - 1)
            if x == 0 or x + COLUMNS >= width:   # the border reflects
                for start in range(at, len(gradients), GRADIENTS):
                    if x == 0:
                        gradients[start - 1] = gradients[start + 1]
                    if x + COLUMNS >= width:
                        gradients[start + width - x] = gradients[start + width - x - 2]
        for i in range(begin, end):
            x, at = blocks[i], 1 + LANES * (i - begin)
            if (_can_exceed(gradients, rows, at, harris_k, bound)
                    and _responses_of_block(gradients, rows, at, harris_k, bound, responses, to + START + x, length)):
                above[found] = x
                found += 1
    return found


@kernel
def _can_exceed(gradients, rows, at, harris_k, bound):
    """Whether H of a block can exceed the bound, by sums of the gradients' products over squares of 4x4.

    Each square holds the 3x3 of four pixels, so that neither A, C nor A C - B^2 of these is more than its own.
    """
    above, middle = _pairs_of_two(gradients, rows[0] + at, rows[1] + at), _pairs_of_two(gradients, rows[2] + at,
                                                                                         rows[3] + at)
    below = _pairs_of_two(gradients, rows[4] + at, rows[5] + at)
    of_determinant, least = splat_half(np.float32(1 - 4 * harris_k)), splat_half(np.float32(81 * (1 - 1e-6) * bound))
    most = maximum(_most(above[0] + middle[0], above[1] + middle[1], above[2] + middle[2], of_determinant),
                   _most(middle[0] + below[0], middle[1] + below[1], middle[2] + below[2], of_determinant))
    return where_greater(most, least) != 0


@kernel
def _pairs_of_two(gradients, first, second):
    """Products of the gradients, summed over pairs of neighbours in two rows; the first is the one before the block."""
    x, y = load(gradients, first - 1), load(gradients, first - 1 + GRADIENTS)
    u, v = load(gradients, second - 1), load(gradients, second - 1 + GRADIENTS)
    return (products_of_pairs(x, x) + products_of_pairs(u, u), products_of_pairs(x, y) + products_of_pairs(u, v),
            products_of_pairs(y, y) + products_of_pairs(v, v))


@kernel
def _most(a, b, c, of_determinant):
    """(1 - 4 k) (A C - B^2) of every two pairs, and a little more, for what rounding may add to a response."""
    a, b, c = to_float32(with_next(a)), to_float32(with_next(b)), to_float32(with_next(c))
    product = a * c
    return (product - b * b) * of_determinant + product * splat_half(np.float32(4e-6))


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
    """Responses of a block, if any exceeds the bound; returns whether one does."""
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
    if where_greater(most, splat(bound)) & INSIDE == 0:
        return False
    store(responses, to, response_0)
    store(responses, to + length, response_1)
    store(responses, to + 2 * length, response_2)
    store(responses, to + 3 * length, response_3)
    for row in range(ROWS):
        for column in range(COLUMNS, LANES):   # of the next block, which comes later
            responses[to + row * length + column] = -np.inf
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
