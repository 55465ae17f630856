"""OpenCV's detectors behind the package's interface (exercise 3): thin adapters, strongest points first.

Made with `cv2.X_create`, not `cv2.X.create`: ROS Noetic's OpenCV 4.2 has only the former, the stubs only the latter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np

from rvc_features import filters, key_points
from rvc_features.feature_detector import FeatureDetector, as_grey
from rvc_features.parameters import Choice, Flag, Integer, Real, parameter
from rvc_features.response import HARRIS_K

NUMBER_OF_POINTS = Integer('How many points to return at the most; the strongest.', 0)


@dataclass(frozen=True)
class _OpenCVDetector(FeatureDetector):
    """Runs a `cv2.Feature2D` and keeps the strongest points, or those that are spread most."""

    number_of_points: int = parameter(500, NUMBER_OF_POINTS)
    anms: bool = parameter(False, filters.ANMS)
    anms_points: int = parameter(500, filters.ANMS_POINTS)
    anms_robustness: float = parameter(0.9, filters.ANMS_ROBUSTNESS)
    anms_pool: float = parameter(4.0, filters.ANMS_POOL)

    def create(self, shape: tuple[int, ...], count: int) -> cv2.Feature2D:
        """OpenCV's detector with these parameters, for `count` points in images of that shape."""
        raise NotImplementedError

    def detect_impl(self, image: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
        count = self._count(image.size)
        if count == 0:
            return key_points.empty()   # OpenCV takes 0 for "no limit"
        found = key_points.from_objects(self.create(image.shape, count).detect(image, mask))
        if self.anms:
            return filters.most_spread(found, self.anms_points, self.anms_robustness, self.anms_pool)
        return found.take(filters.strongest(found['response'], count))

    def _count(self, pixels: int) -> int:
        """How many points OpenCV is asked for."""
        if not self.anms:
            return self.number_of_points
        if self.anms_pool == 0:
            return pixels
        return min(max(round(self.anms_pool * self.anms_points), self.anms_points), pixels)


@dataclass(frozen=True)
class GoodFeaturesToTrackDetector(_OpenCVDetector):
    """Shi and Tomasi's corners (CVPR 1994), or Harris's, at a minimum distance from each other."""

    name: ClassVar[str] = 'good_features_to_track'

    quality_level: float = parameter(0.01, Real(
        'Least response as a share of the largest one in the image.', 0, 1, above_low=True))
    minimum_distance: float = parameter(1.0, Real('Least distance between two points in pixels.', 0))
    block_size: int = parameter(3, Integer('Side of the window in pixels.', 1, 63))
    gradient_size: int = parameter(3, Integer('Side of the Sobel kernel in pixels; odd.', 3, 7, odd=True))
    use_harris: bool = parameter(False, Flag('Harris response instead of the smaller eigenvalue.'))
    harris_k: float = parameter(0.04, HARRIS_K)

    def create(self, shape: tuple[int, ...], count: int) -> cv2.Feature2D:
        return cv2.GFTTDetector_create(count, self.quality_level, self.minimum_distance,
                                       self.block_size, self.gradient_size, self.use_harris, self.harris_k)

    def detect_impl(self, image: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
        found = super().detect_impl(image, mask)
        if not found['response'].any():   # older OpenCV, as of Ubuntu 20.04, leaves it at 0 (opencv#16462)
            found['response'] = self.response_map(image)[found['y'].astype(int), found['x'].astype(int)]
        return found

    def response_map(self, image: np.ndarray) -> np.ndarray:
        """The map that the points are the maxima of."""
        grey = as_grey(image)
        if self.use_harris:
            return cv2.cornerHarris(grey, self.block_size, self.gradient_size, self.harris_k)
        return cv2.cornerMinEigenVal(grey, self.block_size, ksize=self.gradient_size)


@dataclass(frozen=True)
class FastDetector(_OpenCVDetector):
    """Features from accelerated segment test (Rosten and Drummond, ECCV 2006)."""

    name: ClassVar[str] = 'fast'

    threshold: int = parameter(10, Integer('Least difference in grey value between centre and circle.', 1, 255))
    nonmax_suppression: bool = parameter(True, Flag('Take only local maxima of the score.'))
    type: str = parameter('9_16', Choice('How many of how many pixels on the circle must differ.',
                                         ('5_8', '7_12', '9_16')))

    def create(self, shape: tuple[int, ...], count: int) -> cv2.Feature2D:
        kind = getattr(cv2, f'FAST_FEATURE_DETECTOR_TYPE_{self.type}')
        return cv2.FastFeatureDetector_create(self.threshold, self.nonmax_suppression, kind)


@dataclass(frozen=True)
class OrbDetector(_OpenCVDetector):
    """Oriented FAST points in a pyramid (Rublee et al., ICCV 2011)."""

    name: ClassVar[str] = 'orb'

    scale_factor: float = parameter(1.2, Real('Ratio of the sizes of two levels.', 1, 4, above_low=True))
    levels: int = parameter(8, Integer('Levels of the pyramid.', 1, 32))
    edge_threshold: int = parameter(31, Integer('Width in pixels of the rim without points.', 0, 255))
    score: str = parameter('harris', Choice('What the points are ranked by.', ('harris', 'fast')))
    fast_threshold: int = parameter(20, Integer('Threshold of the FAST detector.', 1, 255))

    def create(self, shape: tuple[int, ...], count: int) -> cv2.Feature2D:
        score = cv2.ORB_HARRIS_SCORE if self.score == 'harris' else cv2.ORB_FAST_SCORE
        # OpenCV takes a float, which must be above 1, too, and fails on levels without pixels.
        ratio = max(self.scale_factor, 1 + float(np.finfo(np.float32).eps))
        most = 1 + int(np.log(min(shape)) / np.log(ratio))
        return cv2.ORB_create(nfeatures=count, scaleFactor=ratio,
                              nlevels=min(self.levels, most), edgeThreshold=self.edge_threshold, scoreType=score,
                              fastThreshold=self.fast_threshold)
