"""Rows of an image on their way through a kernel: buffers, borders, smoothing, gradients."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import installed, kernel

if installed:
    from rvc_features.kernels.vectors import LANES, load, splat, store, to_float64, widened
_FLOAT64 = np.empty(0, np.float64)   # for its type: what rows are smoothed in


@kernel
def zeros(count, like):
    """Array of zeros of the type of `like`, from a cache line on, so that aligned vectors do not straddle two.

    Zeros, for what lies beyond the ends of rows is not used, but slow if it happens to be tiny.
    """
    size = count * like.itemsize
    memory = np.zeros(size + 64, np.uint8)
    start = 63 - (np.int64(memory.ctypes.data) + 63) % 64
    return memory[start:start + size].view(like.dtype)


@kernel
def row_length(width, lead):
    """Of a buffer for rows of that width that begin at `lead`, with room to read beyond either end; in cache lines."""
    return -(-(lead + width + max(lead, 1) + 2 * LANES) // 64) * 64


@kernel
def row_lead(radius):
    """Where a row begins that is read from `radius` before its first pixel: at a cache line."""
    return -(-radius // LANES) * LANES


@kernel
def reflect(index, length):
    """BORDER_REFLECT_101: dcb|abcd|cba."""
    if length == 1:
        return 0
    if index < 0:
        index = -index
    if index >= 2 * length - 2:   # more than one reflection: a window larger than the image
        index %= 2 * length - 2
    return index if index < length else 2 * length - 2 - index


@kernel
def reflect_ends(row, start, width, radius):
    """Continue a row that begins at `start` by `radius` numbers on either side."""
    end = start + width - 1
    if radius < width:
        for j in range(1, radius + 1):
            row[start - j] = row[start + j]
        for j in range(1, radius + 1):
            row[end + j] = row[end - j]
    else:
        for j in range(1, radius + 1):
            row[start - j] = row[start + reflect(j, width)]
            row[end + j] = row[start + reflect(width - 1 + j, width)]


@kernel
def image_rows(width, taps, pixel):
    """Room for one row on its way to be smoothed, and for the three rows of the image that a gradient needs."""
    length = row_length(width, 1)
    margin = 0 if taps is None else len(taps) - 1
    return zeros(width + 2 * margin + LANES, _FLOAT64), zeros(3 * length, pixel).reshape((3, length))


@kernel
def next_gradient_rows(image, y, is_first, taps, smoothed, rows):
    """See to it that rows y - 1 to y + 1 of the image, smoothed if there are taps, are among the three that are kept.

    Called for one y after the other; `is_first` says that none has been fetched before. Returns where they begin.
    """
    height, width = image.shape
    for above in range(y - 1 if is_first else y + 1, y + 2):
        if 0 <= above < height:
            row = rows[above % 3]
            if taps is None:   # known to the compiler, which leaves out the rest
                for i in range(width):
                    row[i + 1] = image[above, i]
            else:
                _smooth_row(image, above, taps, smoothed, row)
            reflect_ends(row, 1, width, 1)
    length = rows.shape[1]
    return reflect(y - 1, height) % 3 * length, y % 3 * length, reflect(y + 1, height) % 3 * length


@kernel
def _smooth_row(image, y, taps, column, out):
    """Row y of the smoothed image, from out[1] on: down the columns, then along the row."""
    height, width = image.shape
    radius = len(taps) - 1
    for i in range(0, width, LANES):
        i = min(i, width - LANES)
        total = splat(taps[0]) * to_float64(load(image, y * width + i))
        for j in range(1, radius + 1):
            above, below = reflect(y - j, height), reflect(y + j, height)
            pair = widened(load(image, above * width + i)) + widened(load(image, below * width + i))
            total += splat(taps[j]) * to_float64(pair)
        store(column, radius + i, total)
    reflect_ends(column, radius, width, radius)
    for i in range(0, width, LANES):
        total = splat(taps[0]) * load(column, radius + i)
        for j in range(1, radius + 1):
            total += splat(taps[j]) * (load(column, radius + i - j) + load(column, radius + i + j))
        store(out, 1 + i, total)


@kernel
def sobel_gradient(rows, above, here, below, i):
    """3x3 Sobel gradients of sixteen pixels from i on, in x and in y."""
    above, here, below = above + i, here + i, below + i
    a, b, c = widened(load(rows, above)), widened(load(rows, above + 1)), widened(load(rows, above + 2))
    d, e = widened(load(rows, here)), widened(load(rows, here + 2))
    f, g, h = widened(load(rows, below)), widened(load(rows, below + 1)), widened(load(rows, below + 2))
    return (c - a) + (e - d) + (e - d) + (h - f), (f - a) + (g - b) + (g - b) + (h - c)
