"""What all detectors do the same way: arguments, order, masks, arrays and objects."""

import cv2
import numpy as np
import pytest
from conftest import draw_square, texture

from rvc_features import detectors, key_points
from rvc_features.feature_detector import as_grey


@pytest.fixture(params=detectors.names())
def detector(request):
    return detectors.create(request.param)


@pytest.fixture(scope='module')
def image():
    return texture((240, 320))


def test_points_come_strongest_first(detector, image):
    points = detector.detect_arrays(image)
    assert points.dtype == key_points.DTYPE
    assert len(points) > 50
    assert (np.diff(points['response']) <= 0).all()


def test_objects_are_those_of_the_arrays(detector, image):
    objects = detector.detect(image)
    assert all(isinstance(point, cv2.KeyPoint) for point in objects)
    assert np.array_equal(key_points.from_objects(objects), detector.detect_arrays(image))


def test_colour_equals_its_grey_image(detector, image):
    colour = cv2.applyColorMap(image, cv2.COLORMAP_JET)
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
    assert np.array_equal(detector.detect_arrays(colour), detector.detect_arrays(grey))
    assert np.array_equal(detector.detect_arrays(image[:, :, None]), detector.detect_arrays(image))


def test_mask_is_obeyed(detector, image):
    mask = np.zeros(image.shape, np.uint8)
    mask[60:180, 80:240] = 255
    points = detector.detect_arrays(image, mask)
    assert len(points) > 10
    assert mask[np.rint(points['y']).astype(int), np.rint(points['x']).astype(int)].all()
    assert np.array_equal(detector.detect_arrays(image, mask.astype(bool)), points)
    assert len(detector.detect_arrays(image, np.zeros_like(mask))) == 0


def test_strided_image_and_mask(detector, image):
    mask = np.ones((240, 640), np.uint8)[:, ::2]
    wide = np.repeat(image, 2, axis=1)[:, ::2]
    assert np.array_equal(detector.detect_arrays(wide, mask), detector.detect_arrays(image))


def test_number_of_points_takes_the_strongest(image):
    for name in detectors.names():
        more = {'fixed_number_of_points': True} if name == 'harris' else {}
        many = detectors.create(name, number_of_points=10000, **more).detect_arrays(image)
        few = detectors.create(name, number_of_points=20, **more).detect_arrays(image)
        assert len(few) == 20
        if name != 'orb':   # ORB shares the number out among its levels
            assert np.array_equal(few, many[:20])
        assert len(detectors.create(name, number_of_points=0, **more).detect(image)) == 0


def test_a_square_is_seen_by_all(detector):
    points = detector.detect_arrays(cv2.GaussianBlur(draw_square(160, 60, 99), (0, 0), 1))
    distance = np.hypot(points['x'][:, None] - [60, 99, 60, 99], points['y'][:, None] - [60, 60, 99, 99])
    assert (distance.min(axis=0) < 6).all()


@pytest.mark.parametrize(('image', 'error', 'text'), [
    ([[1, 2]], TypeError, 'image must be a non-empty uint8 array .*; got list'),
    (None, TypeError, 'got NoneType'),
    (np.zeros((9, 9)), TypeError, 'got float64'),
    (np.zeros((9, 9), bool), TypeError, 'got bool'),
    (np.zeros(9, np.uint8), ValueError, r'got shape \(9,\)'),
    (np.zeros((9, 9, 4), np.uint8), ValueError, r'got shape \(9, 9, 4\)'),
    (np.zeros((0, 9), np.uint8), ValueError, r'got shape \(0, 9\)'),
])
def test_bad_images_are_named(detector, image, error, text):
    with pytest.raises(error, match=text):
        detector.detect(image)


@pytest.mark.parametrize(('mask', 'error', 'text'), [
    ('all', TypeError, 'mask must be None or .*; got str'),
    (np.zeros((5, 5), np.uint8), ValueError, r'shape \(9, 9\); got \(5, 5\)'),
    (np.zeros((9, 9), np.float32), TypeError, 'got float32'),
])
def test_bad_masks_are_named(detector, mask, error, text):
    with pytest.raises(error, match=text):
        detector.detect(np.zeros((9, 9), np.uint8), mask)


def test_as_grey_does_not_copy_a_grey_image(image):
    assert as_grey(image) is image


def test_response_map(image):
    maps = {name: detectors.create(name).response_map(image) for name in detectors.names()}
    assert maps['fast'] is None
    assert maps['orb'] is None
    for name in ('harris', 'good_features_to_track'):
        assert maps[name].shape == image.shape
        strongest = detectors.create(name, number_of_points=1).detect_arrays(image)[0]
        y, x = np.unravel_index(maps[name].argmax(), image.shape)
        assert abs(strongest['x'] - x) <= 0.5
        assert abs(strongest['y'] - y) <= 0.5
    assert detectors.create('good_features_to_track', use_harris=True).response_map(image).min() < 0
