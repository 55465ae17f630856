"""Rings and rays set pixel by pixel; reference: drawing.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import kernel


def stamp(picture: np.ndarray, x: np.ndarray, y: np.ndarray, angle: np.ndarray, ring_x: np.ndarray,
          ring_y: np.ndarray, radius: float, colour: tuple[int, int, int]) -> None:
    """Draw a ring round each point, and a ray; reference: `drawing.reference_stamp`."""
    x, y, angle = (np.ascontiguousarray(values, np.float32) for values in (x, y, angle))
    _stamp(picture, x, y, angle, ring_x, ring_y, float(radius), colour)


@kernel
def _stamp(picture, x, y, angle, ring_x, ring_y, radius, colour):
    height, width = picture.shape[:2]
    reach = max(np.abs(ring_x).max(), np.abs(ring_y).max())
    for i in range(len(x)):
        middle_x, middle_y = np.rint(x[i]), np.rint(y[i])
        if reach <= middle_x < width - reach and reach <= middle_y < height - reach:
            column, row = int(middle_x), int(middle_y)
            for j in range(len(ring_x)):
                _set_pixel(picture, row + ring_y[j], column + ring_x[j], colour)
        else:
            for j in range(len(ring_x)):
                _set_pixel_inside(picture, middle_y + ring_y[j], middle_x + ring_x[j], colour)
        if angle[i] >= 0:
            to_x, to_y = np.cos(np.radians(np.float64(angle[i]))), np.sin(np.radians(np.float64(angle[i])))
            for step in range(int(np.ceil(radius))):
                _set_pixel_inside(picture, np.rint(y[i] + to_y * step), np.rint(x[i] + to_x * step), colour)


@kernel
def _set_pixel_inside(picture, row, column, colour):
    if 0 <= row < picture.shape[0] and 0 <= column < picture.shape[1]:
        _set_pixel(picture, int(row), int(column), colour)


@kernel
def _set_pixel(picture, row, column, colour):
    picture[row, column, 0], picture[row, column, 1], picture[row, column, 2] = colour
