"""The strength at two scales: geometry, light, noise."""

import cv2
import numpy as np
import pytest
from conftest import draw_polygon, texture

from rvc_features import contrast
from rvc_features.maxima import local_maxima, refine, rise
from rvc_features.two_scales import two_scale_strength


def corners_of(image, count=None, **settings):
    """Positions of the strongest maxima, (N, 2), strongest first."""
    strength = two_scale_strength(image, **settings)
    x, y = local_maxima(strength, 1e-3 * float(strength.max()))
    order = np.argsort(-strength[y, x], kind='stable')[:count]
    return np.column_stack(refine(strength, x[order], y[order]))


def test_noise_hardly_moves_the_top_of_a_slanted_hill():
    """Its place is that of all nine values; by the middle row and column alone it misses by .1 px."""
    generator, misses = np.random.default_rng(0), []
    y, x = np.mgrid[:9, :9]
    for _ in range(200):
        top, angle = 4 + generator.uniform(-0.45, 0.45, 2), generator.uniform(0, np.pi)
        along = (x - top[0]) * np.cos(angle) + (y - top[1]) * np.sin(angle)
        across = (y - top[1]) * np.cos(angle) - (x - top[0]) * np.sin(angle)
        hill = np.exp(-along ** 2 / 18 - across ** 2 / 2.88) + generator.normal(0, 0.01, (9, 9))
        found = np.ravel(refine(hill.astype(np.float32), np.array([4]), np.array([4])))
        misses.append(np.hypot(*(found - top)))
    assert np.mean(misses) < 0.07


def test_a_summit_on_a_ridge_rises_less_than_one_by_itself():
    y, x = np.mgrid[:41, :81].astype(np.float32)
    alone = np.exp(-((x - 20) ** 2 + (y - 20) ** 2) / 8)
    ridge = np.exp(-(y - 20) ** 2 / 8) * (0.9 + 0.1 * np.exp(-(x - 60) ** 2 / 8)) * (x > 40)
    response = 4 * (alone + ridge)
    by_itself, on_ridge, foot, rim = rise(response, np.array([20, 60, 30, 80]), np.array([20, 20, 20, 20]))
    assert by_itself == pytest.approx(3.68, abs=0.01)
    assert on_ridge == pytest.approx(2.79, abs=0.01)   # of its circle, a fourth lies on the ridge
    assert foot == pytest.approx(0.05 * response[20, 30])   # all round it is higher, and it is a point still
    assert rim == pytest.approx(on_ridge, rel=0.25)   # beyond the rim the ridge goes on
    assert rise(3 * response, np.array([60]), np.array([20])) == pytest.approx(3 * on_ridge)


@pytest.mark.parametrize('dtype', [np.uint8, np.float32])
@pytest.mark.parametrize(('window', 'inwards'), [('gaussian', 1.3), ('box', 1.8)])   # plain Harris: 1.7
def test_square_has_its_four_corners(dtype, window, inwards):
    vertices = np.array([(60, 50), (180, 50), (180, 170), (60, 170)]) + 0.3
    image = draw_polygon(vertices).astype(dtype)
    found = corners_of(image, 4, window=window)
    distances = np.linalg.norm(found[:, None] - vertices, axis=2).min(axis=0)
    assert distances.max() < inwards
    strength = two_scale_strength(image, window=window)
    assert len(local_maxima(strength, 0.3 * float(strength.max()))[0]) == 4


@pytest.mark.parametrize(('gain', 'offset'), [(0.25, 0), (1.6, 0), (1, 30), (1, -30), (0.5, 30)])
@pytest.mark.parametrize('dtype', [np.uint8, np.float32])
def test_points_are_the_same_in_every_light(dtype, gain, offset):
    image = 40 + 20 * (texture((150, 200)) // 51).astype(dtype)   # grey values 40 to 140 that every gain keeps whole
    changed = (image.astype(float) * gain + offset).astype(dtype)
    before, after = corners_of(image), corners_of(changed)
    assert len(before) == len(after) > 100
    assert np.linalg.norm(before[:, None] - after, axis=2).min(axis=1).max() <= 1e-3


def test_quarter_turn_turns_the_points():
    image = texture((151, 201))   # of odd sides: the half-size image takes the same pixels
    expected = corners_of(image)
    turned = corners_of(np.rot90(image).copy())
    back = np.column_stack((200 - turned[:, 1], turned[:, 0]))
    distances = np.linalg.norm(expected[:, None] - back, axis=2)
    assert len(expected) == len(turned)
    assert distances.min(axis=1).max() <= 1e-3


@pytest.mark.parametrize('value', [0, 97, 255])
@pytest.mark.parametrize('dtype', [np.uint8, np.float32])
def test_flat_image_has_no_corners(dtype, value):
    image = np.full((60, 80), value, dtype)
    assert not two_scale_strength(image).any()
    assert contrast.noise(image) == 0
    assert not contrast.local_energy(image, np.array([3.0, 79]), np.array([4.5, 0])).any()


@pytest.mark.parametrize(('arguments', 'text'), [
    ((np.zeros((9, 9), np.float64),), 'image must be .*; got float64'),
    ((np.zeros((9, 9, 3), np.uint8),), r'image must be .*; got shape \(9, 9, 3\)'),
    ((np.zeros((9, 9), np.uint8), 4), 'window_size must be an odd integer of at least 3; got 4'),
    ((np.zeros((9, 9), np.uint8), 5, 'disc'), "window must be one of 'gaussian', 'box'; got 'disc'"),
])
def test_wrong_arguments_are_named(arguments, text):
    with pytest.raises((TypeError, ValueError), match=text):
        two_scale_strength(*arguments)


@pytest.mark.parametrize('sigma', [1, 2, 3, 5])
@pytest.mark.parametrize('dtype', [np.uint8, np.float32])
def test_noise_is_measured_beside_a_picture(dtype, sigma):
    y, x = np.mgrid[:240, :320]
    picture = 128 + 40 * np.sin(x / 17) * np.cos(y / 23)
    cv2.circle(picture, (160, 120), 60, 200, -1)
    image = np.rint(picture + np.random.default_rng(sigma).normal(0, sigma, picture.shape)).astype(dtype)
    assert contrast.noise(image) == pytest.approx(sigma, rel=0.1)


def test_energy_tells_where_the_contrast_is():
    image = texture((300, 400)).astype(np.float32)
    image[:, 200:] *= 0.1
    x, y = np.array([60.0, 340]), np.array([150.0, 150])
    left, right = contrast.local_energy(image, x, y)
    assert left > 10 * right > 0
    assert contrast.local_energy(2 * image + 7, x, y) == pytest.approx([4 * left, 4 * right], rel=1e-4)
    assert contrast.local_energy(image, x[:0], y[:0]).shape == (0,)
    assert np.isfinite(contrast.local_energy(image[:3, :5].copy(), np.array([0, 4]), np.array([0, 2]))).all()
