"""A detector as a user's own package would bring it."""

from dataclasses import dataclass
from typing import ClassVar

from rvc_features import detectors, key_points
from rvc_features.feature_detector import FeatureDetector
from rvc_features.parameters import Choice, Flag, Integer, Real, parameter


@detectors.register
@dataclass(frozen=True)
class CentreDetector(FeatureDetector):
    """One point, in the middle."""

    name: ClassVar[str] = 'centre'

    number_of_points: int = parameter(1, Integer('How many times.', 0))
    size: int = parameter(11, Integer('Size of the point in pixels.', 1, 99, odd=True))
    offset: float = parameter(0.0, Real('Shift to the right in pixels.', 0))
    fail: bool = parameter(False, Flag('Raise an error, as detectors may.'))
    place: str = parameter('middle', Choice('Where.', ('middle', 'corner')))

    def detect_impl(self, image, mask):
        if self.fail:
            raise RuntimeError('told to fail')
        found = key_points.empty(1)
        if self.place == 'middle':
            found['x'], found['y'] = image.shape[1] / 2 + self.offset, image.shape[0] / 2
        found['size'] = self.size
        return found
