"""Key points and response maps as pictures."""

from __future__ import annotations

import functools

import cv2
import numpy as np

from rvc_features import kernels
from rvc_features.key_points import KeyPoints, as_array

# BGR, one per octave, starting over after the last; told apart also by people who see red and green alike.
OCTAVE_COLOURS = ((0, 255, 255), (255, 144, 30), (80, 80, 255), (120, 220, 80), (255, 100, 255), (255, 255, 255))

_LEAST_RADIUS = 2   # pixels: smaller circles are dots


def draw_key_points(image: np.ndarray, key_points: KeyPoints, picture: np.ndarray | None = None) -> np.ndarray:
    """The image in colour with its key points: octave as colour, size as circle, angle as ray.

    Parameters
    ----------
    image : ndarray, uint8, shape (H, W) or (H, W, 3)
        Grey or BGR; it is not changed.
    key_points : sequence of cv2.KeyPoint, or structured array of key_points.DTYPE

    picture : ndarray, uint8, shape (H, W, 3), contiguous, optional
        Where to draw, instead of a new image; what it holds is overwritten.

    Returns
    -------
    ndarray, uint8, shape (H, W, 3)
        A new BGR image, or `picture`.
    """
    if picture is None:
        picture = np.empty((*image.shape[:2], 3), np.uint8)
    if image.ndim == 2:
        cv2.cvtColor(image, cv2.COLOR_GRAY2BGR, picture)
    else:
        picture[:] = image

    points = as_array(key_points)
    for octave, size in sorted(set(zip(points['octave'].tolist(), points['size'].tolist())), reverse=True):
        here = points[(points['octave'] == octave) & (points['size'] == size)]   # small ones come on top of large ones
        colour = OCTAVE_COLOURS[octave % len(OCTAVE_COLOURS)]
        radius = max(size / 2, _LEAST_RADIUS)
        x, y = here['x'].astype(np.float64), here['y'].astype(np.float64)
        _set_pixels(picture, np.rint(x), np.rint(y), *_ring(round(radius * 16)), colour)
        with_ray = here['angle'] >= 0
        angle, steps = np.radians(here['angle'][with_ray], dtype=np.float64)[:, None], np.arange(np.ceil(radius))
        _set_pixels(picture, x[with_ray], y[with_ray], np.cos(angle) * steps, np.sin(angle) * steps, colour)
    return picture


@functools.lru_cache(maxsize=256)
def _ring(sixteenths: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of a circle round (0, 0), x and y, float64, shape (1, M); the radius comes in sixteenths of a pixel."""
    middle = sixteenths // 16 + 2
    canvas = np.zeros((2 * middle + 1, 2 * middle + 1), np.uint8)
    cv2.circle(canvas, (middle << 4, middle << 4), sixteenths, (1,), 1, cv2.LINE_8, 4)
    y, x = np.nonzero(canvas)
    return (x - float(middle))[None], (y - float(middle))[None]


def _set_pixels(picture: np.ndarray, x: np.ndarray, y: np.ndarray, offsets_x: np.ndarray, offsets_y: np.ndarray,
                colour: tuple[int, int, int]) -> None:
    """Colour the pixels at offsets, shape (N, M) or (1, M), from each of N positions, where they are in the picture.

    One call for all of them: a call of OpenCV for each circle takes several times as long.
    """
    paint = kernels.set_pixels if kernels.available() else reference_set_pixels
    paint(picture, x, y, offsets_x, offsets_y, colour)


def reference_set_pixels(picture: np.ndarray, x: np.ndarray, y: np.ndarray, offsets_x: np.ndarray,
                         offsets_y: np.ndarray, colour: tuple[int, int, int]) -> None:
    """`_set_pixels` with NumPy."""
    height, width = picture.shape[:2]
    x, y = np.rint(x[:, None] + offsets_x), np.rint(y[:, None] + offsets_y)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    picture[y[inside].astype(np.intp), x[inside].astype(np.intp)] = colour


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
