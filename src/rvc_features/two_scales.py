"""Corners that two scales agree on: the strength by which the default detector, `repeatable`, finds its points.

It is a Harris detector still: gradients, their products averaged over a window, corners where the product matrix is
large in both directions. What differs from the sheet's H: the determinant is divided by the trace, so that the strength
is in squared grey values; the saddle strength of the image is added, which draws the maximum back to the corner from
where smoothing moves it; and a point must be a corner at two scales.

`two_scale_strength` is what people call, `reference_two_scales` the definition to read.
"""

from __future__ import annotations

import dataclasses
import functools

import cv2
import numpy as np

from rvc_features import contrast
from rvc_features.kernels import compiler
from rvc_features.kernels import two_scales as compiled
from rvc_features.parameters import check
from rvc_features.response import BORDER, WINDOW, WINDOW_SIZE, check_image


@dataclasses.dataclass(frozen=True)
class Scale:
    """How the corners of one scale are found; steps are half-steps of binomials, [1 1] / 2 each, of variance 1/4."""

    smoothing: int       # steps before the gradients
    wider: int           # steps added to those of the Gaussian window
    further: int         # steps from the smoothed image to the one whose saddles count
    saddle: float        # weight of their strength


FINE = Scale(smoothing=2, wider=0, further=10, saddle=0.3)
COARSE = Scale(smoothing=2, wider=-2, further=6, saddle=0.5)   # in pixels of the image at half its size
HALVING = 8   # steps before every second pixel is taken
# Smoothing across first and second differences: nearly as much as they smooth along, so that directions count alike.
ACROSS_FIRST, ACROSS_SECOND = np.array([1, 3, 1]) / 5, np.array([1, 4, 1]) / 6
LEAST_WEIGHT = 0.01   # what weighs less at the ends of a window, or before the saddles, is left out: it costs time


def two_scale_strength(image: np.ndarray, window_size: int = 5, window: str = 'gaussian') -> np.ndarray:
    """How strongly each pixel is a corner at two scales: M = sqrt(R_fine R_coarse).

    At either scale R = max(0, (A C - B^2) / (A + C) + w s^2 (L_xy^2 - L_xx L_yy)). A, B and C are the products
    I_x^2, I_x I_y and I_y^2 of the gradients of the slightly smoothed image, averaged over a window; L is the image
    smoothed with s pixels. R_coarse is that of the image at half its size, enlarged by interpolation.

    Gain and offset of the image change neither where M has its maxima nor their order: M grows with the gain squared.

    Parameters
    ----------
    image : ndarray, uint8 or float32, shape (H, W)
        Grey image.
    window_size : int
        Side of the square window in pixels (at half the size: in pixels of that): odd, at least 3.
    window : {'gaussian', 'box'}
        Weights of the window. Gaussian: binomial, of variance (window_size - 1) / 2, which is a sigma of 1.4 for 5; at
        half the size half a squared pixel less. Weights below a hundredth are left out.

    Returns
    -------
    ndarray, float32, shape (H, W)
        In squared grey values per squared pixel, at least 0.

    Raises
    ------
    TypeError, ValueError
        When an argument is not as above; the text says what was given.

    References
    ----------
    C. Harris and M. Stephens, "A combined corner and edge detector", Alvey Vision Conference, 1988: A, B, C.
    J. A. Noble, "Finding corners", Image and Vision Computing 6(2), 1988: the determinant over the trace.
    P. R. Beaudet, "Rotationally invariant image operators", ICPR 1978: the determinant of the second derivatives.

    Examples
    --------
    >>> import numpy as np
    >>> image = np.zeros((40, 40), np.uint8)
    >>> image[20:, 20:] = 255
    >>> strength = two_scale_strength(image)
    >>> [int(i) for i in np.unravel_index(strength.argmax(), strength.shape)]
    [20, 20]
    """
    check_image(image)
    check('window_size', window_size, WINDOW_SIZE)
    check('window', window, WINDOW)
    return strength_and_maximum(image, window_size, window)[0]


