"""The interface of every detector: OpenCV's verb `detect(image, mask)`, and what all detectors do the same way.

It can't be a subclass of `cv2.Feature2D`: Python allows that, but any inherited method then follows a null pointer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import cv2
import numpy as np

from rvc_features import key_points, parameters
from rvc_features.kernels import compiler
from rvc_features.kernels import grey as compiled


class FeatureDetector(ABC):
    """A detector: parameters at construction, no state per image, never changed but replaced.

    To make one, derive a frozen dataclass, give it a `name`, declare each field with `parameters.parameter`, and
    write `detect_impl`; `@detectors.register` makes it known. opencv_detectors.py has three short examples.
    """

    name: ClassVar[str]

    def __post_init__(self) -> None:
        parameters.validate(self)

    def detect(self, image: np.ndarray, mask: np.ndarray | None = None) -> list[cv2.KeyPoint]:
        """Key points of an image, strongest first.

        Parameters
        ----------
        image : ndarray, uint8, shape (H, W) or (H, W, 3)
            Grey or BGR.
        mask : ndarray, uint8 or bool, shape (H, W), optional
            Where key points may lie: not zero. What is stronger elsewhere is left out of account.

        Raises
        ------
        TypeError, ValueError
            When an argument is not as above; the text says what was given.
        key_points.KeyPointError
            When the detector itself returns what can't be key points of that image.
        """
        return key_points.to_objects(self.detect_arrays(image, mask))

    def detect_arrays(self, image: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
        """The same key points as `detect`, as one structured array of `key_points.DTYPE` (no KeyPoint objects)."""
        grey = as_grey(image)
        return key_points.checked(self.detect_impl(grey, _as_mask(mask, grey.shape)), grey.shape, self.name)

    @abstractmethod
    def detect_impl(self, image: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
        """Key points of a checked grey image as an array of `key_points.DTYPE`, in any order.

        `mask` is None or uint8 of the image's shape: 255, or 0 where no key point may lie.
        """

    def pyramid_levels(self, points: np.ndarray) -> np.ndarray:
        """Which halving of the image each of its points was found in, int32 (N,); for detectors with a response map."""
        return points['octave']

    def response_map(self, image: np.ndarray) -> np.ndarray | None:
        """Strength of every pixel, float32 (H, W), for detectors that compute one; else None."""
        return None


def as_grey(image: np.ndarray) -> np.ndarray:
    """The grey image of a grey or BGR one; TypeError or ValueError for anything else."""
    accepted = 'image must be a non-empty uint8 array of shape (height, width) or (height, width, 3) BGR'
    if not isinstance(image, np.ndarray):
        raise TypeError(f'{accepted}; got {type(image).__name__}')
    if image.dtype != np.uint8:
        raise TypeError(f'{accepted}; got {image.dtype}')
    if image.size == 0 or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] in (1, 3))):
        raise ValueError(f'{accepted}; got shape {image.shape}')
    if image.ndim == 2:
        return image
    if image.shape[2] == 1:
        return image[:, :, 0]
    return compiled.grey_of_colour(image) if compiler.available() else grey_of_colour(image)


def grey_of_colour(image: np.ndarray) -> np.ndarray:
    """Grey of a BGR image as OpenCV has it, uint8 (H, W, 3) -> (H, W): .114 blue + .587 green + .299 red, rounded."""
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def _as_mask(mask: np.ndarray | None, shape: tuple) -> np.ndarray | None:
    if mask is None:
        return None
    accepted = f'mask must be None or a uint8 or bool array of the image\'s shape {shape}'
    if not isinstance(mask, np.ndarray):
        raise TypeError(f'{accepted}; got {type(mask).__name__}')
    if mask.dtype not in (np.uint8, np.bool_):
        raise TypeError(f'{accepted}; got {mask.dtype}')
    if mask.shape != shape:
        raise ValueError(f'{accepted}; got {mask.shape}')
    return (mask != 0).astype(np.uint8) * np.uint8(255)   # ORB ignores anything below 255
