"""The Harris response of whole images in one pass; reference: response.py."""

from __future__ import annotations

import functools
from typing import Callable

import numpy as np

from rvc_features.kernels import gaussian, large_box, smallest_box
from rvc_features.kernels.compiler import LEAST_WIDTH, bands, in_bands, installed, kernel, read_only
from rvc_features.kernels.rows import (
    gradient_buffers,
    new_map,
    next_gradient_parts,
    reflect,
    reflect_ends,
    row_lead,
    row_length,
    running_sums,
    sobel_gradient,
    zeros,
)

if installed:
    from rvc_features.kernels.instructions import HALF
    from rvc_features.kernels.vectors import (
        LANES,
        converted,
        load,
        load_half,
        maximum,
        splat,
        splat_half,
        store,
        to_float32,
        widened,
    )

LARGEST_BOX = 45   # pixels: the largest odd window whose sums of Sobel products fit in 32 bits, w^2 (4 * 255)^2 < 2^31
_LEAST_STREAMED = 1 << 20   # pixels: smaller maps are read from a near cache, which is worth more than what is saved


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
    return way(image.dtype, image.shape, window_size, window, harris_k, derivative_sigma)(image, out)


@functools.lru_cache(maxsize=64, typed=True)
def way(dtype: np.dtype, shape: tuple[int, int], window_size: int, window: str, harris_k: float,
        derivative_sigma: float) -> Callable[[np.ndarray, np.ndarray | None], tuple[np.ndarray, float]]:
    """`response` as a function of image and `out`, for that type and shape; reference: `response.reference_response`.

    Looked up, once it was found: where something else has had the caches, each step of Python takes microseconds.
    """
    height, width = shape
    if width < LEAST_WIDTH:
        raise ValueError(f'image must be at least {LEAST_WIDTH} pixels wide; got {width}')
    fill_in = _way_of_rows(dtype, shape, int(window_size), window, harris_k, derivative_sigma)
    can_be_streamed = width % LANES == 0 and height * width >= _LEAST_STREAMED

    def compute(image: np.ndarray, out: np.ndarray | None) -> tuple[np.ndarray, float]:
        image = read_only(image)
        response, streamed = (new_map(height, width), can_be_streamed) if out is None else (out, False)
        if bands(height, width) == 1:
            return response, fill_in(image, response, streamed, 0, height)
        return response, max(in_bands(lambda *rows: fill_in(image, response, streamed, *rows), height, width))
    return compute


def _way_of_rows(dtype: np.dtype, shape: tuple[int, int], window_size: int, window: str, harris_k: float,
                 derivative_sigma: float) -> Callable[..., float]:
    """What fills in the response in the rows from one to before another, and returns the largest value in them.

    A function of the image, of the response, of whether that may go past the caches, and of the rows.
    """
    taps = _gaussian_taps(int(np.ceil(4 * derivative_sigma)), derivative_sigma) if derivative_sigma > 0 else None
    exact = dtype == np.uint8 and taps is None
    gradient, product = (_INT16, _INT32) if exact else (_FLOAT64, _FLOAT64)
    single_k = np.float32(harris_k)
    if window == 'box':
        if not exact or harris_k < LEAST_K_IN_SINGLE_PRECISION:
            settings = taps, gradient, product, window_size, float(harris_k)
            return lambda image, out, _, *rows: _box_response(image, *settings, out, *rows)
        if window_size == 3:
            return functools.partial(smallest_box.response, single_k)
        return lambda image, out, _, *rows: large_box.response(image, window_size, single_k, out, *rows)
    if exact and 3 < window_size <= min(LARGEST_BOX, *shape) and shape[1] >= gaussian.LEAST_WIDTH:
        return functools.partial(gaussian.response, *gaussian.arguments(_window_taps(window_size), harris_k))
    weights = _gaussian_weights(window_size)   # for a window of 3, half of what gaussian.py weighs by is zero
    return lambda image, out, _, *rows: _gaussian_response(image, taps, gradient, weights, single_k, out, *rows)


# For their types: what a kernel keeps gradients and their products in.
_INT16, _INT32, _FLOAT64 = (np.empty(0, dtype) for dtype in (np.int16, np.int32, np.float64))

# Along an edge A C - B^2 cancels, and what single precision leaves over is 1e-7 of its terms: nothing beside
# k (A + C)^2. Where k is so small that nothing else is left either, exact sums are multiplied in double precision.
LEAST_K_IN_SINGLE_PRECISION = 0.01


@functools.lru_cache(maxsize=64)
def _gaussian_taps(radius: int, sigma: float) -> np.ndarray:
    """Weights of a Gaussian from its centre outwards, float64, shape (radius + 1,); all of them sum to one."""
    taps = np.exp(-np.arange(radius + 1) ** 2 / (2 * sigma ** 2))
    return taps / (2 * taps.sum() - taps[0])


@functools.lru_cache(maxsize=64)
def _gaussian_weights(window_size: int) -> np.ndarray:
    """Weights of the Gaussian window, with a zero before and after, float32, shape (window_size + 2,)."""
    side = _window_taps(window_size)
    return np.pad(np.concatenate((side[:0:-1], side)), 1).astype(np.float32)


