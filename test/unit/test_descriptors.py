"""Descriptors: whose they are, what they are of, and that they match as in the workbench."""

import cv2
import numpy as np
import pytest
from conftest import positions, texture

from rvc_features import detectors, key_points
from rvc_features.odometry.descriptors import NORMS, SIZES, describe

KINDS = [name for name in SIZES if name != 'sift' or hasattr(cv2, 'SIFT_create')]   # OpenCV 4.2 (Noetic) has none
HARRIS = detectors.create('harris', fixed_number_of_points=True, number_of_points=150)


def test_a_turned_image_matches_for_each_kind():
    image = texture((300, 300), 4, 2.5)
    turned = np.ascontiguousarray(np.rot90(image))
    first, second = HARRIS.detect_arrays(image), HARRIS.detect_arrays(turned)
    for name in KINDS:
        i, rows = describe(image, first, name)
        j, other_rows = describe(turned, second, name)
        assert rows.dtype == np.uint8
        assert rows.shape == (len(i), SIZES[name])
        matches = cv2.BFMatcher(NORMS[name], crossCheck=True).match(rows, other_rows)
        x, y = positions(first)[i][[match.queryIdx for match in matches]].T
        expected = np.column_stack((y, 299 - x))
        found = positions(second)[j][[match.trainIdx for match in matches]]
        assert np.mean(np.hypot(*(expected - found).T) < 1.5) > 0.9, name


@pytest.mark.parametrize('name', KINDS)
def test_rows_belong_to_the_points_that_are_named(name):
    image = texture((200, 240), 1)
    found = HARRIS.detect_arrays(image)
    which, rows = describe(image, found, name)
    assert (np.diff(which) > 0).all()
    for index in (0, len(which) // 2, len(which) - 1):
        alone, row = describe(image, found[which[index]:which[index] + 1], name, float(found['size'].min()))
        np.testing.assert_array_equal(alone, [0])
        np.testing.assert_array_equal(row[0], rows[index])


@pytest.mark.parametrize('name', KINDS)
@pytest.mark.parametrize('detector', detectors.names())
def test_points_of_every_detector_can_be_described(detector, name):
    image = texture((160, 200), 2)
    found = detectors.create(detector, number_of_points=60).detect_arrays(image)
    which, rows = describe(image, found, name)
    assert len(which) == len(rows) > 10
    np.testing.assert_array_equal(describe(image, key_points.to_objects(found), name)[1], rows)


@pytest.mark.parametrize('name', KINDS)
def test_nothing_and_points_at_the_rim_have_no_rows(name):
    which, rows = describe(np.zeros((50, 50), np.uint8), key_points.empty(), name)
    assert (which.shape, rows.shape, rows.dtype) == ((0,), (0, SIZES[name]), np.uint8)
    point = key_points.empty(1)
    point['size'] = 5
    which, rows = describe(np.zeros((40, 40), np.uint8), point, 'orb')
    assert rows.shape == (0, 32)


def test_an_unknown_name_is_refused():
    with pytest.raises(ValueError, match="descriptor must be one of orb, sift; got 'surf'"):
        describe(np.zeros((9, 9), np.uint8), key_points.empty(), 'surf')
