"""The hot loops, compiled by Numba. Each has its readable reference in the module that calls it.

Nothing here is needed: where Numba is missing or does not work, `available()` is False, one line in the log says so,
and the callers take their reference path. How the loops are written follows from what makes LLVM vectorise them, on
the oldest Numba we support (0.58, Python 3.8) as on the newest:

- short loops over few arrays, row by row, so that everything but the image stays in the nearest caches;
- a store into the narrow type ends each line: what Numba widens in between, LLVM narrows again;
- unsigned indices where an offset is added, for a signed one could be negative and would count from the end.

The kernels release the GIL and hold no state: they may run in several threads at once. The two that go over whole
images do so themselves: each thread takes a band of rows, as many as OpenCV has threads (`cv2.setNumThreads`).
"""

from __future__ import annotations

import functools
import logging
import math
import os
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Callable

import cv2
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


def compile_all() -> float:
    """Compile what a detector needs for uint8 images, or load it from Numba's cache; the seconds it took.

    Without this the first frame waits for it: half a minute the first time on a machine, half a second later. Left
    out is what is rarely asked for: the box window after smoothing.
    """
    start = time.perf_counter()
    if available():
        image = np.zeros((40, 40), np.uint8)
        image[10:, 10:] = 255
        for window, derivative_sigma in (('box', 0.0), ('gaussian', 0.0), ('gaussian', 1.0)):
            values, _ = response(image, 5, window, 0.04, derivative_sigma)
        x, y = refine(values, *local_maxima(values, 10.0))
        smoothed_gradients(image, x, y, 2.5)
        points, responses = np.column_stack((x, y)), np.ones(len(x))
        strongest_first(responses)
        suppression_radii(points, significantly_stronger(responses, 0.9), 1)
    return time.perf_counter() - start


