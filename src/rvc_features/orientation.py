"""The direction of a key point: that of the image's gradient, taken with a larger kernel (exercise 2)."""

from __future__ import annotations

import functools

import cv2
import numpy as np

from rvc_features import contrast
from rvc_features.kernels import compiler
from rvc_features.kernels import orientation as compiled
from rvc_features.response import BORDER


def gradient_orientation(image: np.ndarray, x: np.ndarray, y: np.ndarray, sigma: float) -> np.ndarray:
    """Angle of the smoothed gradient at each point.

    The gradient is that of the image smoothed by a Gaussian, computed at the points only: the Gaussian's derivatives
    are the kernels, centred between the pixels where the point is. The exercise sheet writes
    theta = arctan(grad_x / grad_y), which is 90 degrees minus the angle returned here; OpenCV's convention is kept
    because its descriptors rely on it.

    Parameters
    ----------
    image : ndarray, uint8 or float32, shape (H, W)
    x, y : ndarray of float, shape (N,)
        Positions inside the image, in pixels; they need not be whole.
    sigma : float
        Standard deviation of the Gaussian in pixels, positive.

    Returns
    -------
    ndarray, float32, shape (N,)
        atan2(I_y, I_x) in degrees, in [0, 360): clockwise from +x as the image is seen. 0 where there is no gradient.
    """
    return direction(*smoothed_gradient(image, x, y, sigma))


def orient_along_gradient(points: np.ndarray, image: np.ndarray, octave: int, sigma: float) -> None:
    """Give the key points of an octave the `gradient_orientation` in its image.

    Parameters
    ----------
    points : ndarray of key_points.DTYPE
        Of all octaves, in pixels of the full image.
    image : ndarray, uint8 or float32, shape (H, W)
        That of the octave.
    octave : int
    sigma : float
    """
    if compiler.available() and points.flags.c_contiguous:
        compiled.orient_along_gradient(points, image, octave, *gaussian_and_slope(sigma))
    else:
        reference_orient_along_gradient(points, image, octave, sigma)


def reference_orient_along_gradient(points: np.ndarray, image: np.ndarray, octave: int, sigma: float) -> None:
    """`orient_along_gradient` of all those points at once."""
    here = np.flatnonzero(points['octave'] == octave)
    x, y = (points[name][here] / (1 << octave) for name in 'xy')
    points['angle'][here] = reference_directions(*reference_gradients(image, x, y, sigma))


