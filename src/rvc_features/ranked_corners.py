"""Corners of a map of strength, ranked by how far they rise in it, beside the contrast round them."""

from __future__ import annotations

import cv2
import numpy as np

from rvc_features import contrast, maxima
from rvc_features.kernels import compiler
from rvc_features.kernels import ranked_corners as compiled
from rvc_features.kernels.ranked_corners import LEAST_ENERGY


def ranked_corners(image: np.ndarray, strength: np.ndarray, minimum: float, border: int, mask: np.ndarray | None,
                   evenness: float, least_of_energy: float = 0.0,
                   share: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Local maxima of the strength, and what they rank by.

    Parameters
    ----------
    image : ndarray, uint8 or float32, shape (H, W)
    strength : ndarray, float32, shape (H, W)
        Of its pixels.
    minimum : float
        What the strength of a corner must exceed.
    border : int
        Width in pixels of a rim in which there is none.
    mask : ndarray, uint8, shape (H, W), optional
        There is none where it is 0.
    evenness : float
        The rank is how far the strength rises, see `maxima.rise`, over the local energy, see `contrast.local_energy`,
        to that power.
    least_of_energy : float
        The least strength of a corner as a share of that energy.
    share : float
        Those whose rank is not above this share of the largest one may be left out.

    Returns
    -------
    x, y : ndarray, int64, shape (N,)
        In reading order.
    rank : ndarray, float32, shape (N,)
        Greater than 0.
    """
    if compiler.available():
        averages = contrast.averages(image)
        return compiled.ranked_corners(strength, minimum, border, mask, averages, contrast.SIDES, lowest(*averages),
                                       evenness, least_of_energy, share)
    return reference_ranked_corners(image, strength, minimum, border, mask, evenness, least_of_energy)


def reference_ranked_corners(image: np.ndarray, strength: np.ndarray, minimum: float, border: int,
                             mask: np.ndarray | None, evenness: float,
                             least_of_energy: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`ranked_corners` step by step, none left out."""
    x, y = inside(*maxima.local_maxima(strength, minimum), strength.shape, border, mask)
    return ranked(image, x, y, strength[y, x], maxima.rise(strength, x, y), evenness, least_of_energy)


def inside(x: np.ndarray, y: np.ndarray, shape: tuple[int, ...], border: int,
           mask: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Those of the pixels that lie inside of border and mask."""
    if border > 0:
        allowed = (x >= border) & (x < shape[1] - border) & (y >= border) & (y < shape[0] - border)
        x, y = x[allowed], y[allowed]
    if mask is not None:
        allowed = mask[y, x] != 0
        x, y = x[allowed], y[allowed]
    return x, y


def ranked(image: np.ndarray, x: np.ndarray, y: np.ndarray, strength: np.ndarray, rise: np.ndarray, evenness: float,
           least_of_energy: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Those of the pixels that are corners beside the contrast round them, and their rank: `rise` beside it.

    Steps of a slanted edge in a drawing are none.
    """
    energy = np.maximum(contrast.local_energy(image, x, y), LEAST_ENERGY)
    ranks = np.where(strength < least_of_energy * energy, 0, rise / energy ** evenness).astype(np.float32)
    chosen = np.flatnonzero(ranks > 0)
    return x.take(chosen), y.take(chosen), ranks.take(chosen)


def lowest(near: np.ndarray, far: np.ndarray) -> np.ndarray:
    """What no local energy in a square of `far`, nor in the half of a square to its right, is below.

    `near` and `far` are `contrast.averages`, between whose centres energies are interpolated.
    """
    step = contrast.SIDES[1] // contrast.SIDES[0]
    # From one square before the first to one after the last that pixels can lie between.
    near = cv2.erode(near, np.ones((step + 2, step + step // 2 + 2), np.uint8), anchor=(1, 1))[::step, ::step]
    return np.maximum(np.sqrt(near * cv2.erode(far, np.ones((3, 3), np.uint8))), LEAST_ENERGY)
