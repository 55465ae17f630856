"""Descriptors of key points: what their surroundings look like, in bytes that can be compared.

OpenCV computes them, at our positions, with our angles and sizes.

References
----------
E. Rublee et al., "ORB: an efficient alternative to SIFT or SURF", ICCV 2011.
D. Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 60(2), 2004.
"""

from __future__ import annotations

import functools
from typing import Any

import cv2
import numpy as np

from rvc_features import key_points as kp
from rvc_features.feature_detector import as_grey

SIZES = {'orb': 32, 'sift': 128}   # bytes of a descriptor, by name
NORMS = {'orb': cv2.NORM_HAMMING, 'sift': cv2.NORM_L2}   # what two of them are compared by, for cv2.BFMatcher
_ORB_SCALE = 1.2
_SIFT_SIZE = 1.6 * 2   # diameter of a point of SIFT's first layer, in pixels


def describe(image: np.ndarray, key_points: kp.KeyPoints, name: str = 'orb',
             smallest: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Descriptors of key points.

    Parameters
    ----------
    image : ndarray, uint8, shape (H, W) or (H, W, 3)
        Where the points were found.
    key_points : sequence of cv2.KeyPoint, or structured array of key_points.DTYPE
        A point without an angle is described upright.
    name : {'orb', 'sift'}
    smallest : float, optional
        ORB: the size of points that are described at full resolution; larger ones are in a level of the pyramid.
        Default: the smallest size there is among them.

    Returns
    -------
    ndarray, intp, shape (N,)
        Which of the points are described, in their order: those too near to the rim are not.
    ndarray, uint8, shape (N, SIZES[name])
        A row for each of them.

    Raises
    ------
    ValueError
        For an unknown name.
    """
    if name not in SIZES:
        raise ValueError(f'descriptor must be one of {", ".join(SIZES)}; got {name!r}')
    points = kp.as_array(key_points)
    if len(points) == 0:
        return np.zeros(0, np.intp), np.zeros((0, SIZES[name]), np.uint8)
    described = points.copy()
    if name == 'orb':
        smallest = float(points['size'].min()) if smallest is None else smallest
        if smallest > 0:
            described['octave'] = np.rint(np.log(np.maximum(points['size'], smallest) / smallest)
                                          / np.log(_ORB_SCALE)).clip(0, _ORB_LEVELS - 1).astype(np.int32)
    else:
        described['size'] = np.maximum(points['size'], _SIFT_SIZE)
        most = max(int(np.log2(min(image.shape[:2]))) - 3, 0)   # a level of eight pixels has no surroundings
        described['octave'] = np.log2(described['size'] / _SIFT_SIZE).astype(np.int32).clip(0, most)
    described['angle'] = np.maximum(points['angle'], 0)
    objects = kp.to_objects(described)
    for index, point in enumerate(objects):
        point.class_id = index   # tells afterwards which ones are left
    left, rows = _extractor(name).compute(as_grey(image), objects)
    if rows is None:
        return np.zeros(0, np.intp), np.zeros((0, SIZES[name]), np.uint8)
    which = np.array([point.class_id for point in left], np.intp)
    order = np.argsort(which, kind='stable')
    return which[order], np.rint(rows[order]).clip(0, 255).astype(np.uint8)


_ORB_LEVELS = 8


@functools.lru_cache(maxsize=None)
def _extractor(name: str) -> Any:
    if name == 'orb':
        return cv2.ORB_create(scaleFactor=_ORB_SCALE, nlevels=_ORB_LEVELS)   # type: ignore[attr-defined]
    if not hasattr(cv2, 'SIFT_create'):
        raise ValueError(f'OpenCV {cv2.__version__} has no SIFT, which came with 4.4; take the descriptor orb')
    return cv2.SIFT_create()   # type: ignore[attr-defined]
