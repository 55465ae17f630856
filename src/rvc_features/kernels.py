"""The hot loops, compiled by Numba. Each has its readable reference in the module that calls it.

Nothing here is needed: where Numba is missing or does not work, `available()` is False, one line in the log says so,
and the callers take their reference path.

Whole images are gone over row by row, so that everything but the image stays in the nearest caches, and along a row by
vectors of sixteen numbers (vectors.py). Rows that are read beyond their ends lie in buffers with room for that; in an
image the last vector of a row ends where the row does, and does some of the work of the one before it again.

The kernels release the GIL and hold no state: they may run in several threads at once. The two that go over whole
images do so themselves: each thread takes a band of rows, as many as OpenCV has threads (`cv2.setNumThreads`).
"""

from __future__ import annotations

import functools
import logging
import os
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Callable

import cv2
import numpy as np

try:
    import numba

    from rvc_features.vectors import (
        LANES,
        load,
        lowest_bit,
        maximum,
        splat,
        store,
        sum_of,
        to_float32,
        to_float64,
        where_greater,
        where_not_less,
        widened,
    )
    _reason_against = 'NUMBA_DISABLE_JIT is set' if getattr(numba.config, 'DISABLE_JIT', False) else ''
except Exception as error:   # an ImportError, or whatever a Numba that does not fit this NumPy raises
    _reason_against = str(error)

LARGEST_BOX = 45   # pixels: the largest odd window whose sums of Sobel products fit in 32 bits, w^2 (4 * 255)^2 < 2^31
LEAST_WIDTH = 18   # pixels: a vector, and one more on either side

_logger = logging.getLogger('rvc_features')


@functools.lru_cache(maxsize=None)
def available() -> bool:
    """Whether the kernels can be called; the first call says in the log when they can't."""
    if _reason_against:
        _logger.warning('Without Numba the detector runs slower, on OpenCV and NumPy alone (%s).', _reason_against)
    return not _reason_against


def compile_all() -> float:
    """Compile what a detector needs for uint8 images, or load it from Numba's cache; the seconds it took.

    Without this the first frame waits for it: some twenty seconds the first time on a machine, half a second later.
    """
    start = time.perf_counter()
    if available():
        image = np.zeros((40, 40), np.uint8)
        image[10:, 10:] = 255
        for window in ('box', 'gaussian'):
            for derivative_sigma in (1.0, 0.0):
                values, _ = response(image, 5, window, 0.04, derivative_sigma)
        x, y = refine(values, *local_maxima(values, 10.0))
        smoothed_gradients(image, x, y, 2.5)
        points, responses = np.column_stack((x, y)), np.ones(len(x))
        strongest_first(responses)
        strongest_first(responses.astype(np.float32))
        stamp(np.zeros((40, 40, 3), np.uint8), x, y, responses, x.astype(np.int64), y.astype(np.int64), 2.0, (0, 0, 0))
        suppression_radii(points, significantly_stronger(responses, 0.9), 1)
    return time.perf_counter() - start


