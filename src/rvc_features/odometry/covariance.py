"""Covariance: how far, and in which direction, the noise of the image may have moved each point.

A parametric bootstrap: noise of the image's own strength is added again, the maximum of the strength nearest to each
point is found again, and how far it has moved then is how far it is likely to have moved before. That takes the local
structure and the detector as they are, with maxima that jump to a neighbour; a formula from the gradients alone does
not.

Reference
---------
B. Efron and R. Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 6.
"""

from __future__ import annotations

import functools

import cv2
import numpy as np

from rvc_features import contrast, maxima
from rvc_features.feature_detector import FeatureDetector, as_grey
from rvc_features.octaves import pyramid

SAMPLES = 16
LEAST_NOISE = 12 ** -0.5   # grey values: what rounding to whole ones does
# Calibrated on photographs and drawings with noise of 1, 2, 4 and 8 grey values, see docs/odometry.md.
_SCALE = 0.9         # of all
_ROUND = 0.5         # share of the mean of both directions, for sixteen samples don't tell them apart exactly
_FLOOR = 1e-4        # squared pixels of the octave for noise of one squared grey value, added in all directions
_WHOLE = 1 / 12      # squared pixels of the octave: of positions that are whole pixels
_STEP, _SIDE = 24, 4   # noise is one field, moved by steps in a grid of that many to a side: drawing it costs most


def covariances(image: np.ndarray, found: np.ndarray, detector: FeatureDetector,
                noise: float | None = None) -> np.ndarray:
    """Covariance of the positions of key points.

    The ellipse of 95 % is where `d @ inv(covariance) @ d <= 5.99`, d the distance from the point.

    Parameters
    ----------
    image : ndarray, uint8, shape (H, W) or (H, W, 3)
        Where the points were found.
    found : structured array of key points, such as `detector.detect_arrays` returns
    detector : FeatureDetector
        What found them; it must have a response map.
    noise : float, optional
        Standard deviation of the image's noise in grey values; default: as estimated from it, which is too little where
        most of it is black or white without noise, and too much in fine texture.

    Returns
    -------
    ndarray, float32, shape (N, 2, 2)
        In squared pixels; x first.

    Raises
    ------
    ValueError
        When the detector has no response map, or `noise` is no number of at least 0.
    """
    grey = as_grey(image)
    if noise is not None and not 0 <= noise < np.inf:
        raise ValueError(f'noise must be a number of at least 0, in grey values; got {noise}')
    noise = max(contrast.noise(grey) if noise is None else float(noise), LEAST_NOISE)
    moved = np.zeros((len(found), SAMPLES, 2))
    octaves = detector.pyramid_levels(found)
    levels = int(octaves.max()) + 1 if len(found) else 0
    here = [np.flatnonzero(octaves == octave) for octave in range(levels)]
    size = 2.0 ** octaves.astype(np.float64)
    positions = np.column_stack((found['x'], found['y'])) / size[:, None]
    for sample in range(SAMPLES if levels else 0):
        for octave, level in enumerate(pyramid(_with_noise(grey, noise, sample), None, levels)):
            strength = detector.response_map(level.image)
            if strength is None:
                raise ValueError(f'{detector.name} has no response map, and so no covariances')
            moved[here[octave], sample] = _nearest_maxima(strength, positions[here[octave]]) - positions[here[octave]]
    covariance = np.einsum('nki,nkj->nij', moved, moved) / SAMPLES
    mean = np.trace(covariance, axis1=1, axis2=2)[:, None, None] / 2 * np.eye(2)
    whole = (positions == np.rint(positions)).all(axis=1)[:, None, None] * _WHOLE
    covariance = _SCALE * ((1 - _ROUND) * covariance + _ROUND * mean + (_FLOOR * noise ** 2 + whole) * np.eye(2))
    return (covariance * size[:, None, None] ** 2).astype(np.float32)


@functools.lru_cache(maxsize=2)
def _noise_field(height: int, width: int) -> np.ndarray:
    """Always the same: whoever asks twice gets the same answer."""
    margin = _STEP * (_SIDE - 1)
    return np.random.default_rng(0).standard_normal((height + margin, width + margin), np.float32)


def _with_noise(grey: np.ndarray, noise: float, sample: int) -> np.ndarray:
    """The image with the noise of that sample added."""
    height, width = grey.shape
    down, across = (_STEP * number for number in divmod(sample, _SIDE))
    field = _noise_field(height, width)[down:down + height, across:across + width]
    return cv2.addWeighted(grey.astype(np.float32), 1, field, noise, 0, dtype=cv2.CV_8U)


def _nearest_maxima(strength: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Where the strength is largest near each position, between the pixels: uphill by two pixels at the most."""
    height, width = strength.shape
    x, y = np.clip(np.rint(positions).astype(np.intp), 1, (width - 2, height - 2)).T
    for _ in range(2):
        around = np.stack([strength[y + down, x + across] for down, across in _AROUND])
        down, across = np.array(_AROUND)[around.argmax(axis=0)].T
        x, y = np.clip(x + across, 1, width - 2), np.clip(y + down, 1, height - 2)
    return np.column_stack(maxima.refine(strength, x, y))


_AROUND = [(0, 0)] + [(down, across) for down in (-1, 0, 1) for across in (-1, 0, 1) if down or across]
