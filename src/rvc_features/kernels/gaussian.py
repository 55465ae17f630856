"""The Harris response with the Gaussian window, of uint8 images; reference: response.py.

A block of columns after the other and four rows at a time, so that all but the image stays in the nearest cache. From
bytes to responses every fourth pixel of a row is kept together, so that a vector holds eight that are four apart, and
their neighbours are vectors of the other three classes: four sums of seven neighbours along a row take ten vectors, as
those of four rows down the columns do, and of these ten only six lie in odd places. Of both, what lies left and right,
or above and below, is added before it is weighed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rvc_features.kernels.compiler import installed, kernel
from rvc_features.kernels.rows import reflect, zeros

if installed:
    from rvc_features.kernels.instructions import (
        SCALE,
        all_written,
        element,
        even_bytes,
        expect_to_read,
        expect_to_write,
        odd_bytes,
        scaled_evens,
        scaled_odds,
        store_in_turn,
        stream_in_turn,
    )
    from rvc_features.kernels.vectors import (
        LANES,
        load,
        load_double,
        load_half,
        maximum,
        splat_half,
        store,
    )

LEAST_WIDTH = 32   # pixels: four vectors, which are worked on at once
_PIXELS = 32
_EIGHT = 8   # numbers of a vector
_ROWS = 4   # of the response, at once
_BLOCK = 160   # columns
_LARGEST_LEAD = 24   # columns before a block that are looked at: the radius of the largest window, and one
_CLASS = -(-(_BLOCK + 2 * _LARGEST_LEAD) // _PIXELS) * _EIGHT   # every fourth pixel of a block
_CHANNEL = 4 * _CLASS   # products of one kind, of a row
_LINE = _BLOCK + 2 * _LARGEST_LEAD + 4 * _PIXELS   # of the image
_LINES = 8   # kept at once: a power of two


def arguments(taps: np.ndarray, harris_k: float) -> tuple[np.ndarray, Any, np.float32, np.float32]:
    """Those of `response` that do not depend on the image.

    `taps` are the window's weights from its centre outwards. Here the first is one, and what that makes of H is undone.
    Zeros follow up to a multiple of four.
    """
    weights = np.zeros(-(-len(taps) // 4) * 4, np.float32)
    weights[:len(taps)] = taps / taps[0]
    further = () if len(weights) == 4 else np.empty(len(weights) // 4 - 1, np.uint8)
    scale = np.float32(taps[0] ** 4 / SCALE ** 4)
    return weights, further, np.float32(harris_k * scale), scale


@kernel
def response(weights, further, harris_k, scale, image, out, streamed, first, last):
    """Fill in the rows from `first` to before `last`; returns the largest value in them.

    `further` is as long as there are weights in fours after the first four: for the compiler, if there are none.
    """
    height, width = image.shape
    lead = len(weights)   # columns before a block: the radius, and one for the gradient
    radius = lead - 1
    slots = 2 * radius + 6   # of rows of sums, of which four are made at a time
    base = first - radius - 2
    places = np.empty(-(-(last - first) // _ROWS) * _ROWS + 2 * radius + 2, np.int64)
    for j in range(len(places)):   # of the sums of the row base + j
        places[j] = (reflect(base + j, height) - base) % slots * 3 * _BLOCK
    lines = zeros(_LINES * _LINE + _PIXELS, image)
    products = zeros(_ROWS * 3 * _CHANNEL, weights)
    sums = zeros(slots * 3 * _BLOCK, weights)
    largest = np.full(_EIGHT, -np.inf, np.float32)
    block = min(_BLOCK, width // _PIXELS * _PIXELS)
    for start in range(0, width, block):
        size = min(block, -(-(width - start) // _PIXELS) * _PIXELS)
        start = min(start, width - size)   # the last block repeats some of the one before it
        to = 0
        is_read = base - 1
        for done in range(base, base + len(places) - 2, _ROWS):
            if done + _ROWS > 0:   # else all of them lie above the image
                _read_rows(image, max(is_read, done - 1), done + _ROWS + 1, start - lead, size + 2 * lead, lines)
                is_read = done + _ROWS + 1
                _multiply(lines, done - 1, size + 2 * lead, products)
                _change_signs(products, start - lead, size + 2 * lead, width)
                _weigh_along(products, weights, further, size, sums, to)
            to = (to + _ROWS * 3 * _BLOCK) % len(sums)
            y = done - radius
            if y >= first:
                _weigh_down(sums, places, y - base - radius, weights, further, products)
                _respond(products, size, harris_k, scale, out, streamed, y, min(_ROWS, last - y), start, largest)
    all_written()
    return largest.max()


@kernel
def _read_rows(image, first, last, x, count, lines):
    """`count` pixels of each row from x on, and as many on either side as gradients and vectors reach for."""
    height, width = image.shape
    for y in range(first, last):
        to, row = (y & _LINES - 1) * _LINE + _PIXELS, reflect(y, height)
        if x >= LANES and x + count + 2 * LANES <= width:
            for i in range(-LANES, count + LANES, 2 * LANES):
                expect_to_read(image, (row + _ROWS) * width + x + i)
                store(lines, to + i, load_double(image, row * width + x + i))
        else:
            for i in range(-LANES, count + LANES, LANES):
                if 0 <= x + i <= width - LANES:
                    store(lines, to + i, load(image, row * width + x + i))
                else:
                    for j in range(i, i + LANES):
                        lines[to + j] = image[row, reflect(x + j, width)]


@kernel
def _multiply(lines, above, count, products):
    """Products of the gradients of the four rows after that one: I_x^2, I_x I_y, I_y^2, times `SCALE` squared."""
    for x in range(0, count, _PIXELS):
        row, next_row = above & _LINES - 1, above + 1 & _LINES - 1
        even_0, odd_0, even_sum_0, odd_sum_0 = _along_the_row(lines, row * _LINE + _PIXELS + x)
        even_1, odd_1, even_sum_1, odd_sum_1 = _along_the_row(lines, next_row * _LINE + _PIXELS + x)
        even_pair, odd_pair = even_0 + even_1, odd_0 + odd_1
        for to in range(x // 4, x // 4 + _ROWS * 3 * _CHANNEL, 3 * _CHANNEL):
            next_row = next_row + 1 & _LINES - 1
            even_2, odd_2, even_sum_2, odd_sum_2 = _along_the_row(lines, next_row * _LINE + _PIXELS + x)
            next_even_pair, next_odd_pair = even_1 + even_2, odd_1 + odd_2
            even_x, even_y = even_pair + next_even_pair, even_sum_2 - even_sum_0
            odd_x, odd_y = odd_pair + next_odd_pair, odd_sum_2 - odd_sum_0
            _store_products(scaled_evens(even_x), scaled_evens(even_y), products, to)
            _store_products(scaled_evens(odd_x), scaled_evens(odd_y), products, to + _CLASS)
            _store_products(scaled_odds(even_x), scaled_odds(even_y), products, to + 2 * _CLASS)
            _store_products(scaled_odds(odd_x), scaled_odds(odd_y), products, to + 3 * _CLASS)
            even_1, odd_1, even_pair, odd_pair = even_2, odd_2, next_even_pair, next_odd_pair
            even_sum_0, odd_sum_0, even_sum_1, odd_sum_1 = even_sum_1, odd_sum_1, even_sum_2, odd_sum_2


@kernel
def _along_the_row(lines, at):
    """Differences -1 0 1 of the even pixels of 32 and of the odd ones, and sums 1 2 1 of both."""
    here, before, after = load_double(lines, at), load_double(lines, at - 2), load_double(lines, at + 2)
    even, odd, odd_before, even_after = even_bytes(here), odd_bytes(here), odd_bytes(before), even_bytes(after)
    pair = even + odd
    return odd - odd_before, even_after - even, (odd_before + even) + pair, pair + (odd + even_after)


@kernel
def _store_products(x_gradient, y_gradient, products, to):
    store(products, to, x_gradient * x_gradient)
    store(products, to + _CHANNEL, x_gradient * y_gradient)
    store(products, to + 2 * _CHANNEL, y_gradient * y_gradient)


@kernel
def _change_signs(products, x, count, width):
    """Outside the image, products are those of the mirror image, but the gradient in x is not: I_x I_y changes sign."""
    for first, last in ((0, -x), (width - x, count)):
        for i in range(first, last):
            for at in range(_CHANNEL + i % 4 * _CLASS + i // 4, _ROWS * 3 * _CHANNEL, 3 * _CHANNEL):
                products[at] = -products[at]


@kernel
def _weigh_along(products, weights, further, size, sums, to):
    """Weighted sums along four rows, of three kinds of products; `to` is where those of the first row go."""
    lead = len(weights) // 4
    one, two, three = splat_half(weights[1]), splat_half(weights[2]), splat_half(weights[3])
    for channel in range(lead, lead + _ROWS * 3 * _CHANNEL, _CHANNEL):
        for i in range(0, size, _PIXELS):
            at = channel + i // 4
            before, after = at - 1, at + 1
            low = (load_half(products, before + _CLASS), load_half(products, before + 2 * _CLASS),
                   load_half(products, before + 3 * _CLASS))
            high = (load_half(products, after), load_half(products, after + _CLASS),
                    load_half(products, after + 2 * _CLASS))
            middle = (load_half(products, at), load_half(products, at + _CLASS), load_half(products, at + 2 * _CLASS),
                      load_half(products, at + 3 * _CLASS))
            total = _first_sums(low + middle + high, one, two, three)
            for j in range(1, 1 + len(further)):
                before, after = at - j - 1, at + j
                next_low = (load_half(products, before + _CLASS), load_half(products, before + 2 * _CLASS),
                            load_half(products, before + 3 * _CLASS), load_half(products, before + 1))
                next_high = (load_half(products, after + 3 * _CLASS), load_half(products, after + 1),
                             load_half(products, after + 1 + _CLASS), load_half(products, after + 1 + 2 * _CLASS))
                total = _further_sums(total, next_low + low, high + next_high, weights, 4 * j)
                low, high = (next_low[0], next_low[1], next_low[2]), (next_high[1], next_high[2], next_high[3])
            for k in range(4):
                store(sums, to + i + k * _EIGHT, total[k])
        to += _BLOCK


@kernel
def _weigh_down(sums, places, first, weights, further, out):
    """The same down the columns, for four rows of a block; `first` is the place of the first row that is weighed."""
    middle = first + len(weights) - 4
    row_0, row_1, row_2 = element(places, middle), element(places, middle + 1), element(places, middle + 2)
    row_3, row_4, row_5 = element(places, middle + 3), element(places, middle + 4), element(places, middle + 5)
    row_6, row_7, row_8 = element(places, middle + 6), element(places, middle + 7), element(places, middle + 8)
    row_9 = element(places, middle + 9)
    one, two, three = splat_half(weights[1]), splat_half(weights[2]), splat_half(weights[3])
    for i in range(0, 3 * _BLOCK, _EIGHT):
        low = load_half(sums, row_0 + i), load_half(sums, row_1 + i), load_half(sums, row_2 + i)
        high = load_half(sums, row_7 + i), load_half(sums, row_8 + i), load_half(sums, row_9 + i)
        inner = (load_half(sums, row_3 + i), load_half(sums, row_4 + i), load_half(sums, row_5 + i),
                 load_half(sums, row_6 + i))
        total = _first_sums(low + inner + high, one, two, three)
        for j in range(1, 1 + len(further)):
            above, below = middle - 4 * j, middle + 6 + 4 * j
            next_low = (load_half(sums, element(places, above) + i), load_half(sums, element(places, above + 1) + i),
                        load_half(sums, element(places, above + 2) + i),
                        load_half(sums, element(places, above + 3) + i))
            next_high = (load_half(sums, element(places, below) + i), load_half(sums, element(places, below + 1) + i),
                         load_half(sums, element(places, below + 2) + i),
                         load_half(sums, element(places, below + 3) + i))
            total = _further_sums(total, next_low + low, high + next_high, weights, 4 * j)
            low, high = (next_low[0], next_low[1], next_low[2]), (next_high[1], next_high[2], next_high[3])
        for row in range(_ROWS):
            store(out, 3 * _BLOCK * row + i, total[row])


@kernel
def _first_sums(x, one, two, three):
    """Of ten neighbours: sums of seven round each of the four in the middle, with these weights one to three away."""
    return (x[3] + one * (x[2] + x[4]) + two * (x[1] + x[5]) + three * (x[0] + x[6]),
            x[4] + one * (x[3] + x[5]) + two * (x[2] + x[6]) + three * (x[1] + x[7]),
            x[5] + one * (x[4] + x[6]) + two * (x[3] + x[7]) + three * (x[2] + x[8]),
            x[6] + one * (x[5] + x[7]) + two * (x[4] + x[8]) + three * (x[3] + x[9]))


@kernel
def _further_sums(sums, low, high, weights, j):
    """These sums with four weights more, from j on, of the seven neighbours from j + 3 before and from j after."""
    zero, one = splat_half(element(weights, j)), splat_half(element(weights, j + 1))
    two, three = splat_half(element(weights, j + 2)), splat_half(element(weights, j + 3))
    return (sums[0] + zero * (low[3] + high[0]) + one * (low[2] + high[1]) + two * (low[1] + high[2])
            + three * (low[0] + high[3]),
            sums[1] + zero * (low[4] + high[1]) + one * (low[3] + high[2]) + two * (low[2] + high[3])
            + three * (low[1] + high[4]),
            sums[2] + zero * (low[5] + high[2]) + one * (low[4] + high[3]) + two * (low[3] + high[4])
            + three * (low[2] + high[5]),
            sums[3] + zero * (low[6] + high[3]) + one * (low[5] + high[4]) + two * (low[4] + high[5])
            + three * (low[3] + high[6]))


@kernel
def _respond(sums, size, harris_k, scale, out, streamed, y, count, start, largest):
    """`count` rows of the response in a block of columns."""
    width = out.shape[1]
    harris_k, scale = splat_half(harris_k), splat_half(scale)
    most = load_half(largest, 0)
    for row in range(count):
        at, to = 3 * _BLOCK * row, (y + row) * width + start
        for i in range(0, size, _PIXELS):
            a, b = _harris(sums, at + i, harris_k, scale), _harris(sums, at + i + _EIGHT, harris_k, scale)
            c = _harris(sums, at + i + 2 * _EIGHT, harris_k, scale)
            d = _harris(sums, at + i + 3 * _EIGHT, harris_k, scale)
            most = maximum(d, maximum(c, maximum(b, maximum(a, most))))
            if streamed:
                stream_in_turn(out, to + i, a, b, c, d)
            else:
                expect_to_write(out, to + _ROWS * width + i)
                expect_to_write(out, to + _ROWS * width + i + LANES)
                store_in_turn(out, to + i, a, b, c, d)
    store(largest, 0, most)


@kernel
def _harris(sums, at, harris_k, scale):
    a, b, c = load_half(sums, at), load_half(sums, at + _BLOCK), load_half(sums, at + 2 * _BLOCK)
    trace = a + c
    return (a * c - b * b) * scale - (trace * harris_k) * trace
