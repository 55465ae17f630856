"""A detector as a user's own package would bring it."""

from dataclasses import dataclass
from typing import ClassVar

from rvc_features import detectors, key_points
from rvc_features.feature_detector import FeatureDetector
from rvc_features.parameters import Choice, Flag, Integer, Real, parameter


@detectors.register
@dataclass(frozen=True)
class CentreDetector(FeatureDetector):
    """One point, in the middle, if there is anything to see."""

    name: ClassVar[str] = 'centre'

    number_of_points: int = parameter(1, Integer('How many times.', 0))
    size: int = parameter(11, Integer('Size of the point in pixels.', 1, 99, odd=True))
    offset: float = parameter(0.0, Real('Shift to the right in pixels.', 0))
    fail: bool = parameter(False, Flag('Raise an error, as detectors may.'))
    place: str = parameter('middle', Choice('Where.', ('middle', 'corner')))

    def detect_impl(self, image, mask):
        if self.fail:
            raise RuntimeError('told to fail')
        height, width = image.shape
        x, y = 0.0, 0.0
        if self.place == 'middle':
            x, y = min(width / 2 + self.offset, width - 1), min(height / 2, height - 1)
        if image.min() == image.max() or (mask is not None and mask[int(y), int(x)] == 0):
            return key_points.empty()
        found = key_points.empty(1)
        found['x'], found['y'], found['size'] = x, y, self.size
        return found
