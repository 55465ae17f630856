"""Rows of an image smoothed by binomials, as exactly as their types allow."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import installed, kernel
from rvc_features.kernels.rows import reflect, reflect_ends

if installed:
    from rvc_features.kernels.vectors import (
        LANES,
        converted,
        interleaved_first,
        interleaved_second,
        load,
        products_of_pairs,
        splat,
        store,
    )


@kernel
def smooth_row(image, y, column, lead, smoothed, slot):
    """Row y of the image smoothed by [1 2 1] in both directions."""
    height, width = image.shape
    above, here, below = reflect(y - 1, height) * width, y * width, reflect(y + 1, height) * width
    for i in range(0, width, LANES):
        i = min(i, width - LANES)
        middle = converted(load(image, here + i), column)
        upper = converted(load(image, above + i), column) + middle
        store(column, lead + i, upper + (converted(load(image, below + i), column) + middle))
    reflect_ends(column, lead, width, 1)
    to = slot * smoothed.shape[1]
    for i in range(lead, lead + width, LANES):
        middle = load(column, i)
        store(smoothed, to + i, (load(column, i - 1) + middle) + (load(column, i + 1) + middle))
    reflect_ends(smoothed[slot], lead, width, 1)


@kernel
def widen_columns(smoothed, places, top, weights, known, column, lead, width):
    """Weighted sums down the columns of the smoothed image; `known` is as long as the radius: for the compiler.

    `places` say where rows begin, from that at `top` on the ones that are needed.
    """
    far = len(known)
    for i in range(0, width, LANES):
        total = splat(weights[0]) * converted(load(smoothed, places[top + far] + i), weights)
        for j in range(1, far + 1):
            pair = load(smoothed, places[top + far - j] + i) + load(smoothed, places[top + far + j] + i)
            total += splat(weights[j]) * converted(pair, weights)
        store(column, lead + i, total)


@kernel
def widen_by_pairs(smoothed, places, top, pairs, known, column, lead, width):
    """`widen_columns` of int16, two products at a time."""
    far = len(known)
    for i in range(0, width, LANES):
        inner = load(smoothed, places[top + far] + i)
        outer = load(smoothed, places[top + far - 1] + i) + load(smoothed, places[top + far + 1] + i)
        first = products_of_pairs(interleaved_first(inner, outer), load(pairs, 0))
        second = products_of_pairs(interleaved_second(inner, outer), load(pairs, 0))
        for j in range(2, far + 1, 2):
            last = min(j + 1, far)
            inner = load(smoothed, places[top + far - j] + i) + load(smoothed, places[top + far + j] + i)
            outer = load(smoothed, places[top + far - last] + i) + load(smoothed, places[top + far + last] + i)
            weights = load(pairs, j // 2 * LANES)
            first += products_of_pairs(interleaved_first(inner, outer), weights)
            second += products_of_pairs(interleaved_second(inner, outer), weights)
        store(column, lead + i, first)
        store(column, lead + i + LANES // 2, second)


@kernel
def widen_row(column, weights, known, lead, width, wide, slot):
    """Weighted sums along the row of what was smoothed down the columns."""
    far = len(known)
    reflect_ends(column, lead, width, far)
    to = slot * wide.shape[1]
    for i in range(lead, lead + width, LANES):
        total = splat(weights[0]) * load(column, i)
        for j in range(1, far + 1):
            total += splat(weights[j]) * (load(column, i - j) + load(column, i + j))
        store(wide, to + i, total)
    reflect_ends(wide[slot], lead, width, 1)


def in_pairs(further: np.ndarray) -> np.ndarray:
    """Weights from the centre outwards, two in turn in each row of sixteen; a 0 follows the last where it is alone."""
    weights = np.append(further, 0)[:len(further) + len(further) % 2]
    return np.tile(weights.astype(np.int16).reshape(-1, 2), LANES // 2)