def response(image: np.ndarray, window_size: int, window: str, harris_k: float, derivative_sigma: float = 0.0,
             out: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Harris response and its largest value; reference: `response.reference_response`.

    Smoothing, gradients, their products, the window and the response are computed row by row in one pass. For uint8
    without smoothing gradients are exact, and so are the box window's sums. Smoothing, and the box window after it, are
    in double precision, the Gaussian window's sums in single precision.

    Parameters
    ----------
    image : ndarray, uint8 or float32, shape (H, W)
        At least as high and wide as the window, and `LEAST_WIDTH` wide.
    window_size : int
        Odd; for the box at most `LARGEST_BOX`.
    window : {'gaussian', 'box'}
    harris_k, derivative_sigma : float
    out : ndarray, float32, shape (H, W), contiguous, optional
        Where to write the response.
    """
    image = _read_only(image)
    height, width = image.shape
    if width < LEAST_WIDTH:
        raise ValueError(f'image must be at least {LEAST_WIDTH} pixels wide; got {width}')
    response = np.empty((height, width), np.float32) if out is None else out
    largest = _in_bands(lambda first, last: _response_of_rows(image, window_size, window, harris_k, derivative_sigma,
                                                              response, first, last), height, width)
    return response, max(largest)


def _response_of_rows(image: np.ndarray, window_size: int, window: str, harris_k: float, derivative_sigma: float,
                      out: np.ndarray, first: int, last: int) -> float:
    """Fill in the rows from `first` to before `last`; returns the largest value in them."""
    taps = _gaussian_taps(int(np.ceil(4 * derivative_sigma)), derivative_sigma) if derivative_sigma > 0 else None
    exact = image.dtype == np.uint8 and taps is None
    pixel, gradient, product = (_UINT8, _INT16, _INT32) if exact else (_FLOAT64, _FLOAT64, _FLOAT64)
    if window == 'box':
        return _box_response(image, taps, pixel, gradient, product, int(window_size), float(harris_k), out, first, last)
    weights = _gaussian_weights(window_size)
    return _gaussian_response(image, taps, pixel, weights, np.float32(harris_k), out, first, last)


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

# For their types: what a kernel keeps pixels, gradients and their products in.
_UINT8, _INT16, _INT32, _FLOAT64 = (np.empty(0, dtype) for dtype in (np.uint8, np.int16, np.int32, np.float64))


@functools.lru_cache(maxsize=64)
def _gaussian_taps(radius: int, sigma: float) -> np.ndarray:
    """Weights of a Gaussian from its centre outwards, float64, shape (radius + 1,); all of them sum to one."""
    taps = np.exp(-np.arange(radius + 1) ** 2 / (2 * sigma ** 2))
    return taps / (2 * taps.sum() - taps[0])


@functools.lru_cache(maxsize=64)
def _gaussian_weights(window_size: int) -> np.ndarray:
    """Weights of the Gaussian window, with a zero before and after, float32, shape (window_size + 2,)."""
    side = _gaussian_taps(window_size // 2, 0.3 * ((window_size - 1) * 0.5 - 1) + 0.8)
    return np.pad(np.concatenate((side[:0:-1], side)), 1).astype(np.float32)


# ---- How it is done ----

def _kernel(function: Callable[..., Any]) -> Any:
    """Numba's decorator with the options of this module; without Numba the function stays as it is."""
    if _reason_against:
        return function
    options: dict[str, Any] = {'nogil': True, 'error_model': 'numpy'}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:   # no place to write a cache: a read-only installation without a home directory
        return numba.njit(**options)(function)


def _read_only(image: np.ndarray) -> np.ndarray:
    """A contiguous read-only view or copy: one type for Numba, which would compile again for each kind of array."""
    view = np.ascontiguousarray(image)[:]
    view.flags.writeable = False
    return view


@_kernel
def _zeros(count, like):
    """Array of zeros of the type of `like`, from a cache line on, so that aligned vectors do not straddle two.

    Zeros, for what lies beyond the ends of rows is not used, but slow if it happens to be tiny.
    """
    size = count * like.itemsize
    memory = np.zeros(size + 64, np.uint8)
    start = 63 - (np.int64(memory.ctypes.data) + 63) % 64
    return memory[start:start + size].view(like.dtype)


@_kernel
def _row_length(width, lead):
    """Of a buffer for rows of that width that begin at `lead`, with room to read beyond either end; in cache lines."""
    return -(-(lead + width + max(lead, 1) + 2 * LANES) // 64) * 64


@_kernel
def _lead(radius):
    """Where a row begins that is read from `radius` before its first pixel: at a cache line."""
    return -(-radius // LANES) * LANES


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
def _reflect_ends(row, start, width, radius):
    """Continue a row that begins at `start` by `radius` numbers on either side."""
    end = start + width - 1
    if radius < width:
        for j in range(1, radius + 1):
            row[start - j] = row[start + j]
        for j in range(1, radius + 1):
            row[end + j] = row[end - j]
    else:
        for j in range(1, radius + 1):
            row[start - j] = row[start + _reflect(j, width)]
            row[end + j] = row[start + _reflect(width - 1 + j, width)]


@_kernel
def _image_rows(width, taps, pixel):
    """Room for one row on its way to be smoothed, and for the three rows of the image that a gradient needs."""
    length = _row_length(width, 1)
    margin = 0 if taps is None else len(taps) - 1
    return _zeros(width + 2 * margin + LANES, _FLOAT64), _zeros(3 * length, pixel).reshape((3, length))


@_kernel
def _next_gradient_rows(image, y, is_first, taps, smoothed, rows):
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
            _reflect_ends(row, 1, width, 1)
    length = rows.shape[1]
    return _reflect(y - 1, height) % 3 * length, y % 3 * length, _reflect(y + 1, height) % 3 * length


@_kernel
def _smooth_row(image, y, taps, column, out):
    """Row y of the smoothed image, from out[1] on: down the columns, then along the row."""
    height, width = image.shape
    radius = len(taps) - 1
    for i in range(0, width, LANES):
        i = min(i, width - LANES)
        total = splat(taps[0]) * to_float64(load(image, y * width + i))
        for j in range(1, radius + 1):
            above, below = _reflect(y - j, height), _reflect(y + j, height)
            pair = widened(load(image, above * width + i)) + widened(load(image, below * width + i))
            total += splat(taps[j]) * to_float64(pair)
        store(column, radius + i, total)
    _reflect_ends(column, radius, width, radius)
    for i in range(0, width, LANES):
        total = splat(taps[0]) * load(column, radius + i)
        for j in range(1, radius + 1):
            total += splat(taps[j]) * (load(column, radius + i - j) + load(column, radius + i + j))
        store(out, 1 + i, total)


@_kernel
def _gradient(rows, above, here, below, i):
    """3x3 Sobel gradients of sixteen pixels from i on, in x and in y."""
    above, here, below = above + i, here + i, below + i
    a, b, c = widened(load(rows, above)), widened(load(rows, above + 1)), widened(load(rows, above + 2))
    d, e = widened(load(rows, here)), widened(load(rows, here + 2))
    f, g, h = widened(load(rows, below)), widened(load(rows, below + 1)), widened(load(rows, below + 2))
    return (c - a) + (e - d) + (e - d) + (h - f), (f - a) + (g - b) + (g - b) + (h - c)


@_kernel
def _harris(a, b, c, harris_k):
    """H = A C - B^2 - k (A + C)^2."""
    trace = a + c
    return a * c - b * b - harris_k * (trace * trace)


@_kernel
def _box_response(image, taps, pixel, gradient, product, window_size, harris_k, out, first, last):
    """Running sums down the columns, sums of neighbours along the row."""
    height, width = image.shape
    radius = window_size // 2
    lead, slots = _lead(radius), min(height, window_size + 1)
    length = _row_length(width, lead)
    smoothed, rows = _image_rows(width, taps, pixel)
    gradients = _zeros((slots + 1) * 2 * length, gradient).reshape((slots + 1, 2, length))
    zeros = slots   # the last row stays zero: what the first windows have nothing to subtract from
    columns = _zeros(3 * length, product).reshape((3, length))
    fours = _zeros(3 * length, product).reshape((3, length))
    largest = np.full(LANES, -np.inf, np.float32)
    done = begin = max(0, first - radius)
    for y in range(first, last):
        while done <= min(height - 1, y + radius):
            above, here, below = _next_gradient_rows(image, done, done == begin, taps, smoothed, rows)
            at = done % slots * 2 * gradients.shape[2]
            for i in range(0, width, LANES):
                x_gradient, y_gradient = _gradient(rows, above, here, below, i)
                store(gradients, at + i, x_gradient)
                store(gradients, at + gradients.shape[2] + i, y_gradient)
            done += 1
        if y == first:
            for j in range(-radius, radius + 1):
                _slide(columns, lead, gradients, _reflect(y + j, height) % slots, zeros, width)
        else:
            _slide(columns, lead, gradients, _reflect(y + radius, height) % slots,
                   _reflect(y - 1 - radius, height) % slots, width)
        for part in range(3):
            _reflect_ends(columns[part], lead, width, radius)
        _box_row(columns, fours, lead - radius, window_size, harris_k, out, y, largest)
    return largest.max()


@_kernel
def _slide(columns, lead, gradients, new, old, width):
    """Move the windows down by one row: the products of the new row come in, those of the old one go."""
    length, stride = gradients.shape[2], columns.shape[1]
    new, old = new * 2 * length, old * 2 * length
    for i in range(0, width, LANES):
        x_new, y_new = widened(load(gradients, new + i)), widened(load(gradients, new + length + i))
        x_old, y_old = widened(load(gradients, old + i)), widened(load(gradients, old + length + i))
        a, b, c = lead + i, lead + stride + i, lead + 2 * stride + i
        store(columns, a, load(columns, a) + (x_new - x_old) * (x_new + x_old))
        store(columns, b, load(columns, b) + (x_new * y_new - x_old * y_old))
        store(columns, c, load(columns, c) + (y_new - y_old) * (y_new + y_old))


@_kernel
def _box_row(columns, fours, start, size, harris_k, out, y, largest):
    """One row of the response from the sums down the columns; the first window begins at `start`.

    A large window is a sum of sums of four neighbours, and one more or less: every odd size is 4 q + 1 or 4 q - 1.
    """
    width, stride = out.shape[1], columns.shape[1]
    terms, distance, count = columns, 1, size
    if size > 7:
        for part in range(3):
            for i in range(part * stride + start, part * stride + start + width + size, LANES):
                pair, next_pair = load(columns, i) + load(columns, i + 1), load(columns, i + 2) + load(columns, i + 3)
                store(fours, i, pair + next_pair)
        terms, distance, count = fours, 4, (size + 1) // 4
    harris_k, scale = splat(harris_k), splat(1.0 / size ** 4)
    most = load(largest, 0)
    for i in range(0, width, LANES):
        i = min(i, width - LANES)
        at = start + i
        a, b, c = load(terms, at), load(terms, at + stride), load(terms, at + 2 * stride)
        for _ in range(1, count):
            at += distance
            a += load(terms, at)
            b += load(terms, at + stride)
            c += load(terms, at + 2 * stride)
        at = start + i + distance * count
        if distance * count < size:
            a += load(columns, at)
            b += load(columns, at + stride)
            c += load(columns, at + 2 * stride)
        elif distance * count > size:
            a -= load(columns, at - 1)
            b -= load(columns, at - 1 + stride)
            c -= load(columns, at - 1 + 2 * stride)
        # In double precision, for of whole numbers A C - B^2 cancels exactly along an edge.
        response = to_float32(_harris(to_float64(a), to_float64(b), to_float64(c), harris_k) * scale)
        store(out, y * width + i, response)
        most = maximum(response, most)
    store(largest, 0, most)


@_kernel
def _gaussian_response(image, taps, pixel, weights, harris_k, out, first, last):
    """The same with weighted sums, two rows at a time, for then each row of products is read half as often."""
    height, width = image.shape
    size = len(weights) - 2
    radius = size // 2
    lead, slots = _lead(radius), min(height, size + 1)
    length = _row_length(width, lead)
    smoothed, rows = _image_rows(width, taps, pixel)
    products = _zeros(slots * 3 * length, weights)
    columns = _zeros(2 * 3 * length, weights).reshape((2, 3, length))
    offsets = np.empty(size + 1, np.int64)
    largest = np.full(LANES, -np.inf, np.float32)
    done = begin = max(0, first - radius)
    for y in range(first, last, 2):
        while done <= min(height - 1, y + 1 + radius):
            above, here, below = _next_gradient_rows(image, done, done == begin, taps, smoothed, rows)
            at = done % slots * 3 * length
            for i in range(0, width, LANES):
                x_gradient, y_gradient = _gradient(rows, above, here, below, i)
                across, down = to_float32(x_gradient), to_float32(y_gradient)
                store(products, at + i, across * across)
                store(products, at + length + i, across * down)
                store(products, at + 2 * length + i, down * down)
            done += 1
        for j in range(size + 1):
            offsets[j] = _reflect(y - radius + j, height) % slots * 3 * length
        for part in range(3):
            _weigh_rows(products, offsets, part * length, weights, width, columns, part * length + lead)
        for row in range(min(2, last - y)):
            for part in range(3):
                _reflect_ends(columns[row, part], lead, width, radius)
            _gaussian_row(columns, row * 3 * length + lead - radius, weights, harris_k, out, y + row, largest)
    return largest.max()


@_kernel
def _weigh_rows(products, offsets, start, weights, width, columns, to):
    """Weighted sums down the columns, for one row and for the next, which begins one row of products later."""
    next_row = 3 * columns.shape[2]
    zero = splat(np.float32(0))
    for i in range(0, width, 2 * LANES):
        left, right, next_left, next_right = zero, zero, zero, zero
        for j in range(len(offsets)):
            at = offsets[j] + start + i
            here, there = load(products, at), load(products, at + LANES)
            weight, next_weight = splat(weights[j + 1]), splat(weights[j])
            left += weight * here
            right += weight * there
            next_left += next_weight * here
            next_right += next_weight * there
        store(columns, to + i, left)
        store(columns, to + i + LANES, right)
        store(columns, to + i + next_row, next_left)
        store(columns, to + i + next_row + LANES, next_right)


@_kernel
def _gaussian_row(columns, start, weights, harris_k, out, y, largest):
    """One row of the response from the weighted sums down the columns; the first window begins at `start`."""
    width, stride = out.shape[1], columns.shape[2]
    harris_k = splat(harris_k)
    most = load(largest, 0)
    for i in range(0, width, LANES):
        i = min(i, width - LANES)
        a = b = c = splat(np.float32(0))
        for j in range(len(weights) - 2):
            weight, at = splat(weights[j + 1]), start + i + j
            a += weight * load(columns, at)
            b += weight * load(columns, at + stride)
            c += weight * load(columns, at + 2 * stride)
        response = _harris(a, b, c, harris_k)
        store(out, y * width + i, response)
        most = maximum(response, most)
    store(largest, 0, most)


# ---- Local maxima, positions between the pixels, orientation ----


@_kernel
def _local_maxima(response, minimum, first, last):
    """Those in the rows from `first` to before `last`."""
    height, width = response.shape
    capacity = ((last - first + 1) // 2) * ((width + 1) // 2) + 8   # of two neighbours only one is a maximum
    found_x, found_y = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    least = splat(np.float32(minimum))
    count = 0
    for y in range(first, last):
        start = count
        by_vectors = 0 < y < height - 1 and width >= LEAST_WIDTH
        for x in range(1 if by_vectors else width):
            found_x[count] = x
            count += _is_maximum(response, x, y, minimum)
        for x in range(1, width - 1 if by_vectors else 0, LANES):
            begin = min(x, width - 1 - LANES)
            at = y * width + begin
            value = load(response, at)
            bits = where_greater(value, least)
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
                found_x[count] = begin + lowest_bit(bits)
                count += 1
                bits &= bits - 1
        if by_vectors:
            found_x[count] = width - 1
            count += _is_maximum(response, width - 1, y, minimum)
        found_y[start:count] = y
    return found_x[:count].copy(), found_y[:count].copy()


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
    length = (side + LANES - 1) // LANES * LANES
    bell = np.exp(-np.arange(radius + 1) ** 2 / (2 * sigma ** 2))
    weights_x, slopes_x = np.zeros(length, np.float64), np.zeros(length, np.float64)
    weights_y, slopes_y = np.zeros(length, np.float64), np.zeros(length, np.float64)
    patch = np.zeros(side * length, image.dtype)
    gradient_x, gradient_y = np.empty(len(x), np.float64), np.empty(len(x), np.float64)
    for i in range(len(x)):
        middle_x, middle_y = np.int64(np.rint(x[i])), np.int64(np.rint(y[i]))
        left, top = middle_x - radius, middle_y - radius
        _gaussian_and_slope(x[i] - middle_x, sigma, bell, weights_x, slopes_x)
        _gaussian_and_slope(y[i] - middle_y, sigma, bell, weights_y, slopes_y)
        # Seen from the value in the middle, a flat patch is zero, and its gradient is so exactly.
        middle = np.float64(image[_reflect(middle_y, height), _reflect(middle_x, width)])
        if left >= 0 and left + length <= width and top >= 0 and top + side <= height:
            gradient_x[i], gradient_y[i] = _weighed_patch(image, top * width + left, width, middle, side, weights_x,
                                                          slopes_x, weights_y, slopes_y)
        else:
            for row in range(side):
                for column in range(side):
                    patch[row * length + column] = image[_reflect(top + row, height), _reflect(left + column, width)]
            gradient_x[i], gradient_y[i] = _weighed_patch(patch, 0, length, middle, side, weights_x, slopes_x,
                                                          weights_y, slopes_y)
    return gradient_x, gradient_y


@_kernel
def _gaussian_and_slope(offset, sigma, bell, weights, slopes):
    """Gaussian round `offset`, and its derivative, up to a common factor, with no response to flat areas.

    The first weight is that of pixel -radius; what follows the last one stays 0. `bell` is half a Gaussian round 0.
    """
    radius = len(bell) - 1
    right = left = np.exp(-offset ** 2 / (2 * sigma ** 2))
    weights[radius] = right
    to_right = np.exp(offset / sigma ** 2)
    to_left = 1 / to_right
    for k in range(1, radius + 1):
        right *= to_right
        left *= to_left
        weights[radius + k], weights[radius - k] = right * bell[k], left * bell[k]
    weight, tilt = 0.0, 0.0
    for i in range(2 * radius + 1):
        slopes[i] = (i - radius - offset) * weights[i]
        weight += weights[i]
        tilt += slopes[i]
    tilt /= weight
    for i in range(2 * radius + 1):
        slopes[i] -= weights[i] * tilt


@_kernel
def _weighed_patch(values, start, stride, middle, side, weights_x, slopes_x, weights_y, slopes_y):
    """Sum of a patch times slopes in x and weights in y, and the other way round."""
    zero, middle = splat(0.0), splat(middle)
    gradient_x, gradient_y = zero, zero
    for i in range(0, len(weights_x), LANES):
        weighed, sloped = zero, zero
        for row in range(side):
            value = to_float64(load(values, start + row * stride + i)) - middle
            weighed += splat(weights_y[row]) * value
            sloped += splat(slopes_y[row]) * value
        gradient_x += load(slopes_x, i) * weighed
        gradient_y += load(weights_x, i) * sloped
    return sum_of(gradient_x), sum_of(gradient_y)


# ---- Drawing ----

def stamp(picture: np.ndarray, x: np.ndarray, y: np.ndarray, angle: np.ndarray, ring_x: np.ndarray,
          ring_y: np.ndarray, radius: float, colour: tuple[int, int, int]) -> None:
    """Draw a ring round each point, and a ray; reference: `drawing.reference_stamp`."""
    x, y, angle = (np.ascontiguousarray(values, np.float32) for values in (x, y, angle))
    _stamp(picture, x, y, angle, ring_x, ring_y, float(radius), colour)


@_kernel
def _stamp(picture, x, y, angle, ring_x, ring_y, radius, colour):
    height, width = picture.shape[:2]
    reach = max(np.abs(ring_x).max(), np.abs(ring_y).max())
    for i in range(len(x)):
        middle_x, middle_y = np.rint(x[i]), np.rint(y[i])
        if reach <= middle_x < width - reach and reach <= middle_y < height - reach:
            column, row = int(middle_x), int(middle_y)
            for j in range(len(ring_x)):
                _set_pixel(picture, row + ring_y[j], column + ring_x[j], colour)
        else:
            for j in range(len(ring_x)):
                _set_pixel_inside(picture, middle_y + ring_y[j], middle_x + ring_x[j], colour)
        if angle[i] >= 0:
            to_x, to_y = np.cos(np.radians(np.float64(angle[i]))), np.sin(np.radians(np.float64(angle[i])))
            for step in range(int(np.ceil(radius))):
                _set_pixel_inside(picture, np.rint(y[i] + to_y * step), np.rint(x[i] + to_x * step), colour)


@_kernel
def _set_pixel_inside(picture, row, column, colour):
    if 0 <= row < picture.shape[0] and 0 <= column < picture.shape[1]:
        _set_pixel(picture, int(row), int(column), colour)


@_kernel
def _set_pixel(picture, row, column, colour):
    picture[row, column, 0], picture[row, column, 1], picture[row, column, 2] = colour


# ---- Sorting ----

_DIGIT = 11   # bits


def strongest_first(values: np.ndarray) -> np.ndarray:
    """Indices from the largest value to the least, of equals the lower first; reference: NumPy's stable argsort.

    `values` are float32, float64 or whatever becomes float64.
    """
    values = np.asarray(values)
    if values.dtype != np.float32:
        values = values.astype(np.float64, copy=False)
    bits = (values + values.dtype.type(0)).view(f'u{values.itemsize}')   # -0.0 becomes 0.0
    return _strongest_first(bits)


@_kernel
def _strongest_first(bits):
    """The bits of a positive float rise with it, those of a negative one fall; they are overwritten."""
    top = 8 * bits.itemsize - 1
    for i in range(len(bits)):
        if not bits[i] >> bits.dtype.type(top):
            bits[i] = ~bits[i] & bits.dtype.type((1 << top) - 1)
    return _order_of_keys(bits)


@_kernel
def _order_of_keys(keys):
    """Stable radix sort: indices that bring unsigned keys into rising order. An unchanging digit costs little."""
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
    kind = keys.dtype.type
    digits = 8 * keys.itemsize // _DIGIT + 1
    mask = kind((1 << _DIGIT) - 1)
    counts = np.zeros((digits, 1 << _DIGIT), np.int64)
    for i in range(size):
        key = keys[i]
        for digit in range(digits):
            counts[digit, np.int64((key >> kind(_DIGIT * digit)) & mask)] += 1
    other_keys, other_order = np.empty(size, keys.dtype), np.empty(size, np.int64)
    for digit in range(digits):
        shift = kind(_DIGIT * digit)
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
        keys, other_keys = other_keys, (keys if digit > 0 else np.empty(size, keys.dtype))
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
