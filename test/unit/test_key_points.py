"""What a detector returns is checked where it returns it."""

import re
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from rvc_features import key_points, maxima
from rvc_features.feature_detector import FeatureDetector
from rvc_features.harris_detector import MOST_CORNERS, HarrisDetector


@dataclass(frozen=True)
class Returns(FeatureDetector):
    """Not registered: returns what it is told to."""

    name: ClassVar[str] = 'returns'
    what: Any = None

    def detect_impl(self, image, mask):
        return self.what


def points(**values):
    found = key_points.empty(3)
    found['x'], found['y'], found['size'] = (5, 0, 99), (7, 0, 59), 5
    for name, value in values.items():
        found[name][1] = value
    return found


IMAGE = np.zeros((60, 100), np.uint8)


@pytest.mark.parametrize(('what', 'text'), [
    (None, 'got NoneType'),
    ([], 'got list'),
    (np.zeros((4, 2), np.float32), r'got shape \(4, 2\) of float32'),
    (points().reshape(1, 3), r'got shape \(1, 3\)'),
    (np.zeros(3, np.dtype([('x', np.float64)])), r"got shape \(3,\) of \[\('x', '<f8'\)\]"),
    (points(x=np.nan), 'whose x is not finite'),
    (points(y=-np.inf), 'whose y is not finite'),
    (points(size=np.nan), 'whose size is not finite'),
    (points(size=-1), 'of size -1'),
    (points(angle=np.nan), 'whose angle is not finite'),
    (points(response=np.inf), 'whose response is not finite'),
    (points(x=106), 'at x = 106 in an image of 100 x 60 pixels'),
    (points(y=-6), 'at y = -6 in an image of 100 x 60 pixels'),
    (points(x=5e4, size=10), 'at x = 50000'),
])
def test_rubbish_is_refused_and_the_text_says_whose(what, text):
    with pytest.raises(key_points.KeyPointError, match=text) as raised:
        Returns(what).detect_arrays(IMAGE)
    assert "'returns'" in str(raised.value)
    assert len(str(raised.value)) < 400


@pytest.mark.parametrize('what', [
    key_points.empty(), points(), points(angle=-1, octave=123456789), points(x=103, size=9), points(size=1e6),
    points(x=-0.5, size=0)])
def test_what_lies_in_the_image_passes(what):
    found = Returns(what).detect_arrays(IMAGE)
    assert len(found) == len(what)
    assert len(Returns(what).detect(IMAGE)) == len(what)


def test_settings_that_take_every_pixel_are_bounded_and_it_is_said(caplog):
    image = np.random.default_rng(0).integers(0, 256, (900, 1200), np.uint8)
    ruinous = {'strength': 'harris', 'evenness': 0.0, 'local_maxima': False, 'threshold': 0.0, 'minimum_response': 0.0}
    found = HarrisDetector(**ruinous).detect_arrays(image)
    assert len(found) == MOST_CORNERS
    assert re.search(rf'only the strongest {MOST_CORNERS:,} of \d{{3}},\d{{3}} or more corners', caplog.text)
    # They are the strongest indeed, and the same as those that one asks for by their number.
    asked = HarrisDetector(**ruinous, fixed_number_of_points=True, number_of_points=MOST_CORNERS).detect_arrays(image)
    assert np.array_equal(found, asked)
    spread = HarrisDetector(**ruinous, anms=True, anms_points=50).detect_arrays(image)
    assert len(spread) == 50


def test_of_pixels_above_the_least_the_strongest_are_listed():
    response = np.array([[5, 1, 7, 5], [5, 9, 5, 0]], np.float32)
    listed = [list(zip(*maxima.pixels_above(response, 1, most))) for most in (None, 6, 4, 0)]
    assert listed[0] == listed[1] == [(0, 0), (2, 0), (3, 0), (0, 1), (1, 1), (2, 1)]
    assert listed[2] == [(0, 0), (2, 0), (3, 0), (1, 1)]   # of equals the first
    assert listed[3] == []


def test_a_sigma_so_small_that_its_square_is_zero_smooths_nothing():
    image = np.random.default_rng(0).integers(0, 256, (100, 120), np.uint8)
    plain = HarrisDetector(strength='harris').detect_arrays(image)
    for sigma in (1e-310, 1e-200, 0.05):
        assert np.array_equal(HarrisDetector(strength='harris', derivative_sigma=sigma).detect_arrays(image), plain)
