"""Local maxima and their position between the pixels; reference: maxima.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import LEAST_WIDTH, in_bands, installed, kernel

if installed:
    from rvc_features.kernels.vectors import LANES, load, lowest_bit, maximum, splat, where_greater, where_not_less

BLOCK_BITS = 5   # blocks are 32 columns wide

# The sixteen pixels on a circle of about four round a pixel, x and y in turn.
AROUND = (4, 0, 4, 2, 3, 3, 2, 4, 0, 4, -2, 4, -3, 3, -4, 2, -4, 0, -4, -2, -3, -3, -2, -4, 0, -4, 2, -4, 3, -3, 4, -2)
SURROUNDINGS = 0.8   # share of their mean that does not count for a pixel
LEAST_RISE = 0.05    # share of a pixel's own value that counts in any case


def local_maxima(response: np.ndarray, minimum: float) -> tuple[np.ndarray, np.ndarray]:
    """Local maxima above `minimum`, x and y in reading order; reference: `maxima.reference_local_maxima`."""
    response = np.ascontiguousarray(response)   # vectors count along its memory
    found = in_bands(lambda first, last: _local_maxima(response, minimum, first, last), *response.shape)
    return found[0] if len(found) == 1 else (np.concatenate([x for x, _ in found]),
                                             np.concatenate([y for _, y in found]))


@kernel
def _local_maxima(response, minimum, first, last):
    """Those in the rows from `first` to before `last`."""
    width = response.shape[1]
    capacity = most_maxima(last - first, width)
    found_x, found_y = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    least = np.full((width >> BLOCK_BITS) + 1, minimum, np.float32)
    count = 0
    for y in range(first, last):
        start = count
        count = maxima_of_row(response, y, 0, width, minimum, least, found_x, count)
        found_y[start:count] = y
    return found_x[:count].copy(), found_y[:count].copy()


@kernel
def most_maxima(height, width):
    """Room for all local maxima in so many pixels: of two neighbours only one can be any; and for one row more."""
    return ((height + 1) // 2) * ((width + 1) // 2) + width


@kernel
def maxima_of_row(response, y, left, right, minimum, least, found, count):
    """Write the columns of a row's maxima, from `left` to before `right`, behind the first `count` of those found.

    They are above `minimum` or, where sixteen are looked at together, above `least` of the block in which the first of
    them lies. Returns how many are found now.
    """
    height, width = response.shape
    by_vectors = 0 < y < height - 1 and right - left >= LEAST_WIDTH
    first, last = (max(left, 1), min(right, width - 1)) if by_vectors else (right, right)
    for x in range(left, first):
        found[count] = x
        count += _is_maximum(response, x, y, minimum)
    for x in range(first, last, LANES):
        begin = min(x, last - LANES)
        at = y * width + begin
        value = load(response, at)
        bits = where_greater(value, splat(least[begin >> BLOCK_BITS]))
        if bits == 0:
            continue
        above, below = at - width, at + width
        before = maximum(maximum(load(response, at - 1), load(response, above - 1)),
                         maximum(load(response, above), load(response, above + 1)))
        after = maximum(maximum(load(response, at + 1), load(response, below - 1)),
                        maximum(load(response, below), load(response, below + 1)))
        bits &= where_greater(value, before) & where_not_less(value, after)
        bits &= -1 << (x - begin)   # the others have been looked at
        while bits != 0:
            found[count] = begin + lowest_bit(bits)
            count += 1
            bits &= bits - 1
    for x in range(last, right):
        found[count] = x
        count += _is_maximum(response, x, y, minimum)
    return count


@kernel
def _is_maximum(response, x, y, minimum):
    height, width = response.shape
    value = response[y, x]
    if not value > minimum:
        return False
    for v in range(max(y - 1, 0), min(y + 2, height)):
        for u in range(max(x - 1, 0), min(x + 2, width)):
            before = v < y or (v == y and u < x)
            if response[v, u] > value or (before and response[v, u] == value):
                return False
    return True


@kernel
def refine(response, x, y):
    """Tops of the quadratics nearest to the 3x3 values; reference: `maxima.reference_refine`."""
    height, width = response.shape
    refined_x, refined_y = np.empty(len(x), np.float64), np.empty(len(x), np.float64)
    for i in range(len(x)):
        u, v = x[i], y[i]
        refined_x[i], refined_y[i] = u, v
        if u <= 0 or u >= width - 1 or v <= 0 or v >= height - 1:
            continue
        middle = np.float64(response[v, u])
        left, right = np.float64(response[v, u - 1]), np.float64(response[v, u + 1])
        above, below = np.float64(response[v - 1, u]), np.float64(response[v + 1, u])
        top_left, top_right = np.float64(response[v - 1, u - 1]), np.float64(response[v - 1, u + 1])
        bottom_left, bottom_right = np.float64(response[v + 1, u - 1]), np.float64(response[v + 1, u + 1])
        on_left, on_right = (top_left + 2 * left + bottom_left) / 4, (top_right + 2 * right + bottom_right) / 4
        on_top, on_bottom = (top_left + 2 * above + top_right) / 4, (bottom_left + 2 * below + bottom_right) / 4
        g_x, g_y = (on_right - on_left) / 2, (on_bottom - on_top) / 2
        s_xx = on_right - 2 * ((above + 2 * middle + below) / 4) + on_left
        s_yy = on_bottom - 2 * ((left + 2 * middle + right) / 4) + on_top
        s_xy = (bottom_right - bottom_left - top_right + top_left) / 4
        determinant = s_xx * s_yy - s_xy * s_xy
        if determinant > 0 and s_xx < 0:
            refined_x[i] += min(max((s_xy * g_y - s_yy * g_x) / determinant, -0.5), 0.5)
            refined_y[i] += min(max((s_xy * g_x - s_xx * g_y) / determinant, -0.5), 0.5)
    return refined_x, refined_y


@kernel
def rise_at(response, x, y):
    """How far a pixel rises above what lies round it; reference: `maxima.rise`."""
    height, width = response.shape
    total = 0.0
    for i in range(0, len(AROUND), 2):
        u, v = min(max(x + AROUND[i], 0), width - 1), min(max(y + AROUND[i + 1], 0), height - 1)
        total += float(response[v, u])
    value = float(response[y, x])
    return max(value - SURROUNDINGS * max(2 * total / len(AROUND), 0.0), LEAST_RISE * value)
