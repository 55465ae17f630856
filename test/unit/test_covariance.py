"""Covariances: how often their ellipses hold the error, which way they lie, and what has none."""

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features import detectors
from rvc_features.key_points import DTYPE
from rvc_features.odometry.covariance import covariances

HARRIS = detectors.create('harris')


def noisy(image, noise, seed):
    return np.clip(np.rint(image + np.random.default_rng(seed).normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def positions(points):
    return np.column_stack((points['x'], points['y'])).astype(np.float64)


@pytest.mark.parametrize('octaves', [1, 3])
def test_the_ellipse_of_95_percent_holds_that_many_errors(octaves):
    """Of points under noise against those without, matched within three pixels of the octave."""
    detector = detectors.create('harris', octaves=octaves, fixed_number_of_points=True, number_of_points=300)
    all_of_them = detectors.create('harris', octaves=octaves, threshold=0.0001)
    inside = []
    for seed, noise in ((3, 2.0), (4, 6.0)):
        image = texture((360, 480), seed)
        seen = noisy(image, noise, seed + 100)   # another seed than the texture's, which is made of such noise
        clean, found = all_of_them.detect_arrays(image), detector.detect_arrays(seen)
        distances = np.hypot(*(positions(found)[:, None] - positions(clean)).transpose(2, 0, 1))
        distances[found['octave'][:, None] != clean['octave']] = np.inf
        nearest = distances.argmin(axis=1)
        matched = distances.min(axis=1) <= 3.0 * 2.0 ** found['octave']
        assert matched.mean() > 0.7
        errors = (positions(found) - positions(clean)[nearest])[matched]
        covariance = covariances(seen, found[matched], detector, noise).astype(np.float64)
        inside.append(np.einsum('ni,nij,nj->n', errors, np.linalg.inv(covariance), errors) <= 5.99)
    assert 0.92 <= np.concatenate(inside).mean() <= 0.99   # of one kind of image; docs/odometry.md has the others


def test_a_pointed_corner_is_uncertain_along_its_axis():
    image = np.full((120, 200), 60, np.uint8)
    cv2.fillPoly(image, [np.array([(60, 60), (250, 35), (250, 85)])], (160,))   # its tip points to the left
    image = noisy(cv2.GaussianBlur(image, (0, 0), 1), 3, 0)
    found = HARRIS.detect_arrays(image)[:1]
    assert abs(found['x'][0] - 62) < 8
    covariance = covariances(image, found, HARRIS, 3.0)[0]
    assert covariance[0, 0] > 2 * covariance[1, 1]
    assert covariance[0, 1] == covariance[1, 0]


def test_twice_the_noise_is_twice_the_uncertainty():
    image = cv2.GaussianBlur(texture((240, 320), 1), (0, 0), 1.5)
    found = HARRIS.detect_arrays(image)
    one, two = (np.sqrt(np.trace(covariances(image, found, HARRIS, noise), axis1=1, axis2=2)) for noise in (1.0, 2.0))
    assert np.median(two / one) == pytest.approx(2, rel=0.15)
    np.testing.assert_array_equal(covariances(image, found, HARRIS, 0.0), covariances(image, found, HARRIS, 12 ** -0.5))


def test_the_noise_is_estimated_where_it_is_not_given():
    image = noisy(np.kron(np.eye(8, dtype=np.uint8) * 100 + 60, np.ones((32, 32), np.uint8)), 4, 0)
    found = HARRIS.detect_arrays(image)
    ratio = np.trace(covariances(image, found, HARRIS), axis1=1, axis2=2) \
        / np.trace(covariances(image, found, HARRIS, 4.0), axis1=1, axis2=2)
    assert np.median(ratio) == pytest.approx(1, rel=0.3)


def test_a_layer_is_as_certain_as_its_corner():
    image = texture((200, 260), smoothing=1.5)
    detector = detectors.create('harris', octaves=2, octave_layers=2, merge_octaves=False)
    found = detector.detect_arrays(image)
    once, again = (covariances(image, found[layer::2], detector) for layer in range(2))
    assert set(detector.pyramid_levels(found)) == {0, 1}
    np.testing.assert_array_equal(again, once)


def test_no_points_have_no_covariances():
    assert covariances(texture((60, 80)), np.zeros(0, DTYPE), HARRIS).shape == (0, 2, 2)


def test_what_has_none_is_said():
    image, fast = texture((60, 80)), detectors.create('fast')
    with pytest.raises(ValueError, match='fast has no response map, and so no covariances'):
        covariances(image, fast.detect_arrays(image), fast)
    with pytest.raises(ValueError, match='noise must be a number of at least 0, in grey values; got -1'):
        covariances(image, HARRIS.detect_arrays(image), HARRIS, -1)
