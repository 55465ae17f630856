"""The Harris response: how much each pixel of an image looks like a corner (exercise 1).

`harris_response` is what the package calls. `reference_response` is the definition in OpenCV and NumPy, in double
precision: the thing to read beside the exercise sheet, and what the compiled kernel is tested against. Which of the
two runs depends on the image, the window and on whether Numba is there; the result is the same to 1e-5 of the largest
|H|, and mostly to 1e-7.
"""

from __future__ import annotations

import functools
from typing import Callable

import cv2
import numpy as np

from rvc_features.kernels import compiler
from rvc_features.kernels import corners as compiled_corners
from rvc_features.kernels import response as compiled
from rvc_features.parameters import Choice, Integer, Real, check

WINDOW_SIZE = Integer('Side of the window that is averaged over, in pixels; odd.', 3, odd=True)
WINDOW = Choice('Weights of that window.', ('gaussian', 'box'))
HARRIS_K = Real('Weight of the squared trace, k.', 0, 0.25)
DERIVATIVE_SIGMA = Real('Smoothing before the gradients: standard deviation in pixels, 0 for none.', 0, 10)

BORDER = cv2.BORDER_REFLECT_101   # of every filter in this module


def harris_response(image: np.ndarray, window_size: int, window: str = 'gaussian', harris_k: float = 0.04,
                    derivative_sigma: float = 0.0) -> np.ndarray:
    """Harris response of a grey image: H = A C - B^2 - k (A + C)^2.

    A, B and C are the products I_x^2, I_x I_y and I_y^2 of the image's gradients, averaged over a window round each
    pixel. H is large and positive at corners, negative along edges, and near zero where the image is flat.

    Parameters
    ----------
    image : ndarray, uint8 or float32, shape (H, W)
        Grey image. The sheet's thresholds assume grey values from 0 to 255.
    window_size : int
        Side of the square window in pixels: odd, at least 3.
    window : {'gaussian', 'box'}
        Weights of the window; they sum to one. Gaussian: sigma = 0.3 ((w - 1) 0.5 - 1) + 0.8.
    harris_k : float
        k above, in [0, 0.25]; 0.04 in the paper.
    derivative_sigma : float
        Standard deviation in pixels of a Gaussian that smooths the image before the gradients; 0: none.

    Returns
    -------
    ndarray, float32, shape (H, W)

    Raises
    ------
    TypeError, ValueError
        When an argument is not as above; the text says what was given.

    References
    ----------
    C. Harris and M. Stephens, "A combined corner and edge detector", Alvey Vision Conference, 1988.

    Examples
    --------
    >>> import numpy as np
    >>> image = np.zeros((20, 20), np.uint8)
    >>> image[8:, 8:] = 255
    >>> response = harris_response(image, window_size=3)
    >>> [int(i) for i in np.unravel_index(response.argmax(), response.shape)]
    [8, 8]
    """
    check_image(image)
    try:
        compute = _way(image.dtype, image.shape, window_size, window, harris_k, derivative_sigma)
    except TypeError:   # also of what can't be looked up, which is to be said in words of ours
        _check_parameters(window_size, window, harris_k, derivative_sigma)
        raise
    return compute(image, None)[0]


