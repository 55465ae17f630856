"""What the exercise sheet asks for, the strongest corners with their directions, by one compiled call."""

from __future__ import annotations

import numpy as np

from rvc_features import response
from rvc_features.kernels import oriented_corners as compiled
from rvc_features.key_points import DTYPE
from rvc_features.orientation import gaussian_and_slope


def strongest_oriented(image: np.ndarray, window_size: int, window: str, harris_k: float, derivative_sigma: float,
                       minimum: float, border: int, mask: np.ndarray | None, number: int,
                       orientation_sigma: float) -> np.ndarray | None:
    """Key points of the `number` strongest of `response.corners`, strongest first; None where those take a map.

    They are what `key_points.of_corners`, `key_points.strongest` and `orientation.orient_along_gradient` give one after
    the other.

    Parameters
    ----------
    image, window_size, window, harris_k, derivative_sigma, minimum, border, mask
        As for `response.corners`.
    number : int
    orientation_sigma : float
        As for `orientation.gradient_orientation`.
    """
    if not response.needs_no_map(image, window_size, window, harris_k, derivative_sigma):
        return None
    return compiled.strongest_oriented(image, harris_k, minimum, border, mask, number, window_size,
                                       *gaussian_and_slope(orientation_sigma)).view(DTYPE)
