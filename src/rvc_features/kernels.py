"""The hot loops, compiled by Numba. Each has its readable reference in the module that calls it.

Nothing here is needed: where Numba is missing or does not work, `available()` is False, one line in the log says so,
and the callers take their reference path. How the loops are written follows from what makes LLVM vectorise them, on
the oldest Numba we support (0.58, Python 3.8) as on the newest:

- short loops over few arrays, row by row, so that everything but the image stays in the nearest caches;
- a store into the narrow type ends each line: what Numba widens in between, LLVM narrows again;
- unsigned indices where an offset is added, for a signed one could be negative and would count from the end.

The kernels release the GIL and hold no state: they may run in several threads at once.
"""

from __future__ import annotations

import functools
import logging
import threading
from typing import Any, Callable

import numpy as np

try:
    import numba
    _reason_against = 'NUMBA_DISABLE_JIT is set' if getattr(numba.config, 'DISABLE_JIT', False) else ''
except Exception as error:   # an ImportError, or whatever a Numba that does not fit this NumPy raises
    _reason_against = str(error)

LARGEST_BOX = 45   # pixels: the largest odd window whose sums of Sobel products fit in 32 bits, w^2 (4 * 255)^2 < 2^31

_logger = logging.getLogger('rvc_features')


@functools.lru_cache(maxsize=None)
def available() -> bool:
    """Whether the kernels can be called; the first call says in the log when they can't."""
    if _reason_against:
        _logger.warning('Without Numba the detector runs slower, on OpenCV and NumPy alone (%s).', _reason_against)
    return not _reason_against


