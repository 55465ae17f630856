"""Local maxima of a response map, and their position between the pixels."""

from __future__ import annotations

import cv2
import numpy as np

from rvc_features import filters
from rvc_features.kernels import compiler
from rvc_features.kernels import maxima as compiled

# The eight neighbours of a pixel, split into those before and those after it in reading order.
_BEFORE = np.array([[1, 1, 1], [1, 0, 0], [0, 0, 0]], np.uint8)
_AFTER = np.array([[0, 0, 0], [0, 0, 1], [1, 1, 1]], np.uint8)


def local_maxima(response: np.ndarray, minimum: float) -> tuple[np.ndarray, np.ndarray]:
    """Pixels above `minimum` that no neighbour exceeds.

    Of neighbours with equal values the first in reading order counts, so that a plateau gives one point and not
    none or many. Pixels outside the image count as lower.

    Parameters
    ----------
    response : ndarray, float32, shape (H, W)
    minimum : float
        A maximum must be greater than this.

    Returns
    -------
    x, y : ndarray, int64, shape (N,)
        In reading order.
    """
    if compiler.available():
        return compiled.local_maxima(response, minimum)
    return reference_local_maxima(response, minimum)


def reference_local_maxima(response: np.ndarray, minimum: float) -> tuple[np.ndarray, np.ndarray]:
    """`local_maxima` with OpenCV's dilation: the largest of the neighbours before and after each pixel."""
    is_maximum = response > minimum
    is_maximum &= response > cv2.dilate(response, _BEFORE)
    is_maximum &= response >= cv2.dilate(response, _AFTER)
    y, x = np.nonzero(is_maximum)
    return x, y


def pixels_above(response: np.ndarray, minimum: float, most: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Every pixel above `minimum`, as the exercise sheet literally has it: x, y in reading order.

    Or the strongest `most` of them: 25 megapixels of points would take gigabytes, and many seconds.
    """
    above = np.flatnonzero(response > minimum)
    if most is not None and len(above) > most:
        above = above.take(np.sort(filters.strongest(response.ravel().take(above), most)))
    y, x = np.divmod(above, response.shape[1])
    return x, y


def refine(response: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions of local maxima between the pixels: the top of the quadratic nearest to the 3x3 values.

    The squares of its misses count with 1 2 1 along rows and columns, which makes its differences those of Sobel's
    masks: noise moves the top less, and so does the way in which the pixels lie. With first differences g and second
    differences S at the pixel, the top is at -S^-1 g (Brown and Lowe, "Invariant features from interest point groups",
    BMVC 2002, eq. 3). Each coordinate moves by half a pixel at the most; where the quadratic has no top, or at the
    image's rim, the pixel stays.

    Parameters
    ----------
    response : ndarray, float32, shape (H, W)
    x, y : ndarray of int, shape (N,)

    Returns
    -------
    x, y : ndarray, float64, shape (N,)
    """
    if compiler.available():
        return compiled.refine(response, x, y)
    return reference_refine(response, x, y)


def reference_refine(response: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`refine` for all points at once."""
    height, width = response.shape
    refined_x, refined_y = x.astype(np.float64), y.astype(np.float64)
    inside = np.flatnonzero((x > 0) & (x < width - 1) & (y > 0) & (y < height - 1))
    flat = response.ravel()
    centre = y[inside] * width + x[inside]

    def at(dx: int, dy: int) -> np.ndarray:
        return flat[centre + (dy * width + dx)].astype(np.float64)

    rows = [[at(dx, dy) for dx in (-1, 0, 1)] for dy in (-1, 0, 1)]
    on_left, across, on_right = ((upper + 2 * here + lower) / 4 for upper, here, lower in zip(*rows))
    on_top, down, on_bottom = ((before + 2 * here + after) / 4 for before, here, after in rows)
    g_x, g_y = (on_right - on_left) / 2, (on_bottom - on_top) / 2
    s_xx, s_yy = on_right - 2 * across + on_left, on_bottom - 2 * down + on_top
    s_xy = (rows[2][2] - rows[2][0] - rows[0][2] + rows[0][0]) / 4

    determinant = s_xx * s_yy - s_xy * s_xy
    has_top = (determinant > 0) & (s_xx < 0)
    determinant[~has_top] = 1
    shift_x = np.where(has_top, (s_xy * g_y - s_yy * g_x) / determinant, 0)
    shift_y = np.where(has_top, (s_xy * g_x - s_xx * g_y) / determinant, 0)
    refined_x[inside] += np.clip(shift_x, -0.5, 0.5)
    refined_y[inside] += np.clip(shift_y, -0.5, 0.5)
    return refined_x, refined_y


def rise(response: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """How far local maxima rise above what lies round them: what tells which of them come back.

    That is the value less .8 times the mean of sixteen pixels on a circle of about four pixels, where that mean is
    positive, and a twentieth of the value at the least. A summit on a ridge, or a small one beside a large one, is gone
    with a little noise or another grid of pixels. Beyond the image's rim the nearest pixel counts.

    Parameters
    ----------
    response : ndarray, float32, shape (H, W)
        Positive at the points.
    x, y : ndarray of int, shape (N,)

    Returns
    -------
    ndarray, float64, shape (N,)
        Positive, and at most the value itself.
    """
    height, width = response.shape
    around = np.zeros(len(x))
    for dx, dy in zip(compiled.AROUND[::2], compiled.AROUND[1::2]):
        around += response[np.clip(y + dy, 0, height - 1), np.clip(x + dx, 0, width - 1)]
    mean = around / (len(compiled.AROUND) / 2)
    value = response[y, x].astype(np.float64)
    return np.maximum(value - compiled.SURROUNDINGS * np.maximum(mean, 0), compiled.LEAST_RISE * value)
