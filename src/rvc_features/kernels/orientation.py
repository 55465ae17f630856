"""The smoothed gradient at each point; reference: orientation.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import installed, kernel, read_only
from rvc_features.kernels.rows import reflect

if installed:
    from rvc_features.kernels.vectors import LANES, load, splat, sum_of, to_float64

def smoothed_gradients(image: np.ndarray, x: np.ndarray, y: np.ndarray,
                       sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Gradient of the smoothed image at each point; reference: `orientation.reference_gradients`."""
    return _smoothed_gradients(read_only(image), x.astype(np.float64), y.astype(np.float64), float(sigma))


@kernel
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
        middle = np.float64(image[reflect(middle_y, height), reflect(middle_x, width)])
        if left >= 0 and left + length <= width and top >= 0 and top + side <= height:
            gradient_x[i], gradient_y[i] = _weighed_patch(image, top * width + left, width, middle, side, weights_x,
                                                          slopes_x, weights_y, slopes_y)
        else:
            for row in range(side):
                for column in range(side):
                    patch[row * length + column] = image[reflect(top + row, height), reflect(left + column, width)]
            gradient_x[i], gradient_y[i] = _weighed_patch(patch, 0, length, middle, side, weights_x, slopes_x,
                                                          weights_y, slopes_y)
    return gradient_x, gradient_y


@kernel
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


@kernel
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