def response(image: np.ndarray, window_size: int, window: str, harris_k: float,
             out: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Harris response and its largest value; reference: `response.reference_response`.

    Gradients, their products, the window and the response are computed row by row in one pass. The box window's sums
    are exact for uint8 and in double precision for float images; the Gaussian window's are in single precision. H is
    put together in double precision, for A C - B^2 may cancel.

    Parameters
    ----------
    image : ndarray, uint8, float32 or float64, shape (H, W)
    window_size : int
        Odd; for the box at most `LARGEST_BOX`.
    window : {'gaussian', 'box'}
    harris_k : float
    out : ndarray, float32, shape (H, W), contiguous, optional
        Where to write the response.
    """
    image = _read_only(image)
    height, width = image.shape
    if out is None:
        out = _aligned((height, width), np.float32)
    exact = image.dtype == np.uint8
    gradient_type = np.int16 if exact else np.float64
    radius = window_size // 2
    lead, stride = _padding(width, radius)
    smooth = _zeros((2, width + 2), gradient_type)
    if window == 'box':
        gradients = _zeros((min(height, window_size + 1) + 1, 2, stride), gradient_type)
        sums = _zeros((4, 3 * stride + 64), np.int32 if exact else np.float64)
        return out, _box_response(image, window_size, harris_k, lead, stride, smooth, gradients, sums, out)
    gradients = _zeros((1, 2, stride), gradient_type)
    products = _zeros((min(height, window_size), 3 * stride), np.float32)
    sums = _zeros((2, 3 * stride + 64), np.float32)
    weights = gaussian_weights(window_size)
    return out, _gaussian_response(image, weights, harris_k, lead, stride, smooth, gradients, products, sums, out)


def gaussian_weights(window_size: int) -> np.ndarray:
    """Weights of the Gaussian window from its centre outwards, float32, shape (window_size // 2 + 1,)."""
    sigma = 0.3 * ((window_size - 1) * 0.5 - 1) + 0.8
    weights = np.exp(-np.arange(window_size // 2 + 1) ** 2 / (2 * sigma ** 2))
    return (weights / (2 * weights.sum() - weights[0])).astype(np.float32)


# ---- How it is done ----

_lock = threading.Lock()


def _kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Numba's decorator with the options of this module; without Numba the function stays as it is."""
    if function is None:
        return functools.partial(_kernel, **options)
    if _reason_against:
        return function
    options = {'nogil': True, 'error_model': 'numpy', **options}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:   # no place to write a cache: a read-only installation without a home directory
        return numba.njit(**options)(function)


def _read_only(image: np.ndarray) -> np.ndarray:
    """A contiguous read-only view or copy: one type for Numba, which would compile again for each kind of array."""
    view = np.ascontiguousarray(image)[:]
    view.flags.writeable = False
    return view


def _aligned(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """An uninitialised array that begins at a cache line, so that aligned vectors do not straddle two."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.empty(size + 64, np.uint8)
    start = -memory.__array_interface__['data'][0] % 64
    return memory[start:start + size].view(dtype).reshape(shape)


def _zeros(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    array = _aligned(shape, dtype)
    array.fill(0)
    return array


def _padding(width: int, radius: int) -> tuple[int, int]:
    """Where a row of sums begins in its buffer, and how far apart those of A, B and C are; in whole cache lines."""
    lead = -(-radius // 16) * 16
    return lead, -(-(lead + width + radius + 1) // 32) * 32


@_kernel
def _reflect(index, length):
    """BORDER_REFLECT_101: dcb|abcd|cba."""
    if length == 1:
        return 0
    index = abs(index) % (2 * length - 2)
    return min(index, 2 * length - 2 - index)


@_kernel
def _sobel(image, y, smooth, gradients, slot):
    """3x3 Sobel gradients of row y into gradients[slot]: first down the columns, then along the row."""
    height, width = image.shape
    above, here, below = image[_reflect(y - 1, height)], image[y], image[_reflect(y + 1, height)]
    n = np.uint64(width)
    one, two = np.uint64(1), np.uint64(2)
    kind = smooth.dtype.type
    for i in range(n):
        smooth[0, i + one] = kind(above[i]) + kind(2) * kind(here[i]) + kind(below[i])
    for i in range(n):
        smooth[1, i + one] = kind(below[i]) - kind(above[i])
    for part in range(2):
        smooth[part, 0] = smooth[part, min(2, width)]
        smooth[part, width + 1] = smooth[part, max(width - 1, 1)]
    for i in range(n):
        gradients[slot, 0, i] = smooth[0, i + two] - smooth[0, i]
    for i in range(n):
        gradients[slot, 1, i] = smooth[1, i] + kind(2) * smooth[1, i + one] + smooth[1, i + two]


@_kernel
def _box_response(image, window_size, harris_k, lead, stride, smooth, gradients, sums, out):
    """Running sums down the columns, sums of neighbours along the row; A, B and C lie one after the other."""
    height, width = image.shape
    radius = window_size // 2
    slots = len(gradients) - 1
    zeros = slots   # the last row of gradients stays zero: what the first windows have nothing to subtract from
    columns, windows = sums[0], sums[1]
    largest = np.full(width, -np.inf, np.float32)
    done = 0
    for y in range(height):
        while done <= min(height - 1, y + radius):
            _sobel(image, done, smooth, gradients, done % slots)
            done += 1
        if y == 0:
            for j in range(-radius, radius + 1):
                _slide(columns, lead, stride, gradients, _reflect(j, height) % slots, zeros, width)
        else:
            _slide(columns, lead, stride, gradients, _reflect(y + radius, height) % slots,
                   _reflect(y - 1 - radius, height) % slots, width)
        _reflect_ends(columns, lead, stride, radius, width)
        _sum_neighbours(columns, lead - radius, window_size, 2 * stride + width, sums[2], sums[3], windows)
        _combine(windows, stride, harris_k, 1.0 / window_size ** 4, out[y], largest)
    return largest.max()


@_kernel
def _slide(columns, lead, stride, gradients, new, old, width):
    """Move the windows down by one row: the products of the new row come in, those of the old one go."""
    n = np.uint64(width)
    kind = columns.dtype.type
    for part in range(2):
        at = np.uint64(lead + 2 * part * stride)
        for i in range(n):
            more, less = gradients[new, part, i], gradients[old, part, i]
            columns[at + i] += kind(more - less) * kind(more + less)
    at = np.uint64(lead + stride)
    for i in range(n):
        columns[at + i] += (kind(gradients[new, 0, i]) * kind(gradients[new, 1, i])
                            - kind(gradients[old, 0, i]) * kind(gradients[old, 1, i]))


@_kernel
def _reflect_ends(rows, lead, stride, radius, width):
    for start in range(lead, lead + 3 * stride, stride):
        for j in range(1, radius + 1):
            rows[start - j] = rows[start + _reflect(j, width)]
            rows[start + width - 1 + j] = rows[start + _reflect(width - 1 + j, width)]


@_kernel
def _sum_neighbours(values, start, size, count, fours, sixteens, out):
    """out[i] = sum of values[start + i : start + i + size], for i up to count; size is odd, from 3 to 45.

    A running sum waits for the sum before it; this adds vectors. Every odd size is 4 q + 1 or 4 q - 1: sums of four
    and of sixteen neighbours, and one more or one less.
    """
    n = np.uint64(count)
    at = np.uint64(start)
    one, two, three, four = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4)
    eight, twelve, sixteen = np.uint64(8), np.uint64(12), np.uint64(16)
    if size == 3:
        for i in range(n):
            j = at + i
            out[i] = values[j] + values[j + one] + values[j + two]
        return
    if size == 5:
        for i in range(n):
            j = at + i
            out[i] = (values[j] + values[j + one]) + (values[j + two] + values[j + three]) + values[j + four]
        return
    if size == 7:
        for i in range(n):
            j = at + i
            out[i] = ((values[j] + values[j + one]) + (values[j + two] + values[j + three])
                      + (values[j + four] + values[j + four + one]) + values[j + four + two])
        return

    quads = (size + 1) // 4
    sign = values.dtype.type(size - 4 * quads)
    for i in range(n + np.uint64(size)):
        j = at + i
        fours[i] = (values[j] + values[j + one]) + (values[j + two] + values[j + three])
    at += np.uint64(size - 1 if sign > 0 else size)   # of the one more or less
    if quads == 2:
        for i in range(n):
            out[i] = fours[i] + fours[i + four] + sign * values[at + i]
        return
    if quads == 3:
        for i in range(n):
            out[i] = fours[i] + fours[i + four] + fours[i + eight] + sign * values[at + i]
        return
    if quads == 4:
        for i in range(n):
            out[i] = (fours[i] + fours[i + four]) + (fours[i + eight] + fours[i + twelve]) + sign * values[at + i]
        return

    for i in range(n + sixteen):
        sixteens[i] = (fours[i] + fours[i + four]) + (fours[i + eight] + fours[i + twelve])
    reached = sixteen
    if quads < 8:
        for i in range(n):
            out[i] = sixteens[i] + sign * values[at + i]
    else:
        for i in range(n):
            out[i] = sixteens[i] + sixteens[i + sixteen] + sign * values[at + i]
        reached += sixteen
    if quads % 4 == 1:
        for i in range(n):
            out[i] += fours[i + reached]
    elif quads % 4 == 2:
        for i in range(n):
            out[i] += fours[i + reached] + fours[i + reached + four]
    elif quads % 4 == 3:
        for i in range(n):
            out[i] += fours[i + reached] + fours[i + reached + four] + fours[i + reached + eight]


@_kernel
def _combine(windows, stride, harris_k, scale, out, largest):
    """H = A C - B^2 - k (A + C)^2 of one row, and the largest value seen in each column."""
    n = np.uint64(len(out))
    at_b, at_c = np.uint64(stride), np.uint64(2 * stride)
    for i in range(n):
        a, b, c = np.float64(windows[i]), np.float64(windows[at_b + i]), np.float64(windows[at_c + i])
        trace = a + c
        out[i] = (a * c - b * b - harris_k * (trace * trace)) * scale
    for i in range(n):
        largest[i] = out[i] if out[i] > largest[i] else largest[i]


@_kernel
def _gaussian_response(image, weights, harris_k, lead, stride, smooth, gradients, products, sums, out):
    """The same with weighted sums; products of the rows a window covers are kept in turn."""
    height, width = image.shape
    radius = len(weights) - 1
    slots = len(products)
    columns, windows = sums[0], sums[1]
    largest = np.full(width, -np.inf, np.float32)
    slot = np.empty(2 * radius + 1, np.int64)
    done = 0
    for y in range(height):
        while done <= min(height - 1, y + radius):
            _sobel(image, done, smooth, gradients, 0)
            _multiply(gradients, width, stride, products, done % slots)
            done += 1
        for j in range(2 * radius + 1):
            slot[j] = _reflect(y + j - radius, height) % slots
        _weigh_rows(products, slot, weights, lead, 2 * stride + width, columns)
        _reflect_ends(columns, lead, stride, radius, width)
        _weigh_neighbours(columns, lead, weights, 2 * stride + width, windows)
        _combine(windows, stride, harris_k, 1.0, out[y], largest)
    return largest.max()


@_kernel
def _multiply(gradients, width, stride, products, slot):
    n = np.uint64(width)
    at_b, at_c = np.uint64(stride), np.uint64(2 * stride)
    for i in range(n):
        products[slot, i] = np.float32(gradients[0, 0, i]) * np.float32(gradients[0, 0, i])
    for i in range(n):
        products[slot, at_b + i] = np.float32(gradients[0, 0, i]) * np.float32(gradients[0, 1, i])
    for i in range(n):
        products[slot, at_c + i] = np.float32(gradients[0, 1, i]) * np.float32(gradients[0, 1, i])


@_kernel(fastmath={'contract'})
def _weigh_rows(rows, slot, weights, lead, count, out):
    """out[lead + i] = sum over j of weights[|j|] rows[slot[radius + j], i]."""
    n = np.uint64(count)
    to = np.uint64(lead)
    r = len(weights) - 1
    c, w0 = slot[r], weights[0]
    first = r % 4
    if first == 0:
        for i in range(n):
            out[to + i] = w0 * rows[c, i]
    else:
        a1, b1, w1 = slot[r - 1], slot[r + 1], weights[1]
        if first == 1:
            for i in range(n):
                out[to + i] = w0 * rows[c, i] + w1 * (rows[a1, i] + rows[b1, i])
        else:
            a2, b2, w2 = slot[r - 2], slot[r + 2], weights[2]
            if first == 2:
                for i in range(n):
                    out[to + i] = (w0 * rows[c, i] + w1 * (rows[a1, i] + rows[b1, i])
                                   + w2 * (rows[a2, i] + rows[b2, i]))
            else:
                a3, b3, w3 = slot[r - 3], slot[r + 3], weights[3]
                for i in range(n):
                    out[to + i] = (w0 * rows[c, i] + w1 * (rows[a1, i] + rows[b1, i])
                                   + w2 * (rows[a2, i] + rows[b2, i]) + w3 * (rows[a3, i] + rows[b3, i]))
    for j in range(first + 1, r + 1, 4):
        a1, a2, a3, a4 = slot[r - j], slot[r - j - 1], slot[r - j - 2], slot[r - j - 3]
        b1, b2, b3, b4 = slot[r + j], slot[r + j + 1], slot[r + j + 2], slot[r + j + 3]
        w1, w2, w3, w4 = weights[j], weights[j + 1], weights[j + 2], weights[j + 3]
        for i in range(n):
            out[to + i] += (w1 * (rows[a1, i] + rows[b1, i]) + w2 * (rows[a2, i] + rows[b2, i])
                            + w3 * (rows[a3, i] + rows[b3, i]) + w4 * (rows[a4, i] + rows[b4, i]))


@_kernel(fastmath={'contract'})
def _weigh_neighbours(values, start, weights, count, out):
    """out[i] = sum over j of weights[|j|] values[start + i + j]."""
    n = np.uint64(count)
    r = len(weights) - 1
    at = np.uint64(start)
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    w0 = weights[0]
    first = r % 4
    if first == 0:
        for i in range(n):
            out[i] = w0 * values[at + i]
    elif first == 1:
        w1 = weights[1]
        for i in range(n):
            j = at + i
            out[i] = w0 * values[j] + w1 * (values[j - one] + values[j + one])
    elif first == 2:
        w1, w2 = weights[1], weights[2]
        for i in range(n):
            j = at + i
            out[i] = (w0 * values[j] + w1 * (values[j - one] + values[j + one])
                      + w2 * (values[j - two] + values[j + two]))
    else:
        w1, w2, w3 = weights[1], weights[2], weights[3]
        for i in range(n):
            j = at + i
            out[i] = (w0 * values[j] + w1 * (values[j - one] + values[j + one])
                      + w2 * (values[j - two] + values[j + two]) + w3 * (values[j - three] + values[j + three]))
    for k in range(first + 1, r + 1, 4):
        _add_four_pairs(values, start - k - 3, start + k, weights[k:k + 4], count, out)


@_kernel(fastmath={'contract'})
def _add_four_pairs(values, left, right, weights, count, out):
    # A function of its own: as an inner loop of the one above, newer LLVM does not vectorise it.
    n = np.uint64(count)
    left, right = np.uint64(left), np.uint64(right)
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    w1, w2, w3, w4 = weights[0], weights[1], weights[2], weights[3]
    for i in range(n):
        a, b = left + i, right + i
        out[i] += ((w1 * (values[a + three] + values[b]) + w2 * (values[a + two] + values[b + one]))
                   + (w3 * (values[a + one] + values[b + two]) + w4 * (values[a] + values[b + three])))
