"""The direction of a key point: that of the image's gradient, taken with a larger kernel (exercise 2)."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels import compiler
from rvc_features.kernels import orientation as compiled


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


def smoothed_gradient(image: np.ndarray, x: np.ndarray, y: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Gradient of the smoothed image at each point, float64, in x and in y; arguments as above."""
    gradient = compiled.smoothed_gradients if compiler.available() else reference_gradients
    return gradient(image, x, y, sigma)


def direction(gradient_x: np.ndarray, gradient_y: np.ndarray) -> np.ndarray:
    """Direction of gradients in degrees, float32, in [0, 360)."""
    angle = (np.degrees(np.arctan2(gradient_y, gradient_x)) % 360).astype(np.float32)
    angle[angle >= 360] = 0   # what the remainder of a tiny negative angle rounds to
    return angle


def reference_gradients(image: np.ndarray, x: np.ndarray, y: np.ndarray,
                        sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Gradient of the image under a Gaussian, up to a common factor, at each point."""
    radius = int(np.ceil(3 * sigma))
    columns, weights_x, slopes_x = _kernel(x, image.shape[1], radius, sigma)
    rows, weights_y, slopes_y = _kernel(y, image.shape[0], radius, sigma)
    patches = image[rows[:, :, None], columns[:, None, :]].astype(np.float64)
    patches -= patches[:, radius:radius + 1, radius:radius + 1]   # so that a flat patch has no gradient, exactly
    gradient_x = np.einsum('nyx,ny,nx->n', patches, weights_y, slopes_x)
    gradient_y = np.einsum('nyx,ny,nx->n', patches, slopes_y, weights_x)
    return gradient_x, gradient_y


def _kernel(position: np.ndarray, length: int, radius: int, sigma: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices of the pixels round each position, their Gaussian weights, and those of the Gaussian's derivative."""
    index = np.rint(position).astype(np.intp)[:, None] + np.arange(-radius, radius + 1)
    distance = index - np.asarray(position, np.float64)[:, None]
    weights = np.exp(-distance ** 2 / (2 * sigma ** 2))
    slopes = distance * weights
    slopes -= weights * (slopes.sum(axis=1) / weights.sum(axis=1))[:, None]   # flat areas have no gradient
    return _reflected(index, length), weights, slopes


def _reflected(index: np.ndarray, length: int) -> np.ndarray:
    """Indices beyond the image's border, reflected as BORDER_REFLECT_101 does: dcb|abcd|cba."""
    if length == 1:
        return np.zeros_like(index)
    index = np.abs(index) % (2 * length - 2)
    return np.minimum(index, 2 * length - 2 - index)
