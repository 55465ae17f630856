"""Energy and noise of whole images in one pass each; reference: contrast.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import LEAST_WIDTH, installed, kernel, read_only
from rvc_features.kernels.rows import (
    gradient_buffers,
    next_gradient_parts,
    reflect,
    row_length,
    sobel_gradient,
    zeros,
)

if installed:
    from rvc_features.kernels.vectors import LANES, converted, load, store

# For their types: what gradients are kept in, and sums of their products.
_INT16, _INT32, _FLOAT64 = (np.empty(0, dtype) for dtype in (np.int16, np.int32, np.float64))


def energy_of_cells(image: np.ndarray, side: int) -> np.ndarray:
    """Sums of the squared gradient over squares; reference: `contrast.reference_energy_of_cells`."""
    image = read_only(image)
    if image.shape[1] < LEAST_WIDTH:
        raise ValueError(f'image must be at least {LEAST_WIDTH} pixels wide; got {image.shape[1]}')
    exact = image.dtype == np.uint8 and side <= 64   # sums of 64 rows fit in 32 bits
    return _energy_of_cells(image, side, *((_INT16, _INT32) if exact else (_FLOAT64, _FLOAT64)))


@kernel
def _energy_of_cells(image, side, gradient, product):
    """Sums down the columns of each row of squares, then along the row."""
    height, width = image.shape
    cells = np.zeros((-(-height // side), -(-width // side)), np.float64)
    smoothed, rows, parts = gradient_buffers(width, None, gradient)
    columns = zeros(row_length(width, 0), product)
    for y in range(height):
        next_gradient_parts(image, y, y == 0, None, smoothed, rows, parts)
        for i in range(0, width, LANES):
            x_gradient, y_gradient = sobel_gradient(parts, i)
            x_gradient, y_gradient = converted(x_gradient, product), converted(y_gradient, product)
            store(columns, i, load(columns, i) + (x_gradient * x_gradient + y_gradient * y_gradient))
        if (y + 1) % side == 0 or y == height - 1:
            for cell in range(cells.shape[1]):
                total = columns[0] - columns[0]
                for i in range(cell * side, min(cell * side + side, width)):
                    total += columns[i]
                cells[y // side, cell] = total / 64.0   # the masks over 8
            columns[:] = 0
    return cells


@kernel
def _noise_of_runs(image, run):
    height, width = image.shape
    runs = width // run
    rows = max(0, (height - 1) // 4)
    means = np.empty((rows, runs), np.float64)
    column = np.empty(width + 2, np.float64)
    for row in range(rows):
        y = 4 * row + 2
        for x in range(width):
            column[x + 1] = np.float64(image[y - 1, x]) - 2 * np.float64(image[y, x]) + np.float64(image[y + 1, x])
        column[0], column[width + 1] = column[1 + reflect(-1, width)], column[1 + reflect(width, width)]
        for i in range(runs):
            total = 0.0
            for x in range(i * run, i * run + run):
                total += abs(column[x] - 2 * column[x + 1] + column[x + 2])
            means[row, i] = total / run
    return means.ravel()


def noise_of_runs(image: np.ndarray, run: int) -> np.ndarray:
    """Mean magnitudes of the noise mask over runs of pixels; reference: `contrast.reference_noise_of_runs`."""
    return _noise_of_runs(read_only(image), run)


@kernel
def bilinear(values, x, y):
    """Values between the pixels; reference: `contrast.reference_bilinear`."""
    height, width = values.shape
    result = np.empty(len(x), np.float64)
    for i in range(len(x)):
        u, v = min(max(x[i], 0.0), width - 1.0), min(max(y[i], 0.0), height - 1.0)
        left, top = int(u), int(v)
        right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
        u, v = u - left, v - top
        above = np.float64(values[top, left]) * (1 - u) + np.float64(values[top, right]) * u
        below = np.float64(values[bottom, left]) * (1 - u) + np.float64(values[bottom, right]) * u
        result[i] = above * (1 - v) + below * v
    return result
