"""Key points and response maps as pictures."""

from __future__ import annotations

import cv2
import numpy as np

from rvc_features.key_points import KeyPoints, as_array

# BGR, one per octave, starting over after the last; told apart also by people who see red and green alike.
OCTAVE_COLOURS = ((0, 255, 255), (255, 144, 30), (80, 80, 255), (120, 220, 80), (255, 100, 255), (255, 255, 255))

_SHIFT = 4          # drawing coordinates have this many fractional bits
_LEAST_RADIUS = 2   # pixels: smaller circles are dots


def draw_key_points(image: np.ndarray, key_points: KeyPoints, picture: np.ndarray | None = None) -> np.ndarray:
    """The image in colour with its key points: octave as colour, size as circle, angle as ray.

    Parameters
    ----------
    image : ndarray, uint8, shape (H, W) or (H, W, 3)
        Grey or BGR; it is not changed.
    key_points : sequence of cv2.KeyPoint, or structured array of key_points.DTYPE

    picture : ndarray, uint8, shape (H, W, 3), optional
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
    for octave in np.unique(points['octave'])[::-1]:   # small ones on top of large ones
        here = points[points['octave'] == octave]
        colour = OCTAVE_COLOURS[octave % len(OCTAVE_COLOURS)]
        centre = np.column_stack((here['x'], here['y']))[:, None, :]
        radius = np.maximum(here['size'] / 2, _LEAST_RADIUS)[:, None, None]
        # One call for all circles and one for all rays: a call for each costs more than the drawing.
        corners = _directions(np.linspace(0, 2 * np.pi, _corners(radius.max()), endpoint=False))
        _draw_lines(picture, centre + radius * corners, True, colour)
        with_ray = here['angle'] >= 0
        ends = _directions(np.radians(here['angle'][with_ray]))[:, None, :] * radius[with_ray]
        _draw_lines(picture, centre[with_ray] + np.concatenate((np.zeros_like(ends), ends), axis=1), False, colour)
    return picture


def _corners(radius: float) -> int:
    """How many corners make a polygon a circle to the eye."""
    return int(np.clip(4 * np.ceil(np.sqrt(6 * radius) / 2), 12, 120))


def _directions(angles: np.ndarray) -> np.ndarray:
    return np.column_stack((np.cos(angles), np.sin(angles)))


def _draw_lines(picture: np.ndarray, vertices: np.ndarray, closed: bool, colour: tuple[int, int, int]) -> None:
    """Lines through vertices of shape (lines, vertices, 2)."""
    whole = np.rint(vertices * (1 << _SHIFT)).astype(np.int32)
    cv2.polylines(picture, whole, closed, colour, 1, cv2.LINE_AA, _SHIFT)


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
