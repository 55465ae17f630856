"""A detector that takes 100 ms for each image, to see what a node does that can't keep up."""

import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rvc_features import detectors, key_points
from rvc_features.feature_detector import FeatureDetector


@detectors.register
@dataclass(frozen=True)
class SlowDetector(FeatureDetector):
    """No points, late."""

    name: ClassVar[str] = 'slow'

    def detect_impl(self, image: np.ndarray, mask: 'np.ndarray | None') -> np.ndarray:
        time.sleep(0.1)
        return key_points.empty()
