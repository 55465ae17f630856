"""Key points as one structured array, and the way from and to OpenCV's KeyPoint objects.

The array is what the package works on; a `cv2.KeyPoint` costs 0.25 microseconds apiece and is made only when asked.
"""

from __future__ import annotations

import math
from typing import Any, Sequence, Union

import cv2
import numpy as np

from rvc_features import filters
from rvc_features.brief import cut
from rvc_features.kernels import compiler
from rvc_features.kernels import key_points as compiled

DTYPE = np.dtype([
    ('x', np.float32),          # position in pixels of the full image; (0, 0) is the centre of the top left pixel
    ('y', np.float32),
    ('size', np.float32),       # diameter of the neighbourhood that was looked at, in pixels of the full image
    ('angle', np.float32),      # degrees in [0, 360), clockwise from +x as the image is seen; -1: not computed
    ('response', np.float32),   # strength, in the units of the detector
    ('octave', np.int32),       # level of the pyramid; 0 is the full image; what descriptors take for a scale
])

NAMES = ('x', 'y', 'size', 'angle', 'response', 'octave')   # in the order of cv2.KeyPoint's arguments

KeyPoints = Union[np.ndarray, Sequence[cv2.KeyPoint]]


class KeyPointError(ValueError):
    """What a detector returned can't be the key points of its image; the text says which detector, and why."""


def checked(found: Any, shape: tuple[int, ...], detector: str) -> np.ndarray:
    """What a detector found, strongest first; a KeyPointError unless these are key points of an image of that shape.

    That is a one-dimensional array of `DTYPE`, every number finite, no size below zero, and every point in the image
    or no further outside than its own size: what draws or sends them, or matches them, can rely on it.
    """
    wanted = f'detector {detector!r} must return an array of key_points.DTYPE, one-dimensional; got'
    if not isinstance(found, np.ndarray):
        raise KeyPointError(f'{wanted} {type(found).__name__}')
    if found.dtype != DTYPE or found.ndim != 1:
        raise KeyPointError(f'{wanted} shape {found.shape} of {cut(str(found.dtype))}')
    sound = (compiled.sound_and_strongest_first if compiler.available()
             else reference_sound_and_strongest_first)(found, shape[0], shape[1])
    if sound is not None:
        return sound   # as nearly always: what follows finds the words for what is wrong, or lies a little outside
    _check_numbers(found, shape, detector)
    return strongest(found, len(found))


def _check_numbers(found: np.ndarray, shape: tuple[int, ...], detector: str) -> None:
    if len(found) == 0:
        return
    # Minimum and maximum tell it all: NaN comes through either, and nothing is allocated.
    for name in NAMES[:-1]:
        values = found[name]
        low, high = float(values.min()), float(values.max())
        if not (math.isfinite(low) and math.isfinite(high)):
            raise KeyPointError(f'detector {detector!r} returned a key point whose {name} is not finite')
        if name == 'size' and low < 0:
            raise KeyPointError(f'detector {detector!r} returned a key point of size {low:g}')
        if name in ('x', 'y'):
            length = shape[1] if name == 'x' else shape[0]
            if low < -0.5 or high > length - 0.5:
                outside = np.maximum(-0.5 - values, values - (length - 0.5)) > np.maximum(found['size'], 1)
                if outside.any():
                    raise KeyPointError(f'detector {detector!r} returned a key point at {name} = '
                                        f'{float(values[outside][0]):g} in an image of {shape[1]} x {shape[0]} pixels')


def reference_sound_and_strongest_first(found: np.ndarray, height: int, width: int) -> np.ndarray | None:
    """Key points, strongest first, if their numbers are finite, no size is below zero, and all lie in the image."""
    finite = all(np.isfinite(found[name]).all() for name in NAMES[:-1])
    inside = all(((found[name] >= -0.5) & (found[name] <= np.float32(length - 0.5))).all()
                 for name, length in (('x', width), ('y', height)))
    return reference_strongest(found, len(found)) if finite and inside and (found['size'] >= 0).all() else None


def of_corners(x: np.ndarray, y: np.ndarray, responses: np.ndarray, size: int, octave: int) -> np.ndarray:
    """Key points of an octave's corners, with no angle.

    Parameters
    ----------
    x, y : ndarray of int, shape (N,)
        In pixels of the octave.
    responses : ndarray of float, shape (N,)
    size : int
        Of the neighbourhood of each, in pixels of the octave.
    octave : int
    """
    if compiler.available():
        return compiled.of_corners(x, y, responses, size, octave).view(DTYPE)
    return reference_of_corners(x, y, responses, size, octave)


def reference_of_corners(x: np.ndarray, y: np.ndarray, responses: np.ndarray, size: int, octave: int) -> np.ndarray:
    """`of_corners` field by field."""
    corners = empty(len(x))
    corners['x'], corners['y'] = x << octave, y << octave
    corners['size'] = size << octave
    corners['response'] = responses
    corners['octave'] = octave
    return corners


def strongest(key_points: np.ndarray, count: int) -> np.ndarray:
    """The `count` strongest of key points, strongest first; of equals those that come first."""
    if compiler.available():
        return compiled.strongest(key_points, count)
    return reference_strongest(key_points, count)


def reference_strongest(key_points: np.ndarray, count: int) -> np.ndarray:
    """`strongest` by a sort of all; `take` picks whole records forty times as fast as an index."""
    return key_points.take(filters.reference_order(key_points['response'], count))


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
