"""Images at half their size, and rows at twice theirs."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import installed, kernel
from rvc_features.kernels.rows import reflect, reflect_ends, row_lead, row_length, zeros

if installed:
    from rvc_features.kernels.vectors import (
        LANES,
        converted,
        evens,
        interleaved_first,
        interleaved_second,
        load,
        maximum,
        odds,
        splat,
        store,
    )

# Weights of the two nearest pixels, of the two beyond these, and of the two beyond those.
_NEAR, _NEXT, _FAR = np.float32(39 / 64), np.float32(-9 / 64), np.float32(2 / 64)


@kernel
def halve(image, column_weights, row_weights, known, scale, base, half, first, last):
    """Rows of the smoothed image at half its size: the weighted sum down the columns, then of every second pixel.

    Weights begin at the centre; `known` is a tuple of as many as follow, for its length tells the compiler. `base`
    is a grey value that is subtracted.
    """
    height, width = image.shape
    half_width, radius = half.shape[1], len(known)
    whole = row_weights.sum() + row_weights[1:].sum()
    base_sum = row_weights.dtype.type(np.rint(base * whole * whole))   # whole, so that sums of whole numbers stay so
    lead = row_lead(radius)
    length = row_length(width, lead) + 2 * LANES
    column = zeros(length, column_weights)
    even, odd = zeros(length, row_weights), zeros(length, row_weights)   # from `radius` before the first pixel on
    offsets = np.empty(2 * radius + 1, np.int64)
    for y in range(first, last):
        for j in range(2 * radius + 1):
            offsets[j] = reflect(2 * y - radius + j, height) * width
        for i in range(0, width, LANES):
            i = min(i, width - LANES)
            total = splat(column_weights[0]) * converted(load(image, offsets[radius] + i), column)
            for j in range(1, radius + 1):
                above = converted(load(image, offsets[radius - j] + i), column)
                below = converted(load(image, offsets[radius + j] + i), column)
                total += splat(column_weights[j]) * (above + below)
            store(column, lead + i, total)
        reflect_ends(column, lead, width, radius)
        for i in range(0, half_width + radius, LANES):
            at = lead - radius + 2 * i
            first_half, second_half = load(column, at), load(column, at + LANES)
            store(even, i, converted(evens(first_half, second_half), even))
            store(odd, i, converted(odds(first_half, second_half), odd))
        for i in range(0, half_width, LANES):
            i = min(i, half_width - LANES)
            middle = i + radius // 2
            along = splat(row_weights[0]) * load(even, middle)
            for j in range(2, radius + 1, 2):
                along += splat(row_weights[j]) * (load(even, middle - j // 2) + load(even, middle + j // 2))
            for j in range(1, radius + 1, 2):
                along += splat(row_weights[j]) * (load(odd, middle - (j + 1) // 2) + load(odd, middle + j // 2))
            store(half, y * half_width + i, (along - splat(base_sum)) * splat(scale))


@kernel
def enlarge_row(coarse, y, enlarged, lead, width):
    """Row y of the coarse response at twice its size, by (2 -9 39 39 -9 2) / 64 between its pixels."""
    height, length = coarse.shape
    half_width, row = (width + 1) // 2, enlarged[1]
    zero, above = splat(np.float32(0)), y // 2
    here = above * length + LANES
    if y % 2 == 0:
        for i in range(0, half_width, LANES):
            store(row, lead + i, load(coarse, here + i))
    else:   # no list of rows: it would take as long as a hundred pixels
        first, second = max(above - 2, 0) * length + LANES, max(above - 1, 0) * length + LANES
        fourth, fifth = min(above + 1, height - 1) * length + LANES, min(above + 2, height - 1) * length + LANES
        sixth = min(above + 3, height - 1) * length + LANES
        for i in range(0, half_width, LANES):
            store(row, lead + i, _between(load(coarse, first + i), load(coarse, second + i), load(coarse, here + i),
                                          load(coarse, fourth + i), load(coarse, fifth + i), load(coarse, sixth + i)))
    end = lead + half_width
    for j in range(3):
        row[lead - 1 - j], row[end + j] = row[lead], row[end - 1]
    for i in range(0, half_width, LANES):
        at = lead + i
        value = load(row, at)
        between = _between(load(row, at - 2), load(row, at - 1), value, load(row, at + 1), load(row, at + 2),
                           load(row, at + 3))
        value, between = maximum(value, zero), maximum(between, zero)
        store(enlarged, lead + 2 * i, interleaved_first(value, between))
        store(enlarged, lead + 2 * i + LANES, interleaved_second(value, between))


@kernel
def _between(far_before, next_before, before, after, next_after, far_after):
    """What lies in the middle between six numbers."""
    value = splat(_NEAR) * (before + after) + splat(_NEXT) * (next_before + next_after)
    return value + splat(_FAR) * (far_before + far_after)
