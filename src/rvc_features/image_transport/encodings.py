"""Encodings of images in ROS: what type and channels each has, and conversions between them.

cv_bridge says what an encoding's type and channels are, and no more: in Python it ignores `step`, takes whatever it
decompresses for bgr8, and converts colours in four to nine times the time of cv2.cvtColor, with other threads waiting.
"""

from __future__ import annotations

import functools
import re
import sys
from typing import Any

import cv2
import numpy as np

from rvc_features.brief import shown
from rvc_features.feature_detector import as_grey


class ImageError(ValueError):
    """An image that can't be used; the text says what is wrong with it."""


YUV = {'yuv422': 'UYVY', 'yuv422_yuy2': 'YUY2'}   # OpenCV's names
_BAYER = {'bayer_rggb': 'BayerBG', 'bayer_bggr': 'BayerRG', 'bayer_gbrg': 'BayerGR', 'bayer_grbg': 'BayerGB'}
COLOURS = ('bgr', 'rgb', 'bgra', 'rgba')
OF_CHANNELS = {1: 'mono', 3: 'bgr', 4: 'bgra'}   # how OpenCV has images, and what generic encodings are taken for
COLOUR_OF_FOUR = {'8UC4': 'bgra8', '16UC4': 'bgra16'}   # the fourth channel isn't compressed: a name brings it back
_GENERIC = re.compile(r'\d+[USF]C\d+')   # a type and a number of channels, but no word of what they mean
_LONGEST = 40   # characters of an encoding
# What cv_bridge says of those that cameras send. It loads OpenCV's libraries a second time, those of the system, which
# takes a fifth of a second and forty megabytes: not before it is needed.
_USUAL = {'mono8': ('uint8', 1), 'bgr8': ('uint8', 3), 'rgb8': ('uint8', 3), 'bgra8': ('uint8', 4),
          'rgba8': ('uint8', 4), 'mono16': ('uint16', 1), '16UC1': ('uint16', 1), '32FC1': ('float32', 1),
          **{name + '8': ('uint8', 1) for name in _BAYER}}


@functools.lru_cache(maxsize=64)
def layout(encoding: str) -> tuple[np.dtype, int]:
    """Type and number of channels of an encoding."""
    if encoding in _USUAL:
        name, channels = _USUAL[encoding]
        return np.dtype(name), channels
    return _layout_of_cv_bridge(encoding)


def _layout_of_cv_bridge(encoding: str) -> tuple[np.dtype, int]:
    from cv_bridge import CvBridge, CvBridgeError
    try:
        if len(encoding) > _LONGEST:
            raise CvBridgeError
        dtype, channels = CvBridge().encoding_to_dtype_with_channels('yuv422' if encoding in YUV else encoding)
        if _GENERIC.fullmatch(encoding) and not encoding.endswith(f'C{channels}'):   # 8UC0, 8UC513
            raise CvBridgeError
    except CvBridgeError:
        raise ImageError(f'unknown encoding {shown(encoding)}') from None
    return np.dtype(dtype), channels


def fitting(array: np.ndarray, encoding: str) -> np.ndarray:
    """The array in the machine's byte order and without gaps; ImageError where it isn't one of that encoding."""
    dtype, channels = layout(encoding)
    shape = array.shape if array.ndim == 3 else (*array.shape, 1)
    if array.dtype.newbyteorder('=') != dtype or len(shape) != 3 or shape[2] != channels or array.size == 0:
        raise ImageError(f'{encoding} wants a non-empty {dtype} array of shape (height, width'
                         f'{f", {channels}" if channels > 1 else ""}); got {array.dtype} {array.shape}')
    return np.ascontiguousarray(array, dtype)


def letters(encoding: str) -> str:
    return encoding.rstrip('0123456789')


def converted(array: np.ndarray, encoding: str, target: str) -> np.ndarray:
    """Pixels of any encoding as bgr8 or mono8."""
    if _GENERIC.fullmatch(encoding):
        channels = 1 if array.ndim == 2 else array.shape[2]
        if channels not in OF_CHANNELS:
            raise ImageError(f'{encoding} images have no conversion to {target}')
        array, encoding = array if array.dtype == np.uint8 else _stretched(array), f'{OF_CHANNELS[channels]}8'
    elif array.dtype == np.uint16:
        upper = array.view(np.uint8)[..., int(sys.byteorder == 'little')::2]
        array, encoding = np.ascontiguousarray(upper), f'{letters(encoding)}8'
    return recoloured(array, encoding, target)


def recoloured(array: np.ndarray, encoding: str, target: str) -> np.ndarray:
    """Pixels of a named encoding as another one of the same depth."""
    if encoding == target:
        return array
    if (encoding, target) == ('bgr8', 'mono8'):
        return as_grey(array)   # for less of the processor than OpenCV
    source, goal = letters(encoding), letters(target).upper().replace('MONO', 'GRAY')
    if encoding in YUV:
        name = f'YUV2{goal}_{YUV[encoding]}'
    else:
        name = f'{_BAYER.get(source) or source.upper().replace("MONO", "GRAY")}2{goal}'
    try:
        return cv2.cvtColor(array, getattr(cv2, f'COLOR_{name}'))
    except cv2.error as error:
        raise ImageError(f'{array.shape} {encoding} image can not become {target}: {error.err}') from None


def _stretched(array: np.ndarray) -> np.ndarray:
    """8-bit pixels of any others: valid values stretched over 1 to 255, the others 0."""
    flat = array.reshape(array.shape[0], -1)
    valid = np.isfinite(flat) if flat.dtype.kind == 'f' else flat != 0
    if not valid.any():
        return np.zeros(array.shape, np.uint8)
    stretched = np.zeros(flat.shape, np.uint8)
    cv2.normalize(flat, stretched, 1, 255, cv2.NORM_MINMAX, cv2.CV_8U, valid.astype(np.uint8))
    return stretched.reshape(array.shape)


def buffer(data: Any) -> memoryview:
    try:
        return memoryview(bytes(data) if isinstance(data, (list, tuple)) else data).cast('B')
    except (TypeError, ValueError) as error:
        raise ImageError(f'data must be bytes; got {type(data).__name__}: {error}') from None
