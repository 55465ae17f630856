"""From the image to key points with directions in one call: where few are wanted, calls take longer than the points."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import bands, kernel
from rvc_features.kernels.corners import corners, corners_of_image, prepared
from rvc_features.kernels.key_points import numbers_of_corners, strongest_numbers
from rvc_features.kernels.orientation import orient_numbers


def strongest_oriented(image: np.ndarray, harris_k: float, minimum: float, border: int, mask: np.ndarray | None,
                       number: int, size: int, side: int, weights: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Key points of the strongest of `corners.corners`, strongest first, as rows of six numbers.

    Directions as by reference: `orientation.reference_orient_along_gradient`.

    Parameters
    ----------
    image, harris_k, minimum, border, mask
        As for `corners.corners`.
    number : int
        Of key points, at the most.
    size : int
        Of each key point.
    side, weights, slopes
        Those of `orientation.gaussian_and_slope`.
    """
    arguments = prepared(image, harris_k, minimum, border, mask, number, 0.0)
    directions = side, weights, slopes
    if bands(*image.shape) == 1:
        return _of_image(*arguments, size, directions)
    found = corners(image, harris_k, minimum, border, mask, number)
    return _of_corners(arguments[0], *found, number, size, directions)


@kernel
def _of_image(image, mask, harris_k, border, minimum, number, share, size, directions):
    x, y, responses = corners_of_image(image, mask, harris_k, border, minimum, number, share)
    return _of_corners(image, x, y, responses, number, size, directions)


@kernel
def _of_corners(image, x, y, responses, number, size, directions):
    octave = np.int64(0)   # for its type: a 0 would be compiled for apart
    numbers = strongest_numbers(numbers_of_corners(x, y, responses, size, octave), min(number, len(x)))
    side, weights, slopes = directions
    orient_numbers(numbers, image, octave, side, weights, slopes)
    return numbers