def response(image: np.ndarray, window_size: int, window: str, harris_k: float, derivative_sigma: float = 0.0,
             out: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Harris response and its largest value; reference: `response.reference_response`.

    Smoothing, gradients, their products, the window and the response are computed row by row in one pass. The box
    window's sums are exact for uint8 without smoothing and else in double precision; the Gaussian window's are in
    single precision. H is put together in double precision, for A C - B^2 may cancel.

    Parameters
    ----------
    image : ndarray, uint8 or float32, shape (H, W)
    window_size : int
        Odd; for the box at most `LARGEST_BOX`.
    window : {'gaussian', 'box'}
    harris_k, derivative_sigma : float
    out : ndarray, float32, shape (H, W), contiguous, optional
        Where to write the response.
    """
    image = _read_only(image)
    height, width = image.shape
    response = _aligned((height, width), np.float32) if out is None else out
    largest = _in_bands(lambda first, last: _response_of_rows(image, window_size, window, harris_k, derivative_sigma,
                                                              response, first, last), height, width)
    return response, max(largest)


def _response_of_rows(image: np.ndarray, window_size: int, window: str, harris_k: float, derivative_sigma: float,
                      out: np.ndarray, first: int, last: int) -> float:
    """Fill in the rows from `first` to before `last`; returns the largest value in them."""
    height, width = image.shape
    exact = image.dtype == np.uint8 and derivative_sigma == 0
    gradient_type = np.int16 if exact else np.float64
    radius = window_size // 2
    lead, stride = _padding(width, radius)
    taps, smoothed = None, _NO_ROWS
    if derivative_sigma > 0:
        margin = int(np.ceil(4 * derivative_sigma))
        taps, smoothed = _gaussian_taps(margin, derivative_sigma), _aligned((5, width + 2 * margin), np.float64)
    sobel = _aligned((2, width + 2), gradient_type)
    if window == 'box':
        gradients = _aligned((min(height, window_size + 1) + 1, 2, stride), gradient_type)
        gradients[-1] = 0
        sums = _aligned((4, 3 * stride + 64), np.int32 if exact else np.float64)
        sums.fill(0)
        return _box_response(image, taps, int(window_size), float(harris_k), lead, stride, smoothed, sobel, gradients,
                             sums, out, first, last)
    weights = _gaussian_taps(radius, 0.3 * ((window_size - 1) * 0.5 - 1) + 0.8).astype(np.float32)
    gradients = _aligned((1, 2, stride), gradient_type)
    products = _aligned((min(height, window_size), 3 * stride), np.float32)
    products.reshape(-1, 3, stride)[:, :, width:] = 0   # between the channels, where it is read but not used
    sums = _aligned((2, 3 * stride + 64), np.float32)
    sums.fill(0)
    return _gaussian_response(image, taps, weights, float(harris_k), lead, stride, smoothed, sobel, gradients, products,
                              sums, out, first, last)


def local_maxima(response: np.ndarray, minimum: float) -> tuple[np.ndarray, np.ndarray]:
    """Local maxima above `minimum`, x and y in reading order; reference: `maxima.reference_local_maxima`."""
    found = _in_bands(lambda first, last: _local_maxima(response, minimum, first, last), *response.shape)
    return found[0] if len(found) == 1 else (np.concatenate([x for x, _ in found]),
                                             np.concatenate([y for _, y in found]))


def _in_bands(work: Callable[[int, int], Any], height: int, width: int) -> list[Any]:
    """What `work(first, last)` gives for bands of rows that make up the image, in their order."""
    bands = max(1, min(cv2.getNumThreads(), height * width // _LEAST_BAND, height))
    ends = [height * (band + 1) // bands for band in range(bands)]
    others = [_threads().submit(work, first, last) for first, last in zip(ends, ends[1:])]
    return [work(0, ends[0]), *(other.result() for other in others)]


@functools.lru_cache(maxsize=None)
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count(), 'rvc_features')


if hasattr(os, 'register_at_fork'):   # a forked process has none of its parent's threads
    os.register_at_fork(after_in_child=_threads.cache_clear)

_LEAST_BAND = 250_000   # pixels: fewer are done about as soon as another thread wakes up
_NO_ROWS = np.empty((0, 0))


@functools.lru_cache(maxsize=64)
def _gaussian_taps(radius: int, sigma: float) -> np.ndarray:
    """Weights of a Gaussian from its centre outwards, float64, shape (radius + 1,); all of them sum to one."""
    taps = np.exp(-np.arange(radius + 1) ** 2 / (2 * sigma ** 2))
    return taps / (2 * taps.sum() - taps[0])


# ---- How it is done ----

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
    size = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.empty(size + 64, np.uint8)
    start = -memory.__array_interface__['data'][0] % 64
    return memory[start:start + size].view(dtype).reshape(shape)


def _padding(width: int, radius: int) -> tuple[int, int]:
    """Where a row of sums begins in its buffer, and how far apart those of A, B and C are; in whole cache lines."""
    lead = -(-radius // 16) * 16
    return lead, -(-(lead + width + radius + 1) // 32) * 32


@_kernel
def _at_once(stride):
    """How much of A, B and C a loop takes at once: all if that fits the nearest cache, or one after the other."""
    return 3 * stride if stride <= 1024 else stride


@_kernel
def _reflect(index, length):
    """BORDER_REFLECT_101: dcb|abcd|cba."""
    if length == 1:
        return 0
    if index < 0:
        index = -index
    if index >= 2 * length - 2:   # more than one reflection: a window larger than the image
        index %= 2 * length - 2
    return index if index < length else 2 * length - 2 - index


@_kernel
def _gradients(image, y, is_first, taps, smoothed, sobel, gradients, slot):
    """3x3 Sobel gradients of row y, or of what the taps of a Gaussian make of it, into gradients[slot].

    Rows come one after the other; `is_first` says that nothing has been smoothed before.
    """
    height, width = image.shape
    above, below = _reflect(y - 1, height), _reflect(y + 1, height)
    if taps is None:   # known to the compiler, which leaves out the rest
        _sobel(image, above, y, below, width, sobel, gradients, slot)
        return
    if is_first:
        if y > 0:
            _smooth_row(image, y - 1, taps, smoothed)
        _smooth_row(image, y, taps, smoothed)
    if y + 1 < height:
        _smooth_row(image, y + 1, taps, smoothed)
    _sobel(smoothed, above % 3, y % 3, below % 3, width, sobel, gradients, slot)


@_kernel
def _smooth_row(image, y, taps, smoothed):
    """Row y of the smoothed image into smoothed[y % 3]; the last two rows are for what is on the way."""
    height, width = image.shape
    radius = len(taps) - 1
    rows = np.empty(2 * radius + 1, np.int64)
    for j in range(2 * radius + 1):
        rows[j] = _reflect(y + j - radius, height)
    column = smoothed[3]
    _weigh_rows(image, rows, 0, taps, width, column, radius)
    for j in range(1, radius + 1):
        column[radius - j] = column[radius + _reflect(j, width)]
        column[radius + width - 1 + j] = column[radius + _reflect(width - 1 + j, width)]
    _weigh_neighbours(column, radius, taps, width, smoothed[y % 3], 0)


@_kernel
def _sobel(image, above, here, below, width, sobel, gradients, slot):
    """First down the columns, then along the row."""
    n = np.uint64(width)
    one, two = np.uint64(1), np.uint64(2)
    kind = sobel.dtype.type
    for i in range(n):
        sobel[0, i + one] = kind(image[above, i]) + kind(2) * kind(image[here, i]) + kind(image[below, i])
    for i in range(n):
        sobel[1, i + one] = kind(image[below, i]) - kind(image[above, i])
    for part in range(2):
        sobel[part, 0] = sobel[part, min(2, width)]
        sobel[part, width + 1] = sobel[part, max(width - 1, 1)]
    for i in range(n):
        gradients[slot, 0, i] = sobel[0, i + two] - sobel[0, i]
    for i in range(n):
        gradients[slot, 1, i] = sobel[1, i] + kind(2) * sobel[1, i + one] + sobel[1, i + two]


@_kernel
def _box_response(image, taps, window_size, harris_k, lead, stride, smoothed, sobel, gradients, sums, out, first, last):
    """Running sums down the columns, sums of neighbours along the row; A, B and C lie one after the other."""
    height, width = image.shape
    radius = window_size // 2
    slots = len(gradients) - 1
    slot_of = np.arange(height) % slots
    zeros = slots   # the last row of gradients stays zero: what the first windows have nothing to subtract from
    columns, windows = sums[0], sums[1]
    step = _at_once(stride)
    largest = np.full(width, -np.inf, np.float32)
    done = begin = max(0, first - radius)
    for y in range(first, last):
        while done <= min(height - 1, y + radius):
            _gradients(image, done, done == begin, taps, smoothed, sobel, gradients, slot_of[done])
            done += 1
        if y == first:
            for j in range(-radius, radius + 1):
                _slide(columns, lead, stride, gradients, slot_of[_reflect(y + j, height)], zeros, width)
        else:
            _slide(columns, lead, stride, gradients, slot_of[_reflect(y + radius, height)],
                   slot_of[_reflect(y - 1 - radius, height)], width)
        _reflect_ends(columns, lead, stride, radius, width)
        for start in range(0, 3 * stride, step):
            _sum_neighbours(columns, start + lead - radius, window_size, step - stride + width, sums[2], sums[3],
                            windows, start)
        _combine(windows, stride, harris_k, 1.0 / window_size ** 4, out, y, largest)
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
def _sum_neighbours(values, start, size, count, fours, sixteens, out, to):
    """out[to + i] = sum of values[start + i : start + i + size], for i up to count; size is odd, from 3 to 45.

    A running sum waits for the sum before it; this adds vectors. Every odd size is 4 q + 1 or 4 q - 1: sums of four
    and of sixteen neighbours, and one more or one less.
    """
    n = np.uint64(count)
    at, to = np.uint64(start), np.uint64(to)
    kind = values.dtype.type
    one, two, three, four = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4)
    eight, twelve, sixteen = np.uint64(8), np.uint64(12), np.uint64(16)
    if size == 3:
        for i in range(n):
            j = at + i
            out[to + i] = kind(values[j] + values[j + one]) + values[j + two]
        return
    if size == 5:
        for i in range(n):
            j = at + i
            out[to + i] = (kind(kind(values[j] + values[j + one]) + kind(values[j + two] + values[j + three]))
                      + values[j + four])
        return

    if size == 7:
        for i in range(n):
            j = at + i
            out[to + i] = (kind(kind(values[j] + values[j + one]) + kind(values[j + two] + values[j + three]))
                      + kind(kind(values[j + four] + values[j + four + one]) + values[j + four + two]))
        return

    quads = (size + 1) // 4
    for i in range(n + np.uint64(size)):
        j = at + i
        fours[i] = kind(values[j] + values[j + one]) + kind(values[j + two] + values[j + three])
    one_more = size > 4 * quads
    at += np.uint64(size - 1 if one_more else size)
    if quads <= 4:
        if quads == 2:
            for i in range(n):
                out[to + i] = fours[i] + fours[i + four]
        elif quads == 3:
            for i in range(n):
                out[to + i] = kind(fours[i] + fours[i + four]) + fours[i + eight]
        else:
            for i in range(n):
                out[to + i] = kind(fours[i] + fours[i + four]) + kind(fours[i + eight] + fours[i + twelve])
    else:
        for i in range(n + sixteen):
            sixteens[i] = kind(fours[i] + fours[i + four]) + kind(fours[i + eight] + fours[i + twelve])
        reached = sixteen
        if quads < 8:
            for i in range(n):
                out[to + i] = sixteens[i]
        else:
            for i in range(n):
                out[to + i] = sixteens[i] + sixteens[i + sixteen]
            reached += sixteen
        if quads % 4 == 1:
            for i in range(n):
                out[to + i] += fours[i + reached]
        elif quads % 4 == 2:
            for i in range(n):
                out[to + i] += kind(fours[i + reached] + fours[i + reached + four])
        elif quads % 4 == 3:
            for i in range(n):
                out[to + i] += kind(kind(fours[i + reached] + fours[i + reached + four]) + fours[i + reached + eight])
    if one_more:
        for i in range(n):
            out[to + i] += values[at + i]
    else:
        for i in range(n):
            out[to + i] -= values[at + i]


@_kernel(fastmath={'contract'})
def _combine(windows, stride, harris_k, scale, out, y, largest):
    """H = A C - B^2 - k (A + C)^2 of one row, and the largest value seen in each column."""
    n = np.uint64(len(largest))
    at_b, at_c = np.uint64(stride), np.uint64(2 * stride)
    for i in range(n):
        a, b, c = np.float64(windows[i]), np.float64(windows[at_b + i]), np.float64(windows[at_c + i])
        trace = a + c
        out[y, i] = (a * c - b * b - harris_k * (trace * trace)) * scale
    for i in range(n):
        largest[i] = out[y, i] if out[y, i] > largest[i] else largest[i]


@_kernel
def _gaussian_response(image, taps, weights, harris_k, lead, stride, smoothed, sobel, gradients, products, sums, out,
                       first, last):
    """The same with weighted sums; products of the rows a window covers are kept in turn."""
    height, width = image.shape
    radius = len(weights) - 1
    slot_of = np.arange(height) % len(products)
    columns, windows = sums[0], sums[1]
    step = _at_once(stride)
    largest = np.full(width, -np.inf, np.float32)
    slot = np.empty(2 * radius + 1, np.int64)
    done = begin = max(0, first - radius)
    for y in range(first, last):
        while done <= min(height - 1, y + radius):
            _gradients(image, done, done == begin, taps, smoothed, sobel, gradients, 0)
            _multiply(gradients, width, stride, products, slot_of[done])
            done += 1
        for j in range(2 * radius + 1):
            slot[j] = slot_of[_reflect(y + j - radius, height)]
        for start in range(0, 3 * stride, step):
            _weigh_rows(products, slot, start, weights, step - stride + width, columns, start + lead)
        _reflect_ends(columns, lead, stride, radius, width)
        for start in range(0, 3 * stride, step):
            _weigh_neighbours(columns, start + lead, weights, step - stride + width, windows, start)
        _combine(windows, stride, harris_k, 1.0, out, y, largest)
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
def _weigh_rows(rows, slot, start, weights, count, out, to):
    """out[to + i] = sum over j of weights[|j|] rows[slot[radius + j], start + i]."""
    n = np.uint64(count)
    at, to = np.uint64(start), np.uint64(to)
    r = len(weights) - 1
    c, w0 = slot[r], weights[0]
    kind = weights.dtype.type
    first = r % 4
    if first == 0:
        for i in range(n):
            out[to + i] = w0 * kind(rows[c, at + i])
    else:
        a1, b1, w1 = slot[r - 1], slot[r + 1], weights[1]
        if first == 1:
            for i in range(n):
                out[to + i] = w0 * kind(rows[c, at + i]) + w1 * (kind(rows[a1, at + i]) + kind(rows[b1, at + i]))
        else:
            a2, b2, w2 = slot[r - 2], slot[r + 2], weights[2]
            if first == 2:
                for i in range(n):
                    out[to + i] = (w0 * kind(rows[c, at + i]) + w1 * (kind(rows[a1, at + i]) + kind(rows[b1, at + i]))
                                   + w2 * (kind(rows[a2, at + i]) + kind(rows[b2, at + i])))
            else:
                a3, b3, w3 = slot[r - 3], slot[r + 3], weights[3]
                for i in range(n):
                    out[to + i] = (w0 * kind(rows[c, at + i]) + w1 * (kind(rows[a1, at + i]) + kind(rows[b1, at + i]))
                                   + w2 * (kind(rows[a2, at + i]) + kind(rows[b2, at + i]))
                                   + w3 * (kind(rows[a3, at + i]) + kind(rows[b3, at + i])))
    for j in range(first + 1, r + 1, 4):
        a1, a2, a3, a4 = slot[r - j], slot[r - j - 1], slot[r - j - 2], slot[r - j - 3]
        b1, b2, b3, b4 = slot[r + j], slot[r + j + 1], slot[r + j + 2], slot[r + j + 3]
        w1, w2, w3, w4 = weights[j], weights[j + 1], weights[j + 2], weights[j + 3]
        for i in range(n):
            out[to + i] += ((w1 * (kind(rows[a1, at + i]) + kind(rows[b1, at + i]))
                             + w2 * (kind(rows[a2, at + i]) + kind(rows[b2, at + i])))
                            + (w3 * (kind(rows[a3, at + i]) + kind(rows[b3, at + i]))
                               + w4 * (kind(rows[a4, at + i]) + kind(rows[b4, at + i]))))


@_kernel(fastmath={'contract'})
def _weigh_neighbours(values, start, weights, count, out, to):
    """out[to + i] = sum over j of weights[|j|] values[start + i + j]."""
    n = np.uint64(count)
    r = len(weights) - 1
    at, to = np.uint64(start), np.uint64(to)
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    w0 = weights[0]
    first = r % 4
    if first == 0:
        for i in range(n):
            out[to + i] = w0 * values[at + i]
    elif first == 1:
        w1 = weights[1]
        for i in range(n):
            j = at + i
            out[to + i] = w0 * values[j] + w1 * (values[j - one] + values[j + one])
    elif first == 2:
        w1, w2 = weights[1], weights[2]
        for i in range(n):
            j = at + i
            out[to + i] = (w0 * values[j] + w1 * (values[j - one] + values[j + one])
                      + w2 * (values[j - two] + values[j + two]))
    else:
        w1, w2, w3 = weights[1], weights[2], weights[3]
        for i in range(n):
            j = at + i
            out[to + i] = (w0 * values[j] + w1 * (values[j - one] + values[j + one])
                      + w2 * (values[j - two] + values[j + two]) + w3 * (values[j - three] + values[j + three]))
    for k in range(first + 1, r + 1, 4):
        _add_four_pairs(values, start - k - 3, start + k, weights[k:k + 4], count, out, to)


@_kernel(fastmath={'contract'})
def _add_four_pairs(values, left, right, weights, count, out, to):
    # A function of its own: as an inner loop of the one above, newer LLVM does not vectorise it.
    n = np.uint64(count)
    left, right, to = np.uint64(left), np.uint64(right), np.uint64(to)
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    w1, w2, w3, w4 = weights[0], weights[1], weights[2], weights[3]
    for i in range(n):
        a, b = left + i, right + i
        out[to + i] += ((w1 * (values[a + three] + values[b]) + w2 * (values[a + two] + values[b + one]))
                   + (w3 * (values[a + one] + values[b + two]) + w4 * (values[a] + values[b + three])))


# ---- Local maxima, positions between the pixels, orientation ----


@_kernel
def _local_maxima(response, minimum, first, last):
    """Those in the rows from `first` to before `last`."""
    height, width = response.shape
    capacity = ((last - first + 1) // 2) * ((width + 1) // 2) + 8   # of two neighbours only one is a maximum
    found_x, found_y = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    words = np.zeros(width // 8 + 1, np.uint64)
    flags = words.view(np.uint8)
    minimum = np.float32(minimum)
    outside = np.full(width, -np.inf, np.float32)
    count = 0
    for y in range(first, last):
        above = response[y - 1] if y > 0 else outside
        below = response[y + 1] if y < height - 1 else outside
        _flag_maxima(response[y], above, below, minimum, flags)
        flags[0] = _is_maximum(response, 0, y, minimum)
        flags[width - 1] = _is_maximum(response, width - 1, y, minimum)
        start = count
        for word in range(len(words)):
            if words[word] != 0:
                # Each is written, and stays if it is one: a branch would be guessed wrongly at every maximum.
                for x in range(8 * word, 8 * word + 8):
                    found_x[count] = x
                    count += flags[x]
        found_y[start:count] = y
    return found_x[:count].copy(), found_y[:count].copy()


@_kernel
def _flag_maxima(row, above, below, minimum, flags):
    """1 at the maxima of a row but for its two ends, else 0."""
    one, two = np.uint64(1), np.uint64(2)
    for i in range(np.uint64(max(len(row) - 2, 0))):
        value = row[i + one]
        before = row[i] if row[i] > minimum else minimum
        before = above[i] if above[i] > before else before
        before = above[i + one] if above[i + one] > before else before
        before = above[i + two] if above[i + two] > before else before
        after = below[i] if below[i] > row[i + two] else row[i + two]
        after = below[i + one] if below[i + one] > after else after
        after = below[i + two] if below[i + two] > after else after
        flags[i + one] = 1 if (value > before) & (value >= after) else 0


@_kernel
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


@_kernel
def refine(response, x, y):
    """Tops of the quadratics through the 3x3 values; reference: `maxima.reference_refine`."""
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
        g_x, g_y = (right - left) / 2, (below - above) / 2
        s_xx, s_yy = right - 2 * middle + left, below - 2 * middle + above
        s_xy = (np.float64(response[v + 1, u + 1]) - np.float64(response[v + 1, u - 1])
                - np.float64(response[v - 1, u + 1]) + np.float64(response[v - 1, u - 1])) / 4
        determinant = s_xx * s_yy - s_xy * s_xy
        if determinant > 0 and s_xx < 0:
            refined_x[i] += min(max((s_xy * g_y - s_yy * g_x) / determinant, -0.5), 0.5)
            refined_y[i] += min(max((s_xy * g_x - s_xx * g_y) / determinant, -0.5), 0.5)
    return refined_x, refined_y


def smoothed_gradients(image: np.ndarray, x: np.ndarray, y: np.ndarray,
                       sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Gradient of the smoothed image at each point; reference: `orientation.reference_gradients`."""
    return _smoothed_gradients(_read_only(image), x.astype(np.float64), y.astype(np.float64), float(sigma))


@_kernel
def _smoothed_gradients(image, x, y, sigma):
    height, width = image.shape
    radius = int(np.ceil(3 * sigma))
    side = 2 * radius + 1
    n = np.uint64(side)
    gradient_x, gradient_y = np.zeros(len(x), np.float64), np.zeros(len(x), np.float64)
    weights_x, slopes_x, weights_y, slopes_y = np.empty((4, side), np.float64)
    weighed, sloped = np.empty(side, np.float64), np.empty(side, np.float64)
    spread = np.exp(-1 / sigma ** 2) if sigma > 0.5 else 0.0
    for i in range(len(x)):
        left, top = np.int64(np.rint(x[i])) - radius, np.int64(np.rint(y[i])) - radius
        _gaussian_and_slope(left - x[i], sigma, spread, weights_x, slopes_x)
        _gaussian_and_slope(top - y[i], sigma, spread, weights_y, slopes_y)
        # Seen from the value in the middle, a flat patch is zero, and its gradient is so exactly.
        middle = np.float64(image[top + radius, left + radius])
        inside = left >= 0 and left + side <= width
        weighed[:] = 0
        sloped[:] = 0
        for row in range(side):
            v = _reflect(top + row, height)
            weight, slope = weights_y[row], slopes_y[row]
            if inside:
                for column in range(n):
                    value = np.float64(image[v, np.uint64(left) + column]) - middle
                    weighed[column] += weight * value
                    sloped[column] += slope * value
            else:
                for column in range(side):
                    value = np.float64(image[v, _reflect(left + column, width)]) - middle
                    weighed[column] += weight * value
                    sloped[column] += slope * value
        for column in range(n):
            gradient_x[i] += slopes_x[column] * weighed[column]
            gradient_y[i] += weights_x[column] * sloped[column]
    return gradient_x, gradient_y


@_kernel
def _gaussian_and_slope(start, sigma, spread, weights, slopes):
    """Gaussian at start, start + 1, ..., and its derivative, up to a common factor, with no response to flat areas."""
    total, tilt = 0.0, 0.0
    weight = np.exp(-start ** 2 / (2 * sigma ** 2))
    ratio = np.exp(-(2 * start + 1) / (2 * sigma ** 2))   # of the second to the first; the next is `spread` times that
    for i in range(len(weights)):
        distance = start + i
        if spread == 0:   # so narrow that the ratios leave the range of numbers
            weight = np.exp(-distance ** 2 / (2 * sigma ** 2))
        weights[i] = weight
        slopes[i] = distance * weight
        total += weight
        tilt += slopes[i]
        weight *= ratio
        ratio *= spread
    for i in range(len(weights)):
        slopes[i] -= weights[i] * (tilt / total)


# ---- Sorting ----

_DIGIT = 11   # bits


def strongest_first(values: np.ndarray) -> np.ndarray:
    """Indices from the largest value to the least, of equals the lower first; reference: NumPy's stable argsort."""
    # The bits of a positive double rise with it, those of a negative one fall; -0.0 becomes 0.0.
    bits = (values + 0.0).view(np.uint64)
    return _order_of_keys(np.where(bits >> np.uint64(63), bits, ~bits & np.uint64(2 ** 63 - 1)))


@_kernel
def _order_of_keys(keys):
    """Stable radix sort: indices that bring keys (uint64) into rising order. An unchanging digit costs little."""
    size = len(keys)
    order = np.arange(size)
    if size < 64:
        for i in range(1, size):
            moved, at = order[i], i
            while at > 0 and keys[order[at - 1]] > keys[moved]:
                order[at] = order[at - 1]
                at -= 1
            order[at] = moved
        return order
    digits = 64 // _DIGIT + 1
    mask = np.uint64((1 << _DIGIT) - 1)
    counts = np.zeros((digits, 1 << _DIGIT), np.int64)
    for i in range(size):
        key = keys[i]
        for digit in range(digits):
            counts[digit, np.int64((key >> np.uint64(_DIGIT * digit)) & mask)] += 1
    other_keys, other_order = np.empty(size, np.uint64), np.empty(size, np.int64)
    for digit in range(digits):
        shift = np.uint64(_DIGIT * digit)
        count = counts[digit]
        if count[np.int64((keys[0] >> shift) & mask)] == size:
            continue
        start = 0
        for bucket in range(len(count)):
            start, count[bucket] = start + count[bucket], start
        for i in range(size):
            value = np.int64((keys[i] >> shift) & mask)
            other_keys[count[value]], other_order[count[value]] = keys[i], order[i]
            count[value] += 1
        keys, other_keys = other_keys, (keys if digit > 0 else np.empty(size, np.uint64))
        order, other_order = other_order, order
    return order


# ---- Adaptive non-maximal suppression ----

_LEAF = 8   # points to a leaf of the tree, at the most


@_kernel
def significantly_stronger(responses, robustness):
    """How many of the first ones are significantly stronger; reference: `filters.reference_stronger`."""
    result = np.empty(len(responses), np.int64)
    exceeding, stronger = 0, 0
    for i in range(len(responses)):
        while exceeding < len(responses) and robustness * responses[exceeding] > responses[i]:
            exceeding += 1
        while responses[stronger] > responses[i]:
            stronger += 1
        result[i] = min(exceeding, stronger)
    return result


@_kernel
def suppression_radii(points, stronger, count):
    """Suppression radius of each point; reference: `filters.reference_radii`.

    Point i is suppressed by the first stronger[i] points. A balanced tree of bounding boxes over the points knows the
    first point (the lowest index) in each node. A search begins in the point's own leaf, climbs, and leaves out the
    nodes that are too far or hold nothing before stronger[i]. No arrangement of the points unbalances the tree.

    Only the `count` largest radii are sought exactly: a search ends once it is below as many radii as that, and what
    it has found by then stands for the radius.
    """
    size = len(points)
    leaves = 1
    while leaves * _LEAF < size:
        leaves *= 2
    order = _neighbours_together(points)
    starts = np.empty(leaves + 1, np.int64)
    for leaf in range(leaves + 1):
        starts[leaf] = size * leaf // leaves
    sorted_points, leaf_of = np.empty((size, 2), np.float64), np.empty(size, np.int64)
    for leaf in range(leaves):
        for i in range(starts[leaf], starts[leaf + 1]):
            leaf_of[order[i]] = leaf
            sorted_points[i, 0], sorted_points[i, 1] = points[order[i], 0], points[order[i], 1]
    boxes, first = _build_tree(sorted_points, order, starts)

    radii = np.full(size, np.inf)
    count = 0 if count >= size else max(count, 1)
    largest = np.full(max(count, 1), -1.0)   # the `count` largest radii so far: a heap, its least in front
    stack, distances = np.empty(128, np.int64), np.empty(128, np.float64)
    # The strong ones set the mark; the many others follow leaf by leaf, where memory is near and most fall at once.
    leading = min(4 * count, size)
    for i in range(leading):
        if stronger[i] > 0:
            radii[i] = _nearest(points[i, 0], points[i, 1], stronger[i], largest[0], leaf_of[i],
                                order, sorted_points, starts, boxes, first, stack, distances)
        if radii[i] > largest[0]:
            _replace_least(largest, radii[i])
    for leaf in range(leaves):
        bound, suppressing = _certainly_suppressed(largest[0], leaves + leaf, boxes, first)
        for at in range(starts[leaf], starts[leaf + 1]):
            i = order[at]
            if i < leading:
                continue
            if stronger[i] > suppressing:
                radii[i] = bound
                continue
            if stronger[i] > 0:
                radii[i] = _nearest(points[i, 0], points[i, 1], stronger[i], largest[0], leaf,
                                    order, sorted_points, starts, boxes, first, stack, distances)
            if count > 0 and radii[i] > largest[0]:
                _replace_least(largest, radii[i])
    return radii


@_kernel
def _certainly_suppressed(enough, node, boxes, first):
    """A bound below `enough` on the radius of all points of a leaf that the returned index, or a lower one, suppresses.

    The largest node round the leaf that is less than `enough` across decides: wherever in it its first point lies.
    """
    bound, suppressing = 0.0, len(boxes) * _LEAF
    while node > 0:
        dx, dy = boxes[node, 2] - boxes[node, 0], boxes[node, 3] - boxes[node, 1]
        across = np.sqrt(dx * dx + dy * dy)
        if not across < enough:
            break
        bound, suppressing = across, first[node]
        node //= 2
    return bound, suppressing


@_kernel
def _nearest(x, y, before, enough, leaf, order, points, starts, boxes, first, stack, distances):
    """Distance to the nearest of the points before `before`; any distance to one that is less than `enough` will do."""
    leaves = len(starts) - 1
    best = np.inf
    climbing = leaves + leaf   # the subtree of this node has been searched, or lies on the stack
    node, depth = climbing, 0
    while True:
        if node >= leaves:
            for i in range(starts[node - leaves], starts[node - leaves + 1]):
                if order[i] < before:
                    dx, dy = points[i, 0] - x, points[i, 1] - y
                    best = min(best, dx * dx + dy * dy)
            if np.sqrt(best) < enough:
                break
            node = 0
        else:
            near, far = 2 * node, 2 * node + 1
            to_near = _squared_distance(x, y, boxes, near) if first[near] < before else np.inf
            to_far = _squared_distance(x, y, boxes, far) if first[far] < before else np.inf
            if to_far < to_near:
                near, far, to_near, to_far = far, near, to_far, to_near
            if to_far < best:
                stack[depth], distances[depth] = far, to_far
                depth += 1
            node = near if to_near < best else 0
        while node == 0 and depth > 0:
            depth -= 1
            if distances[depth] < best:
                node = stack[depth]
        while node == 0 and climbing > 1:
            sibling = climbing ^ 1
            if first[sibling] < before and _squared_distance(x, y, boxes, sibling) < best:
                node = sibling
            climbing >>= 1
        if node == 0:
            break
    return np.sqrt(best)


@_kernel
def _squared_distance(x, y, boxes, node):
    dx = max(boxes[node, 0] - x, x - boxes[node, 2], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 3], 0.0)
    return dx * dx + dy * dy