def _window_taps(window_size: int) -> np.ndarray:
    return _gaussian_taps(window_size // 2, 0.3 * ((window_size - 1) * 0.5 - 1) + 0.8)


@kernel
def _harris(a, b, c, harris_k):
    """H = A C - B^2 - k (A + C)^2."""
    trace = a + c
    return a * c - b * b - harris_k * (trace * trace)


@kernel
def _box_response(image, taps, gradient, product, window_size, harris_k, out, first, last):
    """Running sums down the columns, sums of neighbours along the row."""
    height, width = image.shape
    radius = window_size // 2
    lead, slots = row_lead(radius), min(height, window_size + 1)
    length = row_length(width, lead)
    smoothed, rows, parts = gradient_buffers(width, taps, gradient)
    gradients = zeros((slots + 1) * 2 * length, gradient).reshape((slots + 1, 2, length))
    nothing = slots   # the last row stays zero: what the first windows have nothing to subtract from
    columns, running = zeros(3 * length, product).reshape((3, length)), zeros(3 * length, product)
    largest = np.full(LANES, -np.inf, np.float32)
    done = begin = max(0, first - radius)
    for y in range(first, last):
        while done <= min(height - 1, y + radius):
            next_gradient_parts(image, done, done == begin, taps, smoothed, rows, parts)
            at = done % slots * 2 * gradients.shape[2]
            for i in range(0, width, LANES):
                x_gradient, y_gradient = sobel_gradient(parts, i)
                store(gradients, at + i, x_gradient)
                store(gradients, at + gradients.shape[2] + i, y_gradient)
            done += 1
        if y == first:
            for j in range(-radius, radius + 1):
                _slide(columns, lead, gradients, reflect(y + j, height) % slots, nothing, width)
        else:
            _slide(columns, lead, gradients, reflect(y + radius, height) % slots,
                   reflect(y - 1 - radius, height) % slots, width)
        for part in range(3):
            reflect_ends(columns[part], lead, width, radius)
        _box_row(columns, running, lead - radius, window_size, harris_k, out, y, largest)
    return largest.max()


@kernel
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


@kernel
def _box_row(columns, running, start, size, harris_k, out, y, largest):
    """One row of the response from the sums down the columns; the first window begins at `start`.

    A larger window's sum is the difference of two running sums; integers may wrap round in these, not in that.
    """
    width, stride = out.shape[1], columns.shape[1]
    many = size > 7
    if many:
        for part in range(0, 3 * stride, stride):
            before = converted(splat_half(np.int16(0)), columns)
            for i in range(part, part + start + width + size, HALF):
                sums, before = running_sums(before, load_half(columns, i))
                store(running, i + 1, sums)
    harris_k = splat(harris_k)
    scale = converted(splat(1 / size ** 4), harris_k)
    most = load(largest, 0)
    for i in range(0, width, LANES):
        i = min(i, width - LANES)
        at = start + i
        if many:
            a = load(running, at + size) - load(running, at)
            b = load(running, at + stride + size) - load(running, at + stride)
            c = load(running, at + 2 * stride + size) - load(running, at + 2 * stride)
        else:
            a, b, c = load(columns, at), load(columns, at + stride), load(columns, at + 2 * stride)
            for j in range(at + 1, at + size):
                a += load(columns, j)
                b += load(columns, j + stride)
                c += load(columns, j + 2 * stride)
        response = _harris(converted(a, scale), converted(b, scale), converted(c, scale), harris_k) * scale
        store(out, y * width + i, to_float32(response))
        most = maximum(to_float32(response), most)
    store(largest, 0, most)


@kernel
def _gaussian_response(image, taps, gradient, weights, harris_k, out, first, last):
    """The same with weighted sums, two rows at a time, for then each row of products is read half as often."""
    height, width = image.shape
    size = len(weights) - 2
    radius = size // 2
    lead, slots = row_lead(radius), min(height, size + 1)
    length = row_length(width, lead)
    smoothed, rows, parts = gradient_buffers(width, taps, gradient)
    products = zeros(slots * 3 * length, weights)
    columns = zeros(2 * 3 * length, weights).reshape((2, 3, length))
    offsets = np.empty(size + 1, np.int64)
    largest = np.full(LANES, -np.inf, np.float32)
    done = begin = max(0, first - radius)
    for y in range(first, last, 2):
        while done <= min(height - 1, y + 1 + radius):
            next_gradient_parts(image, done, done == begin, taps, smoothed, rows, parts)
            at = done % slots * 3 * length
            for i in range(0, width, LANES):
                x_gradient, y_gradient = sobel_gradient(parts, i)
                across, down = to_float32(x_gradient), to_float32(y_gradient)
                store(products, at + i, across * across)
                store(products, at + length + i, across * down)
                store(products, at + 2 * length + i, down * down)
            done += 1
        for j in range(size + 1):
            offsets[j] = reflect(y - radius + j, height) % slots * 3 * length
        for part in range(3):
            _weigh_rows(products, offsets, part * length, weights, width, columns, part * length + lead)
        for row in range(min(2, last - y)):
            for part in range(3):
                reflect_ends(columns[row, part], lead, width, radius)
            _gaussian_row(columns, row * 3 * length + lead - radius, weights, harris_k, out, y + row, largest)
    return largest.max()


@kernel
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


@kernel
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
