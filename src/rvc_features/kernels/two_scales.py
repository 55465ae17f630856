"""The strength at two scales of whole images in two passes, a coarse and a fine one; reference: two_scales.py."""

from __future__ import annotations

from typing import Any, NamedTuple, Tuple

import numpy as np

from rvc_features.kernels.compiler import LEAST_WIDTH, in_bands, installed, kernel, read_only
from rvc_features.kernels.resampling import enlarge_row, halve
from rvc_features.kernels.rows import reflect, reflect_ends, row_lead, row_length, zeros
from rvc_features.kernels.smoothing import in_pairs, smooth_row, widen_by_pairs, widen_columns, widen_row

if installed:
    from rvc_features.kernels.vectors import (
        LANES,
        load,
        maximum,
        quotient,
        splat,
        square_root,
        store,
        to_float32,
    )

# For their types: what a kernel keeps its numbers in.
_UINT16, _INT16, _INT32, _FLOAT32, _FLOAT64 = (np.empty(0, dtype) for dtype in (np.uint16, np.int16, np.int32,
                                                                                np.float32, np.float64))

Taps = Tuple[np.ndarray, np.ndarray, float]

_USUAL = 3   # radius of the usual window at either scale


class Weights(NamedTuple):
    """What the kernels take for images of one type, made ready once, for that takes as long as many rows."""

    halving: tuple[Any, ...]
    half: np.ndarray
    coarse: tuple[Any, ...]
    reach: int
    fine: tuple[Any, ...]

    @classmethod
    def of(cls, halving: np.ndarray, fine: Taps, coarse: Taps, dtype: Any) -> Weights:
        """Out of weights from their centre outwards.

        Parameters
        ----------
        halving : ndarray, float64
            Weights of the binomial before every second pixel is taken; whole numbers.
        fine, coarse : tuple
            Of either scale: the window's weights and those of the binomial before the second derivatives, the latter
            whole numbers; and the weight of the determinant of these.
        dtype : dtype
            Of the images: uint8 or float32.
        """
        total = int(_total(halving) ** 2)
        exact = np.dtype(dtype) == np.uint8
        if exact:
            unit, column, row, half, smooth, wide = total, _UINT16, _FLOAT32, _FLOAT32, _INT16, _INT32
        else:
            unit, column, row, half, smooth, wide = 1, _FLOAT64, _FLOAT64, _FLOAT64, _FLOAT64, _FLOAT64
        return cls((halving.astype(column.dtype), halving.astype(row.dtype), (0,) * (len(halving) - 1),
                    row.dtype.type(unit / total)),
                   half, (half, *_scaled(coarse, unit, half, exact), None),
                   max(len(coarse[0]), len(coarse[1])) + 1,
                   (smooth, *_scaled(fine, 1, wide, exact), in_pairs(fine[1]) if exact else None))