@_kernel
def _replace_least(heap, value):
    size = len(heap)
    at = 0
    while 2 * at + 1 < size:
        child = 2 * at + 1
        if child + 1 < size and heap[child + 1] < heap[child]:
            child += 1
        if heap[child] >= value:
            break
        heap[at] = heap[child]
        at = child
    heap[at] = value


@_kernel
def _build_tree(points, order, starts):
    """Bounding box (x, y, x, y) and lowest index of each node; the points come in the order of the leaves.

    Node 1 is the root, node k has the children 2 k and 2 k + 1, and the last `leaves` nodes are the leaves.
    """
    size, leaves = len(points), len(starts) - 1
    boxes = np.empty((2 * leaves, 4), np.float64)
    first = np.full(2 * leaves, size)
    for leaf in range(leaves):
        node = leaves + leaf
        left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
        for i in range(starts[leaf], starts[leaf + 1]):
            x, y = points[i, 0], points[i, 1]
            left, top, right, bottom = min(left, x), min(top, y), max(right, x), max(bottom, y)
            first[node] = min(first[node], order[i])
        boxes[node, 0], boxes[node, 1], boxes[node, 2], boxes[node, 3] = left, top, right, bottom
    for node in range(leaves - 1, 0, -1):
        a, b = 2 * node, 2 * node + 1
        first[node] = min(first[a], first[b])
        boxes[node, 0], boxes[node, 1] = min(boxes[a, 0], boxes[b, 0]), min(boxes[a, 1], boxes[b, 1])
        boxes[node, 2], boxes[node, 3] = max(boxes[a, 2], boxes[b, 2]), max(boxes[a, 3], boxes[b, 3])
    return boxes, first