def smoothed_gradient(image: np.ndarray, x: np.ndarray, y: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Gradient of the smoothed image at each point, float64, in x and in y; arguments as above.

    It is 2 pi sigma^4 times the gradient. Positions count to a 128th of a pixel.
    """
    if compiler.available():
        return compiled.smoothed_gradients(image, x, y, *gaussian_and_slope(sigma))
    return reference_gradients(image, x, y, sigma)


def direction_of_scales(image: np.ndarray, x: np.ndarray, y: np.ndarray, sigma: float,
                        shape_adaptation: bool = True) -> np.ndarray:
    """Direction at each point by four scales together, on the surface that is seen or in the image.

    The gradients at four scales, sigma and two, four and eight times that, each times its scale, are added, so that
    one is there where the others are weak. When a surface is tilted, what is drawn on it is compressed: gradients grow
    in that direction, and turn towards it, where an arrow on the surface turns away from it. How the texture
    round the point is compressed is told by its structure tensor [A B; B C], the gradient's products averaged; its
    inverse times the gradient turns as the arrow does. The patch of a descriptor is not compressed with the surface,
    and the gradient alone turns it better.

    What a scale says counts less the more of it may be noise: at twice the scale, half as much of the image's noise is
    left in the gradient. With the tensor's trace E for what the image has there and n for its noise, the weights are
    E / (E + t n^2 / 4^octave), as a Wiener filter's.

    Parameters
    ----------
    image, x, y, sigma
        As for `gradient_orientation`.
    shape_adaptation : bool
        Whether the direction is to stay on the surface when it tilts; otherwise it is that of the gradients.

    Returns
    -------
    ndarray, float32, shape (N,)
        In degrees, in [0, 360), as `gradient_orientation`.

    References
    ----------
    T. Lindeberg and J. Garding, "Shape-adapted smoothing in estimation of 3-D shape cues from affine deformations of
    local 2-D brightness structure", Image and Vision Computing 15(6), 1997: how the tensor transforms.
    """
    levels = [image]
    for _ in range(1, _SCALES):
        levels.append(cv2.pyrDown(levels[-1]))
    # 2 pi sigma^4 times the gradient at an octave is so many times sigma times the full image's.
    gradients = np.stack([smoothed_gradient(level, x / (1 << octave), y / (1 << octave), sigma)
                          for octave, level in enumerate(levels)])
    if not shape_adaptation:
        return direction(*gradients.sum(axis=0))
    a, b, c = _products_round(levels[1], x / 2, y / 2)
    energy = a + c + _LEAST_PRODUCT
    noise = _NOISE * contrast.noise(image) ** 2
    gradient_x, gradient_y = sum(energy / (energy + noise / 4 ** octave) * of_scale
                                 for octave, of_scale in enumerate(gradients))
    # Where all gradients point the same way, or there are none, the tensor alone has no inverse.
    rest = _LEAST_SPREAD / 2 * (a + c) + _LEAST_PRODUCT
    return direction((c + rest) * gradient_x - b * gradient_y, (a + rest) * gradient_y - b * gradient_x)


def direction(gradient_x: np.ndarray, gradient_y: np.ndarray) -> np.ndarray:
    """Direction of gradients in degrees, float32, in [0, 360)."""
    if compiler.available():
        return compiled.directions(gradient_x, gradient_y)
    return reference_directions(gradient_x, gradient_y)


def reference_directions(gradient_x: np.ndarray, gradient_y: np.ndarray) -> np.ndarray:
    """`direction` of all gradients at once."""
    angle = (np.degrees(np.arctan2(gradient_y, gradient_x)) % 360).astype(np.float32)
    angle[angle >= 360] = 0   # what the remainder of a tiny negative angle rounds to
    return angle


def reference_gradients(image: np.ndarray, x: np.ndarray, y: np.ndarray,
                        sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """`smoothed_gradient` for all points at once."""
    side, weights, slopes = gaussian_and_slope(sigma)
    weights, slopes = weights[:, :side].astype(np.float64), slopes[:, :side].astype(np.float64)
    columns, step_x = _pixels_round(x, side, image.shape[1])
    rows, step_y = _pixels_round(y, side, image.shape[0])
    patches = image[rows[:, :, None], columns[:, None, :]].astype(np.float64)
    patches -= patches[:, side // 2, side // 2][:, None, None]   # so that a flat patch has no gradient, exactly
    gradient_x = np.einsum('nyx,ny,nx->n', patches, weights[step_y], slopes[step_x])
    gradient_y = np.einsum('nyx,ny,nx->n', patches, slopes[step_y], weights[step_x])
    return gradient_x, gradient_y


def _pixels_round(position: np.ndarray, side: int, length: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the `side` pixels round each position, and which of the steps between two pixels it is at."""
    middle = np.floor(np.asarray(position, np.float64) + 0.5)
    step = ((position - middle + 0.5) * _STEPS + 0.5).astype(np.intp)
    return _reflected(middle.astype(np.intp)[:, None] + np.arange(side) - side // 2, length), step


@functools.lru_cache(maxsize=64)
def gaussian_and_slope(sigma: float) -> tuple[int, np.ndarray, np.ndarray]:
    """Weights of a Gaussian on the pixels round a position, and its derivative, which has no response to flat areas.

    Returns
    -------
    side : int
        How many pixels they are, an odd number.
    weights, slopes : ndarray, float32, shape (_STEPS + 1, at least side)
        A row for each step from half a pixel left of the middle pixel to half a pixel right of it; from `side` on
        zeros, to a multiple of `compiled.COLUMNS`.
    """
    radius = int(np.ceil(3 * sigma))
    side = 2 * radius + 1
    distance = np.arange(-radius, radius + 1) - (np.arange(_STEPS + 1) / _STEPS - 0.5)[:, None]
    weights = np.exp(-distance ** 2 / (2 * sigma ** 2))
    slopes = distance * weights
    slopes -= weights * (slopes.sum(axis=1) / weights.sum(axis=1))[:, None]
    beyond = (0, 0), (0, -side % compiled.COLUMNS)
    return side, np.pad(weights, beyond).astype(np.float32), np.pad(slopes, beyond).astype(np.float32)


def _products_round(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    """I_x^2, I_x I_y and I_y^2, averaged round each point by a Gaussian of _SPREAD cells."""
    vectors = compiler.available() and image.dtype == np.uint8 and min(image.shape) >= compiler.LEAST_WIDTH
    cells = (compiled.products_of_cells if vectors else reference_products_of_cells)(image, _CELL)
    average = cv2.GaussianBlur(cells, (0, 0), _SPREAD, borderType=BORDER)
    x, y = (x + 0.5) / _CELL - 0.5, (y + 0.5) / _CELL - 0.5
    return [contrast.between(np.ascontiguousarray(average[..., k]), x, y) for k in range(3)]


def reference_products_of_cells(image: np.ndarray, side: int) -> np.ndarray:
    """Means, float32, of I_x^2, I_x I_y and I_y^2, by Sobel's masks, over squares of `side` pixels, shape (., ., 3).

    What is left at the right and below does not count, unless there is no square at all.
    """
    image = image.astype(np.float64)
    gradient_x = cv2.Sobel(image, -1, 1, 0, ksize=3, borderType=BORDER)
    gradient_y = cv2.Sobel(image, -1, 0, 1, ksize=3, borderType=BORDER)
    products = np.dstack((gradient_x * gradient_x, gradient_x * gradient_y, gradient_y * gradient_y))
    height, width = (min(side, length) for length in image.shape)
    rows, columns = image.shape[0] // height, image.shape[1] // width
    squares = products[:rows * height, :columns * width].reshape(rows, height, columns, width, 3)
    return squares.mean(axis=(1, 3)).astype(np.float32)


def _reflected(index: np.ndarray, length: int) -> np.ndarray:
    """Indices beyond the image's border, reflected as BORDER_REFLECT_101 does: dcb|abcd|cba."""
    if length == 1:
        return np.zeros_like(index)
    index = np.abs(index) % (2 * length - 2)
    return np.minimum(index, 2 * length - 2 - index)


_STEPS = 64              # from one pixel to the next: the Gaussians are kept for so many positions
_SCALES = 4              # each twice the one before
_CELL = 8                # pixels of the image at half its size: squares over which the products are averaged first
_SPREAD = 2.0            # cells: standard deviation of the Gaussian that averages over these
_LEAST_SPREAD = 1.0      # share of the tensor's trace that is added to make it rounder
_NOISE = 1000.0          # times the squared noise: how much of the gradients' energy, by Sobel's masks, makes up for it
_LEAST_PRODUCT = 1e-6    # squared gradient, in grey values by Sobel's masks: not to divide by nothing
