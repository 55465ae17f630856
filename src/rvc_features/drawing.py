"""Key points and response maps as pictures."""

from __future__ import annotations

import cv2
import numpy as np

from rvc_features.key_points import KeyPoints, as_array

# BGR, one per octave, starting over after the last; told apart also by people who see red and green alike.
OCTAVE_COLOURS = ((0, 255, 255), (255, 144, 30), (80, 80, 255), (120, 220, 80), (255, 100, 255), (255, 255, 255))

_SHIFT = 4   # drawing coordinates have this many fractional bits


def draw_key_points(image: np.ndarray, key_points: KeyPoints) -> np.ndarray:
    """The image in colour with its key points: octave as colour, size as circle, angle as ray.

    Parameters
    ----------
    image : ndarray, uint8, shape (H, W) or (H, W, 3)
        Grey or BGR; it is not changed.
    key_points : sequence of cv2.KeyPoint, or structured array of key_points.DTYPE

    Returns
    -------
    ndarray, uint8, shape (H, W, 3)
        A new BGR image.
    """
    picture = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()
    points = as_array(key_points)[::-1]   # the strongest come last, on top
    radius = np.maximum(points['size'] / 2, 2)
    angle = np.radians(points['angle'])
    ends = (points['x'], points['y'], points['x'] + radius * np.cos(angle), points['y'] + radius * np.sin(angle))
    x, y, ray_x, ray_y, radius = (np.rint(values * (1 << _SHIFT)).astype(int).tolist() for values in (*ends, radius))
    has_ray, octave = (points['angle'] >= 0).tolist(), points['octave'].tolist()
    for i in range(len(points)):
        colour = OCTAVE_COLOURS[octave[i] % len(OCTAVE_COLOURS)]
        cv2.circle(picture, (x[i], y[i]), radius[i], colour, 1, cv2.LINE_AA, _SHIFT)
        if has_ray[i]:
            cv2.line(picture, (x[i], y[i]), (ray_x[i], ray_y[i]), colour, 1, cv2.LINE_AA, _SHIFT)
    return picture


def displayable_response(response: np.ndarray) -> np.ndarray:
    """A response map as a grey picture: corners bright, edges dark, flat areas middle grey.

    The fourth root brings out the weak responses that the few strongest would otherwise hide; zero is always 128.

    Parameters
    ----------
    response : ndarray, float32, shape (H, W)

    Returns
    -------
    ndarray, uint8, shape (H, W)
    """
    largest = float(np.abs(response).max())
    if largest == 0:
        return np.full(response.shape, 128, np.uint8)
    root = np.sqrt(np.sqrt(np.abs(response) / largest))
    return np.rint(128 + 127 * np.copysign(root, response)).astype(np.uint8)
