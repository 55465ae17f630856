"""Rows of an image on their way through a kernel: buffers, borders, smoothing, gradients."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import installed, kernel

if installed:
    from rvc_features.kernels.instructions import fours_swapped, last_of_four, one_later, second_four, two_later
    from rvc_features.kernels.vectors import LANES, converted, load, splat, store, to_float64, widened
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
def new_map(height, width):
    """Array of float32 that begins at a cache line, with whatever is there."""
    memory = np.empty(height * width + 16, np.float32)
    start = (63 - (np.int64(memory.ctypes.data) + 63) % 64) // 4
    return memory[start:start + height * width].reshape((height, width))


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
def gradient_buffers(width, taps, gradient):
    """Room for one row on its way to be smoothed, for three smoothed rows, and for the parts of gradients."""
    length = row_length(width, 1)
    margin, rows = (0, 0) if taps is None else (len(taps) - 1, 3)
    parts = zeros(2 * row_length(width, LANES), gradient)
    return (zeros(width + 2 * margin + LANES, _FLOAT64), zeros(rows * length, _FLOAT64).reshape((rows, length)),
            parts.reshape((2, len(parts) // 2)))


@kernel
def next_gradient_parts(image, y, is_first, taps, smoothed, rows, parts):
    """What Sobel needs down the columns of row y, smoothed if there are taps: sums 1 2 1, and differences -1 0 1.

    Both from `LANES` on. With taps it is called for one y after the other; `is_first` marks the first time.
    """
    height, width = image.shape
    if taps is None:   # known to the compiler, which leaves out the rest
        _gradient_parts(image, reflect(y - 1, height) * width, y * width, reflect(y + 1, height) * width, width, parts)
    else:
        length = rows.shape[1]
        for below in range(y - 1 if is_first else y + 1, y + 2):
            if 0 <= below < height:
                _smooth_row(image, below, taps, smoothed, rows[below % 3])
        _gradient_parts(rows, reflect(y - 1, height) % 3 * length, y % 3 * length, reflect(y + 1, height) % 3 * length,
                        width, parts)


@kernel
def _gradient_parts(rows, above, here, below, width, parts):
    differences = parts.shape[1] + LANES
    for i in range(0, width, LANES):
        i = min(i, width - LANES)
        before, middle = converted(load(rows, above + i), parts), converted(load(rows, here + i), parts)
        after = converted(load(rows, below + i), parts)
        store(parts, LANES + i, (before + after) + (middle + middle))
        store(parts, differences + i, after - before)
    for part in range(2):
        reflect_ends(parts[part], LANES, width, 1)


@kernel
def sobel_gradient(parts, i):
    """3x3 Sobel gradients of sixteen pixels from i on, in x and in y."""
    sums, differences = LANES + i, parts.shape[1] + LANES + i
    middle = load(parts, differences)
    return (load(parts, sums + 1) - load(parts, sums - 1),
            (load(parts, differences - 1) + load(parts, differences + 1)) + (middle + middle))


@kernel
def running_sums(before, vector):
    """Sums of half a vector's numbers up to each of them and of what comes before; and what comes before the next."""
    sums = vector + one_later(vector)
    sums += two_later(sums)
    last = last_of_four(sums)
    swapped = fours_swapped(last)
    return (before + sums) + second_four(swapped), before + (last + swapped)


@kernel
def _smooth_row(image, y, taps, column, out):
    """Row y of the smoothed image: down the columns, then along the row."""
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
        store(out, i, total)
