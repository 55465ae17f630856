"""Energy and noise of whole images in one pass each, and energy at points; reference: contrast.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import LEAST_WIDTH, installed, kernel, read_only
from rvc_features.kernels.rows import reflect, reflect_ends, row_lead, row_length, zeros

if installed:
    from rvc_features.kernels.vectors import (
        LANES,
        converted,
        load,
        load_half,
        maximum,
        products_of_pairs,
        splat,
        store,
        sum_of,
    )

# For their types: what pixels and sums of a few are kept in, and sums of their products or of many.
_INT16, _INT32, _FLOAT32, _FLOAT64 = (np.empty(0, dtype) for dtype in (np.int16, np.int32, np.float32, np.float64))


def energy_of_cells(image: np.ndarray, side: int) -> np.ndarray:
    """Sums of the squared gradient over squares; reference: `contrast.reference_energy_of_cells`."""
    image = _checked(image)
    exact = image.dtype == np.uint8 and side <= 64   # sums of 64 rows fit in 32 bits
    return _energy_of_cells(image, side, *((_INT16, _INT32, ()) if exact else (_FLOAT64, _FLOAT64, None)))


def noise_of_runs(image: np.ndarray, run: int) -> np.ndarray:
    """Mean magnitudes of the noise mask over runs of pixels; reference: `contrast.reference_noise_of_runs`.

    `run` is a multiple of `LANES`.
    """
    image = _checked(image)
    return _noise_of_runs(image, run, *((_INT16, _FLOAT32) if image.dtype == np.uint8 else (_FLOAT64, _FLOAT64)))


def _checked(image: np.ndarray) -> np.ndarray:
    if image.shape[1] < LEAST_WIDTH:
        raise ValueError(f'image must be at least {LEAST_WIDTH} pixels wide; got {image.shape[1]}')
    return read_only(image)


@kernel
def _energy_of_cells(image, side, pixel, product, by_pairs):
    """Sums down the columns of each row of squares, then along the row; `by_pairs` is None but for pixels of int16."""
    height, width = image.shape
    together = 1 if by_pairs is None else 2
    cells = np.zeros((-(-height // side), -(-width // side)), np.float64)
    lead = row_lead(1)
    length = row_length(width, lead)
    smoothed, falling, columns = zeros(length, pixel), zeros(length, pixel), zeros(length, product)
    for y in range(0, height, 2):
        above, here, below = reflect(y - 1, height) * width, y * width, reflect(y + 1, height) * width
        for i in range(0, width, LANES):
            i = min(i, width - LANES)
            upper, lower = converted(load(image, above + i), pixel), converted(load(image, below + i), pixel)
            middle = converted(load(image, here + i), pixel)
            store(smoothed, lead + i, (upper + middle) + (middle + lower))
            store(falling, lead + i, lower - upper)
        reflect_ends(smoothed, lead, width, 1)
        reflect_ends(falling, lead, width, 1)
        # No gradient behind the last pixel, with which it may share a pair.
        end = lead + width
        smoothed[end + 1], falling[end + 1] = smoothed[end - 1], -(falling[end - 1] + falling[end] + falling[end])
        for i in range(lead, lead + width, LANES):
            x_gradient, middle = load(smoothed, i + 1) - load(smoothed, i - 1), load(falling, i)
            y_gradient = (load(falling, i - 1) + middle) + (middle + load(falling, i + 1))
            if by_pairs is not None:   # sums of two neighbours, of which either belongs to the same square
                at = lead + (i - lead) // 2
                store(columns, at, load_half(columns, at) + (products_of_pairs(x_gradient, x_gradient)
                                                            + products_of_pairs(y_gradient, y_gradient)))
            else:
                # Names of their own: Numba before 0.50 has one type for each name.
                wide_x, wide_y = converted(x_gradient, product), converted(y_gradient, product)
                store(columns, i, load(columns, i) + (wide_x * wide_x + wide_y * wide_y))
        if (y + 2) // side > y // side or y + 2 >= height:
            for cell in range(cells.shape[1]):
                total = columns[0] - columns[0]   # zero, of their type
                for i in range(cell * side // together, -(-min(cell * side + side, width) // together)):
                    total += columns[lead + i]
                cells[y // side, cell] = total / 64.0   # the masks over 8
            columns[:] = 0
    return cells


@kernel
def _noise_of_runs(image, run, pixel, number):
    """The mask down the columns, then along the row."""
    height, width = image.shape
    runs, lead = width // run, row_lead(1)
    means = np.empty((max(0, (height + 3) // 8), runs), np.float64)
    column = zeros(row_length(width, lead), pixel)
    nothing = zeros(LANES, number)
    for row in range(len(means)):
        here = (8 * row + 2) * width
        for i in range(0, width, LANES):
            i = min(i, width - LANES)
            middle = converted(load(image, here + i), pixel)
            upper = converted(load(image, here - width + i), pixel) - middle
            store(column, lead + i, upper - (middle - converted(load(image, here + width + i), pixel)))
        reflect_ends(column, lead, width, 1)
        for k in range(runs):
            total = load(nothing, 0)
            for i in range(lead + k * run, lead + k * run + run, LANES):
                middle = load(column, i)
                value = converted((load(column, i - 1) - middle) - (middle - load(column, i + 1)), number)
                total += maximum(value, load(nothing, 0) - value)
            means[row, k] = sum_of(total) / run
    return means.ravel()


@kernel
def averages(sums, height, width, side, factor, weights):
    """Means over squares of `factor` by `factor` cells, of every second row, under a Gaussian.

    Of an image of that size; `weights` are those of the Gaussian along one direction, from its centre outwards;
    reference: `contrast.reference_averages`.
    """
    rows, columns = -(-sums.shape[0] // factor), -(-sums.shape[1] // factor)
    radius, of_square = len(weights) - 1, factor * side
    lead = row_lead(radius)
    length = row_length(columns, lead)
    means, row, average = zeros(rows * length, weights), zeros(length, weights), zeros(rows * length, weights)
    for i in range(rows):
        start = i * length
        for cell_row in range(i * factor, min((i + 1) * factor, sums.shape[0])):
            for j in range(columns):
                for cell in range(j * factor, min((j + 1) * factor, sums.shape[1])):
                    means[start + j] += sums[cell_row, cell]
        share = 1 / (((min(height, (i + 1) * of_square) + 1) // 2 - i * of_square // 2) * of_square)
        for j in range(columns):
            means[start + j] *= share
        means[start + columns - 1] *= of_square / (width - (columns - 1) * of_square)
    for i in range(rows):
        for j in range(0, columns, LANES):
            total = splat(weights[0]) * load(means, i * length + j)
            for k in range(1, radius + 1):
                above, below = reflect(i - k, rows) * length, reflect(i + k, rows) * length
                total += splat(weights[k]) * (load(means, above + j) + load(means, below + j))
            store(row, lead + j, total)
        reflect_ends(row, lead, columns, radius)
        for j in range(0, columns, LANES):
            total = splat(weights[0]) * load(row, lead + j)
            for k in range(1, radius + 1):
                total += splat(weights[k]) * (load(row, lead + j - k) + load(row, lead + j + k))
            store(average, i * length + j, total)
    return average.reshape((rows, length))[:, :columns]


@kernel
def bilinear(values, x, y):
    """Values between the pixels; reference: `contrast.reference_bilinear`."""
    result = np.empty(len(x), np.float64)
    for i in range(len(x)):
        result[i] = between(values, x[i], y[i])
    return result


@kernel
def between(values, x, y):
    """The value between the pixels; beyond the rim the nearest pixel counts."""
    height, width = values.shape
    x, y = min(max(x, 0.0), width - 1.0), min(max(y, 0.0), height - 1.0)
    left, top = int(x), int(y)
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    x, y = x - left, y - top
    above = values[top, left] * (1 - x) + values[top, right] * x
    below = values[bottom, left] * (1 - x) + values[bottom, right] * x
    return above * (1 - y) + below * y
