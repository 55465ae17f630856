"""Key points and response maps as pictures."""

from __future__ import annotations

import functools
import math
from typing import Iterator

import cv2
import numpy as np

from rvc_features.kernels import compiler
from rvc_features.kernels import drawing as compiled
from rvc_features.key_points import KeyPoints, as_array

# BGR, one per octave, starting over after the last; told apart also by people who see red and green alike.
OCTAVE_COLOURS = ((0, 255, 255), (255, 144, 30), (80, 80, 255), (120, 220, 80), (255, 100, 255), (255, 255, 255))

_LEAST_RADIUS = 2   # pixels: smaller circles are dots


def draw_key_points(image: np.ndarray, key_points: KeyPoints, picture: np.ndarray | None = None) -> np.ndarray:
    """The image in colour with its key points: octave as colour, size as circle, angle as ray.

    Parameters
    ----------
    image : ndarray, uint8, shape (H, W) or (H, W, 3)
        Grey or BGR; it is not changed, unless it is the picture, too.
    key_points : sequence of cv2.KeyPoint, or structured array of key_points.DTYPE
    picture : ndarray, uint8, shape (H, W, 3), contiguous, optional
        Where to draw, instead of a new image; what it holds is overwritten. It may be the image itself.

    Returns
    -------
    ndarray, uint8, shape (H, W, 3)
        A new BGR image, or `picture`.
    """
    if picture is None:
        picture = np.empty((*image.shape[:2], 3), np.uint8)
    if image.ndim == 2:
        cv2.cvtColor(image, cv2.COLOR_GRAY2BGR, picture)
    elif picture is not image:
        picture[:] = image

    points = as_array(key_points)
    draw = compiled.stamp if compiler.available() else reference_stamp
    for octave, size, here in _by_octave_and_size(points):
        colour = OCTAVE_COLOURS[octave % len(OCTAVE_COLOURS)]
        radius = size / 2 if size / 2 > _LEAST_RADIUS else _LEAST_RADIUS   # which it also is for NaN
        radius = min(radius, math.hypot(*image.shape[:2]))                 # larger ones are out of sight
        draw(picture, here['x'], here['y'], here['angle'], *_ring(round(radius * 16)), radius, colour)
    return picture


def _by_octave_and_size(points: np.ndarray) -> Iterator[tuple[int, float, np.ndarray]]:
    """Octave, size, and the points that have both; large ones first, so that small ones come on top."""
    octaves, sizes = points['octave'], points['size']
    if len(points) > 0 and (octaves == octaves[0]).all() and (sizes == sizes[0]).all():
        yield int(octaves[0]), float(sizes[0]), points
        return
    for octave, size in sorted(set(zip(octaves.tolist(), sizes.tolist())), reverse=True):
        yield octave, size, points[(octaves == octave) & (sizes == size)]


@functools.lru_cache(maxsize=256)
def _ring(sixteenths: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of a circle round (0, 0), x and y; the radius comes in sixteenths of a pixel."""
    if sixteenths > 16 * _LARGEST_CANVAS:
        return _large_ring(sixteenths / 16)
    middle = sixteenths // 16 + 2
    canvas = np.zeros((2 * middle + 1, 2 * middle + 1), np.uint8)
    cv2.circle(canvas, (middle << 4, middle << 4), sixteenths, (1,), 1, cv2.LINE_8, 4)
    y, x = np.nonzero(canvas)
    return x - middle, y - middle


_LARGEST_CANVAS = 256   # pixels: larger circles are not worth a canvas of their own


def _large_ring(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """The same, computed: for each column of the flat part the pixel above and below, and the other way round."""
    along = np.arange(math.ceil(radius / math.sqrt(2)) + 1)
    across = np.rint(np.sqrt(radius * radius - along * along)).astype(along.dtype)
    x, y = np.concatenate((along, across)), np.concatenate((across, along))
    return np.concatenate((x, -x, x, -x)), np.concatenate((y, y, -y, -y))


def reference_stamp(picture: np.ndarray, x: np.ndarray, y: np.ndarray, angle: np.ndarray, ring_x: np.ndarray,
                    ring_y: np.ndarray, radius: float, colour: tuple[int, int, int]) -> None:
    """Draw a ring round each point, and a ray of that length where it has an angle, as far as they are in the picture.

    All at once: a call of OpenCV for each circle takes several times as long.
    """
    _set_pixels(picture, np.rint(x)[:, None] + ring_x, np.rint(y)[:, None] + ring_y, colour)
    with_ray = angle >= 0
    x, y, angle = (values[with_ray].astype(np.float64)[:, None] for values in (x, y, np.radians(angle, dtype=float)))
    steps = np.arange(np.ceil(radius))
    _set_pixels(picture, np.rint(x + np.cos(angle) * steps), np.rint(y + np.sin(angle) * steps), colour)


def _set_pixels(picture: np.ndarray, x: np.ndarray, y: np.ndarray, colour: tuple[int, int, int]) -> None:
    height, width = picture.shape[:2]
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
