"""Key points as one structured array, and the way from and to OpenCV's KeyPoint objects.

The array is what the package works on; a `cv2.KeyPoint` costs 0.25 microseconds apiece and is made only when asked.
"""

from __future__ import annotations

from typing import Sequence, Union

import cv2
import numpy as np

DTYPE = np.dtype([
    ('x', np.float32),          # position in pixels of the full image; (0, 0) is the centre of the top left pixel
    ('y', np.float32),
    ('size', np.float32),       # diameter of the neighbourhood that was looked at, in pixels of the full image
    ('angle', np.float32),      # degrees in [0, 360), clockwise from +x as the image is seen; -1: not computed
    ('response', np.float32),   # strength, in the units of the detector
    ('octave', np.int32),       # level of the pyramid; 0 is the full image
])

NAMES = ('x', 'y', 'size', 'angle', 'response', 'octave')   # in the order of cv2.KeyPoint's arguments

KeyPoints = Union[np.ndarray, Sequence[cv2.KeyPoint]]


def empty(count: int = 0) -> np.ndarray:
    """`count` key points at the origin with no angle."""
    key_points = np.zeros(count, DTYPE)
    key_points['angle'] = -1
    return key_points


def from_objects(objects: Sequence[cv2.KeyPoint]) -> np.ndarray:
    """Structured array of the same key points in the same order."""
    return np.array([(*point.pt, point.size, point.angle, point.response, point.octave) for point in objects], DTYPE)


def to_objects(key_points: np.ndarray) -> list[cv2.KeyPoint]:
    """`cv2.KeyPoint` objects of the same key points in the same order."""
    return list(map(cv2.KeyPoint, *(key_points[name].tolist() for name in NAMES)))


def as_array(key_points: KeyPoints) -> np.ndarray:
    """Key points given either way as a structured array."""
    if isinstance(key_points, np.ndarray):
        if key_points.dtype != DTYPE:
            raise TypeError(f'key points must be an array of key_points.DTYPE; got an array of {key_points.dtype}')
        return key_points
    return from_objects(key_points)