def strength_and_maximum(image: np.ndarray, window_size: int = 5, window: str = 'gaussian',
                         out: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """`two_scale_strength` and its largest value; arguments are taken as checked.

    `out`, where it is given (float32, contiguous, of the image's shape), is what holds the strength afterwards.
    """
    if image.size >= _LEAST_PIXELS and image.shape[1] >= 2 * compiler.LEAST_WIDTH and compiler.available():
        return compiled.strength(image, _weights(window_size, window, image.dtype), out)
    strength = reference_two_scales(image, window_size, window).astype(np.float32, order='C')
    if out is not None:
        out[:] = strength
    return strength, float(strength.max())


def reference_two_scales(image: np.ndarray, window_size: int, window: str) -> np.ndarray:
    """`two_scale_strength` step by step, in double precision; arguments are taken as checked."""
    image = image.astype(np.float64)
    half = smoothed(image, binomial(HALVING))[::2, ::2].copy()
    fine = _corner_response(image, FINE, window_weights(FINE, window_size, window))
    coarse = _corner_response(half, COARSE, window_weights(COARSE, window_size, window))
    return np.sqrt(fine * _enlarged(coarse, image.shape))


def _corner_response(image: np.ndarray, scale: Scale, weights: np.ndarray) -> np.ndarray:
    """R of one scale."""
    image = smoothed(image, binomial(scale.smoothing))
    first, second = np.array([-0.5, 0, 0.5]), np.array([1.0, -2, 1])
    gradient_x = cv2.sepFilter2D(image, -1, first, ACROSS_FIRST, borderType=BORDER)
    gradient_y = cv2.sepFilter2D(image, -1, ACROSS_FIRST, first, borderType=BORDER)
    a = smoothed(gradient_x * gradient_x, weights)
    b = smoothed(gradient_x * gradient_y, weights)
    c = smoothed(gradient_y * gradient_y, weights)
    trace = a + c
    corner = (a * c - b * b) / np.where(trace > 0, trace, 1)

    image = smoothed(image, _normalized(without_tails(binomial(scale.further))))
    xx = cv2.sepFilter2D(image, -1, second, ACROSS_SECOND, borderType=BORDER)
    xy = cv2.sepFilter2D(image, -1, first, first, borderType=BORDER)
    yy = cv2.sepFilter2D(image, -1, ACROSS_SECOND, second, borderType=BORDER)
    variance = (scale.smoothing + scale.further) / 4
    return np.maximum(corner + scale.saddle * variance * (xy * xy - xx * yy), 0)


def _enlarged(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """`values` at twice the size: pixel i comes to lie on 2 i; in between (2 -9 39 39 -9 2) / 64, cut off below at 0.

    These weights, and not a cubic's (-1 9 9 -1) / 16, for points are not to move when the image does by an odd number
    of pixels: by .04 px in the mean instead of .11.
    """
    height, width = shape
    return np.maximum(_stretched(_stretched(values, width).T, height).T, 0)


def _stretched(values: np.ndarray, width: int) -> np.ndarray:
    """Rows at twice their length, cut to `width`; beyond their ends the last number goes on."""
    padded = np.pad(values, ((0, 0), (2, 3)), 'edge')
    between = sum(weight * padded[:, j:j + values.shape[1]] for j, weight in enumerate(_BETWEEN))
    return np.stack((values, between), axis=2).reshape(len(values), -1)[:, :width]


_BETWEEN = np.array([2, -9, 39, 39, -9, 2]) / 64   # weights of the six nearest pixels in the middle between two


def smoothed(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Average of `values` with these weights along rows and columns."""
    return cv2.sepFilter2D(values, -1, weights, weights, borderType=BORDER)


def window_weights(scale: Scale, window_size: int, window: str) -> np.ndarray:
    """Weights of the window at that scale along one direction."""
    if window == 'box':
        return np.full(window_size, 1 / window_size)
    return _normalized(without_tails(binomial(2 * (window_size - 1) + scale.wider)))


def _normalized(weights: np.ndarray) -> np.ndarray:
    return weights / weights.sum()


def without_tails(weights: np.ndarray) -> np.ndarray:
    """Those of the weights that are not below LEAST_WEIGHT, with which a few at either end are left out."""
    return weights[weights >= LEAST_WEIGHT]


def binomial(steps: int) -> np.ndarray:
    """Weights of so many times [1 1] / 2: of variance steps / 4; their number is odd for an even number of steps."""
    weights: np.ndarray = np.ones(1)
    for _ in range(steps):
        weights = np.convolve(weights, [0.5, 0.5])
    return weights


CONTRAST = 8.73      # grey values: the step at a right-angled corner whose strength is 1
NOISE_FACTOR = 0.18  # times the noise: the root of the strength that noise alone hardly ever reaches
MOST_NOISE = 8.0     # grey values: the step at a corner above which texture is no noise
LEAST_NOISE = 2.0    # the same, below which rounding and compression alone make corners
HIGHEST_NOISE = 11   # times its mean: the largest strength of nothing but noise, whatever has smoothed it
LEAST_OF_ENERGY = 0.05   # of the gradients' energy round a corner: steps of slanted edges are weaker
LEAST_OF_ENERGY_SPREAD = 0.025   # the same for ANMS, which else has no points for places without strong ones
LEAST_SHARE = 1e-3   # of the largest strength: what is weaker is no corner, as in drawings, which have no noise


def least_strength(minimum_contrast: float, noise: float, largest: float) -> float:
    """What the strength of a corner must exceed.

    Parameters
    ----------
    minimum_contrast : float
        The least step at a corner, in grey values.
    noise : float
        Standard deviation of the image's noise, in grey values; see `contrast.noise`.
    largest : float
        The largest strength in the image.
    """
    return max(max(minimum_contrast / CONTRAST, NOISE_FACTOR * noise) ** 2, LEAST_SHARE * largest)


def is_noise(strength: np.ndarray, largest: float) -> bool:
    """Whether an image holds nothing but noise, whose neighbours may be alike, as demosaicing, blur or JPEG leave it.

    The strongest corner of noise is a few times stronger than the mean, however strong the noise is and however
    smooth: 5 to 10 times; that of a photograph is 20 times and more stronger than what is there where it is quiet.
    Fine texture looks like noise, but for its contrast.

    Parameters
    ----------
    strength : ndarray, float32, shape (H, W)
        That of the image's pixels.
    largest : float
        The largest of them.
    """
    if largest >= (MOST_NOISE / CONTRAST) ** 2:
        return False
    return largest < HIGHEST_NOISE * contrast.where_quiet(strength) + (LEAST_NOISE / CONTRAST) ** 2


@functools.lru_cache(maxsize=64)
def _weights(window_size: int, window: str, dtype: np.dtype) -> compiled.Weights:
    """What the compiled kernel takes: weights from their centre outwards, of binomials as whole numbers."""
    def outwards(weights: np.ndarray) -> np.ndarray:
        return weights[len(weights) // 2:]

    def of(scale: Scale) -> compiled.Taps:
        return (outwards(window_weights(scale, window_size, window)),
                outwards(without_tails(binomial(scale.further)) * 2 ** scale.further),
                scale.saddle * (scale.smoothing + scale.further) / 4)

    return compiled.Weights.of(outwards(binomial(HALVING) * 2 ** HALVING), of(FINE), of(COARSE), dtype)


_LEAST_PIXELS = 1024   # in smaller images single precision may be too little beside the largest strength
