"""The registry, and a detector from outside."""

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features import detectors, key_points
from rvc_features.feature_detector import FeatureDetector
from rvc_features.parameters import Integer, parameter


@pytest.fixture
def registry(monkeypatch):
    monkeypatch.setattr(detectors, '_registered', dict(detectors._registered))


def test_names():
    assert detectors.names() == sorted(detectors.names())
    assert {'fast', 'good_features_to_track', 'harris', 'orb'} <= set(detectors.names())


def test_create_passes_parameters_on():
    assert detectors.create('harris', window_size=7, threshold=0.02).window_size == 7
    assert 'threshold=30' in repr(detectors.create('fast', threshold=30))


@pytest.mark.parametrize(('name', 'values', 'error', 'text'), [
    ('sift', {}, ValueError, "unknown detector 'sift'; there are fast, good_features_to_track, harris"),
    ('harris', {'windowsize': 5}, TypeError, "harris has no parameter 'windowsize'; it has window_size, window"),
    ('fast', {'threshold': 0}, ValueError, 'threshold must be an integer from 1 to 255; got 0'),
    ('fast', {'type': '1_2'}, ValueError, "type must be one of '5_8', '7_12', '9_16'; got '1_2'"),
    ('orb', {'scale_factor': 1.0}, ValueError, 'scale_factor must be a finite number above 1, at most 4; got 1.0'),
    ('good_features_to_track', {'quality_level': 0}, ValueError, 'quality_level must be'),
])
def test_bad_requests_are_named(name, values, error, text):
    with pytest.raises(error, match=text):
        detectors.create(name, **values)


def test_adapters_give_what_opencv_gives():
    image = texture((240, 320))
    peers = {
        ('fast', 25): cv2.FastFeatureDetector_create(25),
        ('good_features_to_track', None): cv2.GFTTDetector_create(10000, 0.05, 7, 5, 3, True, 0.05),
        ('orb', None): cv2.ORB_create(300, 1.3, 5, 20, scoreType=cv2.ORB_FAST_SCORE, fastThreshold=15),
    }
    ours = {
        ('fast', 25): detectors.create('fast', threshold=25, number_of_points=10000),
        ('good_features_to_track', None): detectors.create(
            'good_features_to_track', number_of_points=10000, quality_level=0.05, minimum_distance=7.0, block_size=5,
            use_harris=True, harris_k=0.05),
        ('orb', None): detectors.create('orb', number_of_points=300, scale_factor=1.3, levels=5, edge_threshold=20,
                                        score='fast', fast_threshold=15),
    }
    for which, peer in peers.items():
        expected = key_points.from_objects(peer.detect(image))
        points = ours[which].detect_arrays(image)
        assert len(points) > 30
        expected = expected[np.argsort(-expected['response'], kind='stable')][:len(points)]   # ORB gives a few more
        for field in key_points.NAMES:
            if field != 'response' or expected[field].any():   # older OpenCV leaves out what the next test is about
                assert np.array_equal(points[field], expected[field]), (which, field)


def test_a_detector_from_outside_registers_itself(registry):
    @detectors.register
    @dataclass(frozen=True)
    class Centre(FeatureDetector):
        name: ClassVar[str] = 'centre'
        size: int = parameter(10, Integer('Size of the point.', 1, 100))

        def detect_impl(self, image, mask):
            found = key_points.empty(1)
            found['x'], found['y'], found['size'] = image.shape[1] / 2, image.shape[0] / 2, self.size
            return found

    assert 'centre' in detectors.names()
    point, = detectors.create('centre', size=20).detect(np.zeros((40, 60), np.uint8))
    assert (point.pt, point.size, point.angle) == ((30.0, 20.0), 20.0, -1.0)
    with pytest.raises(ValueError, match='size must be an integer from 1 to 100; got 0'):
        detectors.create('centre', size=0)


def test_registering_is_refused_with_a_reason(registry):
    class Nameless(FeatureDetector):
        def detect_impl(self, image, mask):
            raise AssertionError('never called')

    with pytest.raises(TypeError, match='derived from FeatureDetector; got 3'):
        detectors.register(3)
    with pytest.raises(TypeError, match=r'Nameless.name must be .*; got None'):
        detectors.register(Nameless)
    Nameless.name = 'harris'
    with pytest.raises(ValueError, match=r"'harris' is registered already, by rvc_features\.harris_detector"):
        detectors.register(Nameless)


def test_an_unfinished_detector_can_not_be_made():
    with pytest.raises(TypeError, match='abstract'):
        type('Unfinished', (FeatureDetector,), {'name': 'unfinished'})()


@pytest.mark.parametrize('use_harris', [False, True])
def test_strength_of_good_features_to_track_is_that_of_the_map(use_harris):
    """With every OpenCV: 4.2 leaves the responses of its key points at 0."""
    image = texture()
    detector = detectors.create('good_features_to_track', use_harris=use_harris)
    points = detector.detect_arrays(image)
    assert (points['response'] > 0).all()
    np.testing.assert_array_equal(points['response'],
                                  detector.response_map(image)[points['y'].astype(int), points['x'].astype(int)])


def test_a_ratio_that_a_float_can_not_tell_from_1_is_no_error(monkeypatch):
    """OpenCV 4.14 refuses it, which older ones take."""
    given = []
    create = cv2.ORB_create
    monkeypatch.setattr(cv2, 'ORB_create', lambda **options: given.append(options) or create(**options))
    detectors.create('orb', scale_factor=1 + 1e-15, edge_threshold=5).detect_arrays(texture((60, 80)))
    assert np.float32(given[0]['scaleFactor']) > 1
