"""The direction of a key point: that of the image's gradient, taken with a larger kernel (exercise 2)."""

from __future__ import annotations

import numpy as np


def gradient_orientation(image: np.ndarray, x: np.ndarray, y: np.ndarray, sigma: float) -> np.ndarray:
    """Angle of the smoothed gradient at each point.

    The gradient is that of the image smoothed by a Gaussian, computed at the points only, with the Gaussian's
    derivatives as kernels. The exercise sheet writes theta = arctan(grad_x / grad_y), which is 90 degrees minus the
    angle returned here; OpenCV's convention is kept because its descriptors rely on it.

    Parameters
    ----------
    image : ndarray, uint8 or float32, shape (H, W)
    x, y : ndarray of int, shape (N,)
        Pixels inside the image.
    sigma : float
        Standard deviation of the Gaussian in pixels, positive.

    Returns
    -------
    ndarray, float32, shape (N,)
        atan2(I_y, I_x) in degrees, in [0, 360): clockwise from +x as the image is seen. 0 where there is no gradient.
    """
    radius = int(np.ceil(3 * sigma))
    offsets = np.arange(-radius, radius + 1)
    smooth = np.exp(-offsets ** 2 / (2 * sigma ** 2)).astype(np.float32)
    slope = (offsets * smooth).astype(np.float32)

    columns = _reflected(x[:, None] + offsets, image.shape[1])
    rows = _reflected(y[:, None] + offsets, image.shape[0])
    patches = image[rows[:, :, None], columns[:, None, :]].astype(np.float32)
    gradient_x = (patches @ slope) @ smooth
    gradient_y = (patches @ smooth) @ slope

    angle = np.degrees(np.arctan2(gradient_y, gradient_x)) % 360
    angle = angle.astype(np.float32)
    angle[angle >= 360] = 0   # what the remainder of a tiny negative angle rounds to
    return angle


def _reflected(index: np.ndarray, length: int) -> np.ndarray:
    """Indices beyond the image's border, reflected as BORDER_REFLECT_101 does: dcb|abcd|cba."""
    if length == 1:
        return np.zeros_like(index)
    index = np.abs(index) % (2 * length - 2)
    return np.minimum(index, 2 * length - 2 - index)
