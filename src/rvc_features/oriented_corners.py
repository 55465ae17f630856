"""What the exercise sheet asks for, the strongest corners with their directions, by one compiled call."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels import oriented_corners as compiled
from rvc_features.key_points import DTYPE
from rvc_features.orientation import gaussian_and_slope


def strongest_oriented(image: np.ndarray, window_size: int, harris_k: float, minimum: float, border: int,
                       mask: np.ndarray | None, number: int, orientation_sigma: float) -> np.ndarray:
    """Key points of the `number` strongest of `response.corners`, strongest first.

    They are what `key_points.of_corners`, `key_points.strongest` and `orientation.orient_along_gradient` give one after
    the other.

    Parameters
    ----------
    image, harris_k, minimum, border, mask
        As for `response.corners`.
    window_size : int
        Of the response: the key points' size.
    number : int
    orientation_sigma : float
        As for `orientation.gradient_orientation`.
    """
    return compiled.strongest_oriented(image, harris_k, minimum, border, mask, number, window_size,
                                       *gaussian_and_slope(orientation_sigma)).view(DTYPE)