@_kernel
def _neighbours_together(points):
    """An order of the points in which neighbours mostly follow each other: along a Z curve, fine as needed.

    The curve has 2^16 steps to a side. Where more than a leaf of points fall into one cell, as in tight clusters,
    they are ordered along a curve of their own, and so on.
    """
    size = len(points)
    order = np.arange(size)
    pending = np.empty((size // _LEAF + 2, 2), np.int64)
    pending[0, 0], pending[0, 1] = 0, size
    count = 1
    while count > 0:
        count -= 1
        low, high = pending[count, 0], pending[count, 1]
        left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
        for i in range(low, high):
            x, y = points[order[i], 0], points[order[i], 1]
            left, top, right, bottom = min(left, x), min(top, y), max(right, x), max(bottom, y)
        extent = max(right - left, bottom - top)
        if not 1e-290 < extent < 1e300:
            continue   # all in one place, or out of any scale
        scale = 65535 / extent
        keys = np.empty(high - low, np.uint64)
        for i in range(low, high):
            x, y = points[order[i], 0], points[order[i], 1]
            keys[i - low] = (_with_gaps(np.uint64((x - left) * scale))
                             | (_with_gaps(np.uint64((y - top) * scale)) << np.uint64(1)))
        along = _order_of_keys(keys)
        order[low:high] = order[low:high][along]
        start = 0
        for i in range(1, high - low + 1):
            if i == high - low or keys[along[i]] != keys[along[start]]:
                if i - start > _LEAF:
                    pending[count, 0], pending[count, 1] = low + start, low + i
                    count += 1
                start = i
    return order


@_kernel
def _with_gaps(value):
    """The 16 bits of a number with a zero before each."""
    value = (value | (value << np.uint64(8))) & np.uint64(0x00FF00FF)
    value = (value | (value << np.uint64(4))) & np.uint64(0x0F0F0F0F)
    value = (value | (value << np.uint64(2))) & np.uint64(0x33333333)
    return (value | (value << np.uint64(1))) & np.uint64(0x55555555)
