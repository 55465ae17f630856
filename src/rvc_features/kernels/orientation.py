"""The smoothed gradient at each point, and the gradient's products round it; reference: orientation.py."""

from __future__ import annotations

import math

import numpy as np

from rvc_features.kernels.compiler import LEAST_WIDTH, installed, kernel, read_only
from rvc_features.kernels.key_points import NUMBERS
from rvc_features.kernels.rows import reflect, reflect_ends, row_lead, row_length, zeros

if installed:
    from rvc_features.kernels.instructions import HALF
    from rvc_features.kernels.vectors import (
        LANES,
        load,
        load_half,
        products_of_pairs,
        splat_half,
        store,
        sum_of,
        to_float32,
        widened,
    )

_USUAL_SIDE = 11   # of a patch: what the detector's own orientation_sigma takes
COLUMNS = 24   # of a patch, at a time: the usual one has 17, and 11

# For their types: what gradients and their products are kept in.
_INT16, _INT32 = np.empty(0, np.int16), np.empty(0, np.int32)


def smoothed_gradients(image: np.ndarray, x: np.ndarray, y: np.ndarray, side: int, weights: np.ndarray,
                       slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradient of the smoothed image at each point; reference: `orientation.reference_gradients`.

    `side`, `weights` and `slopes` are those of `orientation.gaussian_and_slope`.
    """
    return _smoothed_gradients(read_only(image), x.astype(np.float64), y.astype(np.float64), side, weights, slopes)


@kernel
def _smoothed_gradients(image, x, y, side, weights, slopes):
    """The usual patch, where it lies in the image, is weighed here: a function's call takes as long as all of it."""
    height, width = image.shape
    length, steps = weights.shape[1], weights.shape[0] - 1
    weights, slopes = weights.ravel(), slopes.ravel()
    patch = np.zeros(side * length, image.dtype)
    gradient_x, gradient_y = np.empty(len(x), np.float64), np.empty(len(x), np.float64)
    for i in range(len(x)):
        middle_x, middle_y = np.int64(np.floor(x[i] + 0.5)), np.int64(np.floor(y[i] + 0.5))
        left, top = middle_x - _USUAL_SIDE // 2, middle_y - _USUAL_SIDE // 2
        if side != _USUAL_SIDE or left < 0 or top < 0 or left + LANES > width or top + _USUAL_SIDE > height:
            gradient_x[i], gradient_y[i] = _gradient_at(image, x[i], y[i], side, length, weights, slopes, patch)
            continue
        zero, base = splat_half(np.float32(0)), splat_half(np.float32(image[middle_y, middle_x]))
        weighed_0, weighed_1, sloped_0, sloped_1 = zero, zero, zero, zero
        first = np.int64((y[i] - middle_y + 0.5) * steps + 0.5) * length
        start = top * width + left
        for row in range(_USUAL_SIDE):
            at = np.uint64(first + row)   # no sign to look at
            weight, slope = splat_half(weights[at]), splat_half(slopes[at])
            value = to_float32(load_half(image, start)) - base
            weighed_0 += weight * value
            sloped_0 += slope * value
            value = to_float32(load_half(image, start + HALF)) - base
            weighed_1 += weight * value
            sloped_1 += slope * value
            start += width
        first = np.int64((x[i] - middle_x + 0.5) * steps + 0.5) * length
        second = first + HALF
        gradient_x[i] = sum_of(load_half(slopes, first) * weighed_0 + load_half(slopes, second) * weighed_1)
        gradient_y[i] = sum_of(load_half(weights, first) * sloped_0 + load_half(weights, second) * sloped_1)
    return gradient_x, gradient_y


@kernel
def _gradient_at(image, x, y, side, length, weights, slopes, patch):
    """Of one point; `patch` is room for the pixels round it where they are not all in the image."""
    height, width = image.shape
    radius, steps = side // 2, len(weights) // length - 1
    middle_x, middle_y = np.int64(np.floor(x + 0.5)), np.int64(np.floor(y + 0.5))
    left, top = middle_x - radius, middle_y - radius
    row_x = np.int64((x - middle_x + 0.5) * steps + 0.5) * length
    row_y = np.int64((y - middle_y + 0.5) * steps + 0.5) * length
    # Seen from the value in the middle, a flat patch is zero, and its gradient is so exactly.
    middle = np.float32(image[reflect(middle_y, height), reflect(middle_x, width)])
    if left >= 0 and left + length <= width and top >= 0 and top + side <= height:
        return _weighed_patch(image, top * width + left, width, middle, side, weights, slopes, row_x, row_y)
    for row in range(side):
        for column in range(side):
            patch[row * length + column] = image[reflect(top + row, height), reflect(left + column, width)]
    return _weighed_patch(patch, 0, length, middle, side, weights, slopes, row_x, row_y)


@kernel
def _weighed_patch(values, start, stride, middle, side, weights, slopes, row_x, row_y):
    """Sum of a patch times slopes in x and weights in y, and the other way round."""
    zero = splat_half(np.float32(0))
    x_even, x_odd, y_even, y_odd = zero, zero, zero, zero
    for i in range(0, side, COLUMNS):
        first, second, third = row_x + i, row_x + i + HALF, row_x + i + LANES
        weighed, sloped = _down_the_columns(values, start + i, stride, middle, side, weights, slopes, row_y)
        x_even += load_half(slopes, first) * weighed[0]
        y_even += load_half(weights, first) * sloped[0]
        x_odd += load_half(slopes, second) * weighed[1]
        y_odd += load_half(weights, second) * sloped[1]
        x_even += load_half(slopes, third) * weighed[2]
        y_even += load_half(weights, third) * sloped[2]
    return np.float64(sum_of(x_even + x_odd)), np.float64(sum_of(y_even + y_odd))


@kernel
def _down_the_columns(values, start, stride, middle, side, weights, slopes, first):
    """Sums of numbers less `middle`, times weights and times slopes; of three times eight columns, side by side.

    Each sum waits for itself, but not for the others.
    """
    zero, base = splat_half(np.float32(0)), splat_half(middle)
    weighed_0, weighed_1, weighed_2, sloped_0, sloped_1, sloped_2 = zero, zero, zero, zero, zero, zero
    for row in range(side):
        at = np.uint64(first + row)   # no sign to look at
        weight, slope = splat_half(weights[at]), splat_half(slopes[at])
        value = to_float32(load_half(values, start)) - base
        weighed_0 += weight * value
        sloped_0 += slope * value
        value = to_float32(load_half(values, start + HALF)) - base
        weighed_1 += weight * value
        sloped_1 += slope * value
        value = to_float32(load_half(values, start + LANES)) - base
        weighed_2 += weight * value
        sloped_2 += slope * value
        start += stride
    return (weighed_0, weighed_1, weighed_2), (sloped_0, sloped_1, sloped_2)


def directions(gradient_x: np.ndarray, gradient_y: np.ndarray) -> np.ndarray:
    """Direction of gradients in degrees, float32, in [0, 360); reference: `orientation.reference_directions`."""
    return _directions(*(np.ascontiguousarray(gradient, np.float64) for gradient in (gradient_x, gradient_y)))


@kernel
def _directions(gradient_x, gradient_y):
    result = np.empty(len(gradient_x), np.float32)
    for i in range(len(result)):
        result[i] = _direction(gradient_x[i], gradient_y[i])
    return result


@kernel
def _direction(gradient_x, gradient_y):
    angle = math.degrees(math.atan2(gradient_y, gradient_x))
    rounded = np.float32(angle if angle >= 0 else angle + 360)
    return rounded if rounded < 360 else np.float32(0)   # what a tiny negative angle rounds to


def orient_along_gradient(points: np.ndarray, image: np.ndarray, octave: int, side: int, weights: np.ndarray,
                          slopes: np.ndarray) -> None:
    """The direction of an octave's key points; reference: `orientation.reference_orient_along_gradient`.

    `points` are contiguous; `side`, `weights` and `slopes` are those of `orientation.gaussian_and_slope`.
    """
    orient_numbers(points.view(np.float32), read_only(image), octave, side, weights, slopes)


@kernel
def orient_numbers(numbers, image, octave, side, weights, slopes):
    octaves, scale = numbers.view(np.int32), 1 / (1 << octave)
    length, weights, slopes = weights.shape[1], weights.ravel(), slopes.ravel()
    patch = np.zeros(side * length, image.dtype)
    for at in range(0, len(numbers), NUMBERS):
        if octaves[at + 5] == octave:
            gradient_x, gradient_y = _gradient_at(image, numbers[at] * scale, numbers[at + 1] * scale, side, length,
                                                  weights, slopes, patch)
            numbers[at + 3] = _direction(gradient_x, gradient_y)


def products_of_cells(image: np.ndarray, side: int) -> np.ndarray:
    """Means of the gradient's products over squares; reference: `orientation.reference_products_of_cells`.

    `image` is of uint8 and holds a square at least; `side` is an even number up to 32, for sums of so many pixels fit
    in 32 bits.
    """
    if image.dtype != np.uint8 or image.shape[1] < LEAST_WIDTH:
        raise ValueError(f'image must be uint8, at least {LEAST_WIDTH} pixels wide; got {image.dtype} {image.shape}')
    return _products_of_cells(read_only(image), side)


@kernel
def _products_of_cells(image, side):
    """Sums of pairs down the columns of each row of squares, then along the row."""
    height, width = image.shape
    cells = np.empty((height // side, width // side, 3), np.float32)
    lead = row_lead(1)
    length = row_length(width, lead)
    smoothed, falling = zeros(length, _INT16), zeros(length, _INT16)
    sums = zeros(3 * length, _INT32)
    for y in range(len(cells) * side):
        above, here, below = reflect(y - 1, height) * width, y * width, reflect(y + 1, height) * width
        for i in range(0, width, LANES):
            i = min(i, width - LANES)
            upper, middle, lower = (widened(load(image, above + i)), widened(load(image, here + i)),
                                    widened(load(image, below + i)))
            store(smoothed, lead + i, (upper + middle) + (middle + lower))
            store(falling, lead + i, lower - upper)
        reflect_ends(smoothed, lead, width, 1)
        reflect_ends(falling, lead, width, 1)
        for i in range(0, width // side * side, LANES):
            here, at = lead + i, i // 2
            x_gradient = load(smoothed, here + 1) - load(smoothed, here - 1)
            y_gradient = (load(falling, here - 1) + load(falling, here)) + (load(falling, here)
                                                                            + load(falling, here + 1))
            store(sums, at, load_half(sums, at) + products_of_pairs(x_gradient, x_gradient))
            at += length
            store(sums, at, load_half(sums, at) + products_of_pairs(x_gradient, y_gradient))
            at += length
            store(sums, at, load_half(sums, at) + products_of_pairs(y_gradient, y_gradient))
        if y % side == side - 1:
            for part in range(3):
                for cell in range(cells.shape[1]):
                    first = part * length + cell * (side // 2)
                    total = np.int32(0)
                    for i in range(first, first + side // 2):
                        total += sums[i]
                    cells[y // side, cell, part] = np.float32(total) / np.float32(side * side)
            sums[:] = 0
    return cells