def strength(image: np.ndarray, weights: Weights, out: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Strength at two scales and its largest value; reference: `two_scales.reference_two_scales`.

    Each scale takes one pass, row by row. Of uint8 images gradients and second derivatives at the fine scale are exact:
    what is smoothed goes beyond 32 bits, but its differences do not, and those of its remainders modulo 2^32 are the
    same. At the coarse scale the image at half its size is exact, and what is smoothed of it in single precision. All
    that of float32 images is in double precision; averages of products, and what follows, in single precision.

    Parameters
    ----------
    image : ndarray, uint8 or float32, shape (H, W)
        At least 2 `LEAST_WIDTH` wide.
    weights : Weights
        Those for the image's type.
    out : ndarray, float32, shape (H, W), contiguous, optional
        Where to write the strength.
    """
    image = read_only(image)
    height, width = image.shape
    if width < 2 * LEAST_WIDTH:
        raise ValueError(f'image must be at least {2 * LEAST_WIDTH} pixels wide; got {width}')
    strength = np.empty((height, width), np.float32) if out is None else out
    # The nearer grey values lie to zero the less is lost in single precision: a fifth to a tenth.
    base = float(image[::8, ::8].mean()) if image.dtype == np.uint8 else 0.0
    largest = in_bands(lambda first, last: _strength_of_rows(image, weights, base, strength, first, last),
                       height, width, cost=3)
    return strength, max(largest)


def _strength_of_rows(image: np.ndarray, weights: Weights, base: float, out: np.ndarray, first: int,
                      last: int) -> float:
    """Fill in the rows from `first` to before `last`; returns the largest value in them."""
    height, width = (image.shape[0] + 1) // 2, (image.shape[1] + 1) // 2   # of the half-size image
    first_half, last_half = max(0, first // 2 - 2), min(height, (last - 1) // 2 + 4)   # as enlarge_row needs
    half = np.empty((height, width), weights.half.dtype)
    halve(image, *weights.halving, base, half, max(0, first_half - weights.reach),
          min(height, last_half + weights.reach))
    response = np.empty((height, row_length(width, LANES)), np.float32)
    _response(read_only(half), *weights.coarse, None, response, LANES, first_half, last_half)
    return _response(image, *weights.fine, response, out, 0, first, last)


def _total(weights: np.ndarray) -> float:
    """Sum of all weights, of which the array holds those from the centre outwards."""
    return 2 * weights.sum() - weights[0]


def _scaled(taps: Taps, unit: int, wide: np.ndarray, exact: bool) -> tuple[Any, ...]:
    """Weights of a scale in their types and, of both terms of the response, the factors that make grey values of them.

    Weights come with a tuple as long as the radius where that is the usual one, so that the compiler knows it.
    """
    window, further, saddle = taps
    smoothing = 16 * unit   # the sum of [1 2 1]^T [1 2 1]
    radius, far = len(window) - 1, len(further) - 1
    corner, shape = 1 / (10 * smoothing) ** 2, saddle / (smoothing * _total(further) ** 2) ** 2
    return (window.astype(np.float32), (0,) * _USUAL if exact and radius == _USUAL else None,
            further.astype(wide.dtype), (0,) * far, np.float32(corner), np.float32(shape))


@kernel
def _response(image, smooth, window, known, further, known_further, corner_unit, saddle_unit, pairs, coarse, out,
              margin, first, last):
    """Rows of the response R, or of the strength M where the coarse response is given; returns the largest M.

    `pairs` are the `further` weights once more, where what they weigh is int16.
    Two rows at a time, for then each row of products is read half as often. `margin` is where rows of `out` begin.
    """
    height, width = image.shape
    radius, far = _radius(window, known), len(known_further)
    lead = row_lead(max(radius, far))
    length = row_length(width, lead)
    done_products, done_wide = max(0, first - radius), max(0, first - 1)
    done = max(0, min(done_products - 1, done_wide - far))
    slots, product_slots = min(height, 2 * max(radius, far) + 6), min(height, 2 * radius + 2)
    column_of_image, column_of_smoothed = zeros(length, smooth), zeros(length, further)
    smoothed = zeros(slots * length, smooth).reshape((slots, length))
    products = zeros(product_slots * 3 * length, window)
    columns = zeros(2 * 3 * length, window).reshape((2, 3, length))
    wide = zeros(4 * length, further).reshape((4, length))
    enlarged = zeros(2 * length, window).reshape((2, length))
    reach = 2 * max(radius, far) + 4   # rows that are looked at above and below
    base, rows = first - reach, last - first + 2 * reach
    of_smoothed = _places(base, rows, height, slots, length, lead)
    of_products = _places(base, rows, height, product_slots, 3 * length, lead)
    of_wide = _places(base, rows, height, 4, length, lead)
    largest = zeros(LANES, window)
    for y in range(first, last, 2):
        while done <= min(height - 1, y + 2 + max(radius, far)):
            smooth_row(image, done, column_of_image, lead, smoothed, done % slots)
            done += 1
        while done_products <= min(height - 1, y + 1 + radius):
            at = done_products - base
            _multiply_row(smoothed, of_smoothed, at - 1, products, of_products[at], width, length)
            done_products += 1
        while done_wide <= min(height - 1, y + 2):
            top = done_wide - far - base
            if pairs is not None:
                widen_by_pairs(smoothed, of_smoothed, top, pairs, known_further, column_of_smoothed, lead, width)
            else:
                widen_columns(smoothed, of_smoothed, top, further, known_further, column_of_smoothed, lead, width)
            widen_row(column_of_smoothed, further, known_further, lead, width, wide, done_wide % 4)
            done_wide += 1
        for part in range(3):
            _weigh_rows(products, of_products, y - radius - base, part * length, window, known, width, columns,
                        part * length + lead)
        for row in range(min(2, last - y)):
            for part in range(3):
                reflect_ends(columns[row, part], lead, width, radius)
            if coarse is not None:
                enlarge_row(coarse, y + row, enlarged, lead, width)
            _respond(columns, row * 3 * length + lead, window, known, wide, of_wide, y + row - 1 - base, corner_unit,
                     saddle_unit, coarse, enlarged, lead, out, (y + row) * out.shape[1] + margin, width, largest)
    return largest.max()


@kernel
def _places(first, count, height, slots, stride, lead):
    """Where each row from `first` on, or the one that it is reflected to, begins in a buffer of so many rows."""
    places = np.empty(count, np.int64)
    for j in range(count):
        places[j] = reflect(first + j, height) % slots * stride + lead
    return places


@kernel
def _radius(weights, known):
    """Number of weights on either side of the middle one; the length of the tuple is known to the compiler."""
    return len(weights) - 1 if known is None else len(known)


@kernel
def _gradient(rows, above, here, below):
    """Ten times the gradients of sixteen pixels, in x and in y: differences over two pixels, with 1 3 1 across."""
    falling = load(rows, below + 2) - load(rows, above)
    rising = load(rows, above + 2) - load(rows, below)
    across = load(rows, here + 2) - load(rows, here)
    down = load(rows, below + 1) - load(rows, above + 1)
    return (falling + rising) + (across + across + across), (falling - rising) + (down + down + down)


@kernel
def _multiply_row(smoothed, places, top, products, to, width, stride):
    """Products of the gradients of one row: I_x^2, I_x I_y, I_y^2."""
    above, here, below = places[top] - 1, places[top + 1] - 1, places[top + 2] - 1
    for i in range(0, width, LANES):
        x_gradient, y_gradient = _gradient(smoothed, above + i, here + i, below + i)
        across, down = to_float32(x_gradient), to_float32(y_gradient)
        store(products, to + i, across * across)
        store(products, to + stride + i, across * down)
        store(products, to + 2 * stride + i, down * down)


@kernel
def _weigh_rows(products, places, top, start, weights, known, width, columns, to):
    """Weighted sums down the columns, for one row and for the next, which begins one row of products later."""
    next_row, radius = 3 * columns.shape[2], _radius(weights, known)
    for i in range(0, width, LANES):
        at = start + i
        low, high = load(products, places[top] + at), load(products, places[top + 2 * radius + 1] + at)
        first = second = splat(np.float32(0))
        for j in range(radius):
            weight = splat(weights[radius - j])
            next_low = load(products, places[top + j + 1] + at)
            next_high = load(products, places[top + 2 * radius - j] + at)
            first += weight * (low + next_high)
            second += weight * (next_low + high)
            low, high = next_low, next_high
        store(columns, to + i, first + splat(weights[0]) * low)
        store(columns, to + i + next_row, second + splat(weights[0]) * high)


@kernel
def _respond(columns, start, weights, known, wide, places, top, corner_unit, saddle_unit, coarse, enlarged, lead, out,
             to, width, largest):
    """One row of R or M from the weighted sums down the columns and from three rows of what was smoothed further."""
    stride, radius = columns.shape[2], _radius(weights, known)
    corner_unit, saddle_unit = splat(corner_unit), splat(saddle_unit)
    sixth, sixteenth = splat(np.float32(1 / 6)), splat(np.float32(1 / 16))
    zero, tiny = splat(np.float32(0)), splat(np.float32(1e-30))   # no trace is as small, but where it is 0
    most = load(largest, 0)
    for i in range(0, width, LANES):
        i = min(i, width - LANES)
        at = start + i
        a = splat(weights[0]) * load(columns, at)
        b = splat(weights[0]) * load(columns, at + stride)
        c = splat(weights[0]) * load(columns, at + 2 * stride)
        for j in range(1, radius + 1):
            weight = splat(weights[j])
            a += weight * (load(columns, at - j) + load(columns, at + j))
            b += weight * (load(columns, at + stride - j) + load(columns, at + stride + j))
            c += weight * (load(columns, at + 2 * stride - j) + load(columns, at + 2 * stride + j))
        above, here, below = places[top] + i, places[top + 1] + i, places[top + 2] + i
        middle, up, low = load(wide, here), load(wide, above), load(wide, below)
        up_left, up_right = load(wide, above - 1), load(wide, above + 1)
        low_left, low_right = load(wide, below - 1), load(wide, below + 1)
        # Differences of differences: exactly zero where all rows or columns are the same.
        along = (load(wide, here - 1) - middle) - (middle - load(wide, here + 1))
        down = (up - middle) - (middle - low)
        twice = (((up_left - up) - (up - up_right)) - along) + (((low_left - low) - (low - low_right)) - along)
        across = sixth * to_float32(twice)   # what 1 4 1 across adds to either
        xx, yy = to_float32(along) + across, to_float32(down) + across
        xy = to_float32((up_left - up_right) + (low_right - low_left))   # four times
        value = quotient(a * c - b * b, maximum(a + c, tiny)) * corner_unit
        value = maximum(value + saddle_unit * (xy * xy * sixteenth - xx * yy), zero)
        if coarse is not None:
            value = square_root(value * load(enlarged, lead + i))
            most = maximum(value, most)
        store(out, to + i, value)
    store(largest, 0, most)