def response_and_maximum(image: np.ndarray, window_size: int, window: str, harris_k: float, derivative_sigma: float,
                         out: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """`harris_response` and its largest value; the image is taken as checked.

    `out`, where it is given (float32, contiguous, of the image's shape), is what holds the response afterwards.
    """
    return _way(image.dtype, image.shape, window_size, window, harris_k, derivative_sigma)(image, out)


@functools.lru_cache(maxsize=64, typed=True)
def _way(dtype: np.dtype, shape: tuple[int, int], window_size: int, window: str, harris_k: float,
         derivative_sigma: float) -> Callable[[np.ndarray, np.ndarray | None], tuple[np.ndarray, float]]:
    """`response_and_maximum` of images of that type and shape: a function of the image and of `out`.

    What was right once is not looked at again, image by image.
    """
    _check_parameters(window_size, window, harris_k, derivative_sigma)
    if derivative_sigma < _LEAST_SIGMA:
        derivative_sigma = 0.0
    if _fits_kernel(shape, window_size):
        return compiled.way(dtype, shape, window_size, window, harris_k, derivative_sigma)

    def compute(image: np.ndarray, out: np.ndarray | None) -> tuple[np.ndarray, float]:
        response = reference_response(image, window_size, window, harris_k, derivative_sigma)
        if out is not None:
            out[:] = response
        return response, float(response.max())
    return compute


def corners(image: np.ndarray, harris_k: float, border: int, mask: np.ndarray | None, minimum: float,
            number: int | None, share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y and response of the local maxima that can be wanted, of an image and a response that `needs_no_map`.

    Those above `minimum`, inside the border and where the mask is not zero; in reading order. Where `number` is given
    those that are not among that many strongest may be missing, else those below `share` of the strongest.
    """
    return compiled_corners.corners(image, harris_k, minimum, border, mask, number, share)


def needs_no_map(image: np.ndarray, window_size: int, window: str, harris_k: float, derivative_sigma: float) -> bool:
    """Whether corners of this response are found without a map of it."""
    return (window == 'box' and window_size == 3 and derivative_sigma < _LEAST_SIGMA and image.dtype == np.uint8
            and harris_k >= compiled.LEAST_K_IN_SINGLE_PRECISION and _fits_kernel(image.shape, window_size))


def reference_response(image: np.ndarray, window_size: int, window: str, harris_k: float,
                       derivative_sigma: float) -> np.ndarray:
    """`harris_response` as the exercise sheet writes it, step by step; arguments are taken as checked."""
    image = image.astype(np.float64)
    if derivative_sigma > 0:
        side = 2 * int(np.ceil(4 * derivative_sigma)) + 1
        image = cv2.GaussianBlur(image, (side, side), derivative_sigma, borderType=BORDER)

    gradient_x = cv2.Sobel(image, cv2.CV_64F, 1, 0, ksize=3, borderType=BORDER)
    gradient_y = cv2.Sobel(image, cv2.CV_64F, 0, 1, ksize=3, borderType=BORDER)

    a = window_average(gradient_x * gradient_x, window_size, window)
    b = window_average(gradient_x * gradient_y, window_size, window)
    c = window_average(gradient_y * gradient_y, window_size, window)

    response = a * c - b * b - harris_k * (a + c) ** 2
    return response.astype(np.float32)


def window_average(values: np.ndarray, window_size: int, window: str) -> np.ndarray:
    """Average of `values` over the window round each pixel."""
    if window == 'box':
        return cv2.boxFilter(values, -1, (window_size, window_size), borderType=BORDER)
    sigma = gaussian_window_sigma(window_size)
    # The sigma is given, for OpenCV would take rounded binomial weights up to size 7.
    return cv2.GaussianBlur(values, (window_size, window_size), sigma, borderType=BORDER)


def gaussian_window_sigma(window_size: int) -> float:
    """Standard deviation in pixels of the Gaussian window of that size (OpenCV's convention)."""
    return 0.3 * ((window_size - 1) * 0.5 - 1) + 0.8


def _fits_kernel(shape: tuple[int, ...], window_size: int) -> bool:
    # Single precision is too little beside the largest |H| where H may nearly cancel at every pixel: in tiny images,
    # and where the window is as large as the image.
    height, width = shape
    return (height * width >= _LEAST_PIXELS and width >= compiler.LEAST_WIDTH
            and window_size <= min(compiled.LARGEST_BOX, height, width) and compiler.available())


_LEAST_PIXELS = 1024
_LEAST_SIGMA = 0.1   # pixels: less smooths nothing, for the neighbours' weight is below 1e-21


def check_image(image: np.ndarray) -> None:
    """TypeError or ValueError unless `image` is what a response can be computed of."""
    accepted = 'a non-empty NumPy array of shape (height, width), uint8 or float32'
    if not isinstance(image, np.ndarray):
        raise TypeError(f'image must be {accepted}; got {type(image).__name__}')
    if image.dtype not in (np.uint8, np.float32):
        raise TypeError(f'image must be {accepted}; got {image.dtype}')
    if image.ndim != 2 or image.size == 0:
        raise ValueError(f'image must be {accepted}; got shape {image.shape}')


def _check_parameters(window_size: int, window: str, harris_k: float, derivative_sigma: float) -> None:
    for name, value, specification in (('window_size', window_size, WINDOW_SIZE), ('window', window, WINDOW),
                                       ('harris_k', harris_k, HARRIS_K),
                                       ('derivative_sigma', derivative_sigma, DERIVATIVE_SIGMA)):
        check(name, value, specification)
