"""Corners without a map against the response's map and its local maxima; nothing that could be wanted is missing."""

import cv2
import numpy as np
import pytest

from rvc_features import key_points, orientation, response
from rvc_features.detectors import create
from rvc_features.kernels import compiler
from rvc_features.maxima import reference_local_maxima

if not compiler.available():
    pytest.skip('Numba is not installed', allow_module_level=True)

from rvc_features.kernels import response as kernel
from rvc_features.kernels.corners import corners
from rvc_features.kernels.oriented_corners import strongest_oriented

K = 0.04
SHAPES = [(3, 20), (4, 19), (7, 33), (40, 64), (61, 117), (230, 90)]   # the last one high enough for a guess


def images(shape, random):
    yield 'noise', random.integers(0, 256, shape, np.uint8)
    yield 'binary noise', random.integers(0, 2, shape, np.uint8) * np.uint8(255)
    yield 'soft noise', cv2.GaussianBlur(random.integers(0, 256, shape, np.uint8), (0, 0), 2)
    corner = np.zeros(shape, np.uint8)
    corner[shape[0] // 3:, shape[1] // 2:] = 200
    yield 'one corner', corner
    yield 'flat', np.full(shape, 255, np.uint8)
    uneven = corner // 8   # a guess from the rows above would be far off
    uneven[-shape[0] // 4:] = random.integers(0, 256, uneven[-shape[0] // 4:].shape, np.uint8)
    yield 'all in the last rows', uneven


def of_map(image, minimum, border, mask):
    """x, y and response, out of a map of every pixel."""
    values, _ = kernel.response(image, 3, 'box', K)
    x, y = reference_local_maxima(values, minimum)
    height, width = image.shape
    inside = (x >= border) & (x < width - border) & (y >= border) & (y < height - border)
    if mask is not None:
        inside &= mask[y, x] != 0
    return x[inside], y[inside], values[y[inside], x[inside]]


def strongest(found, number):
    order = np.argsort(-found[2], kind='stable')[:number]
    return [values[order] for values in found]


def above(found, share):
    chosen = found[2] > share * found[2].max(initial=0)
    return [values[chosen] for values in found]


def assert_same(found, expected, case):
    assert all(np.array_equal(a, b) for a, b in zip(found, expected)), case


def in_one_call(image, border, mask, number):
    directions = orientation.gaussian_and_slope(2.5)
    return strongest_oriented(image, K, 10.0, border, mask, number, 3, *directions).view(key_points.DTYPE)


def all_cases():
    random = np.random.default_rng(5)
    for shape in SHAPES:
        some = random.integers(0, 2, shape, np.uint8) * np.uint8(255)
        for name, image in images(shape, random):
            for border, mask in ((0, None), (4, None), (1, some)):
                yield (shape, name, border, mask is not None), image, border, mask


def check_all():
    for case, image, border, mask in all_cases():
        expected = of_map(image, 10.0, border, mask)
        assert_same(corners(image, K, 10.0, border, mask), expected, case)
        for number in (0, 1, 30, 10 ** 12):
            found = corners(image, K, 10.0, border, mask, number=number)
            assert_same(strongest(found, number), strongest(expected, number), (*case, number))
        for number in (0, 1, 30):
            points = key_points.reference_of_corners(*strongest(expected, number), 3, 0)
            orientation.orient_along_gradient(points, image, 0, 2.5)
            assert np.array_equal(in_one_call(image, border, mask, number), points), case
        for share in (0.01, 0.5):
            found = corners(image, K, 10.0, border, mask, share=share)
            assert_same(above(found, share), above(expected, share), (*case, share))


def test_corners_without_a_map_are_those_of_the_map():
    check_all()


def test_bands_of_rows_make_no_difference(monkeypatch):
    threads = cv2.getNumThreads()
    cv2.setNumThreads(3)
    monkeypatch.setattr(compiler, '_LEAST_BAND', 1)
    try:
        check_all()
    finally:
        cv2.setNumThreads(threads)


def test_key_points_in_one_call_have_the_direction_of_the_gradient():
    image = cv2.GaussianBlur(np.random.default_rng(6).integers(0, 256, (230, 90), np.uint8), (0, 0), 2)
    found = strongest_oriented(image, K, 10.0, 0, None, 40, 3, *orientation.gaussian_and_slope(2.5))
    found = found.view(key_points.DTYPE)
    expected = found.copy()
    orientation.reference_orient_along_gradient(expected, image, 0, 2.5)
    off = np.abs(found['angle'] - expected['angle'])
    assert len(found) == 40
    assert np.minimum(off, 360 - off).max() < 0.01


@pytest.mark.parametrize('k', [0.01, 0.15, 0.24, 0.25])
def test_the_bound_holds_for_every_k(k):
    image = np.random.default_rng(1).integers(0, 256, (230, 90), np.uint8)
    values, _ = kernel.response(image, 3, 'box', k)
    x, y = reference_local_maxima(values, 10.0)
    expected = strongest((x, y, values[y, x]), 20)
    assert_same(strongest(corners(image, k, 10.0, number=20), 20), expected, k)


def test_most_of_what_is_not_wanted_is_left_out():
    image = np.random.default_rng(2).integers(0, 256, (480, 640), np.uint8)
    assert 100 <= len(corners(image, K, 10.0, number=100)[0]) < 1000 < len(corners(image, K, 10.0)[0])


@pytest.mark.parametrize('octaves', [1, 3])
@pytest.mark.parametrize('chosen', [{'fixed_number_of_points': True, 'number_of_points': 40}, {'threshold': 0.1}])
def test_a_detector_finds_the_same_with_and_without_a_map(monkeypatch, octaves, chosen):
    image = cv2.GaussianBlur(np.random.default_rng(3).integers(0, 256, (300, 200), np.uint8), (0, 0), 1)
    detector = create('harris', strength='harris', evenness=0.0, window='box', window_size=3, subpixel=False,
                      octaves=octaves, **chosen)
    found = detector.detect_arrays(image)
    monkeypatch.setattr(response, 'needs_no_map', lambda *arguments: False)
    assert len(found) >= 10
    assert np.array_equal(found, detector.detect_arrays(image))
