"""Directions of key points: what they do when the surface that is seen turns, tilts, or carries noise."""

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features import orientation
from rvc_features.comparison import measures, warps
from rvc_features.comparison.correspondences import CommonRegion
from rvc_features.comparison.homographies import project
from rvc_features.harris_detector import HarrisDetector
from rvc_features.kernels import compiler


def errors_at_truth(direction, image, matrix):
    """Degrees by which directions at places of the image and at the same ones seen under a matrix disagree."""
    seen = cv2.warpPerspective(image, matrix, image.shape[::-1], flags=cv2.INTER_AREA)
    places = np.random.default_rng(3).uniform(120, 280, (300, 2))
    first, second = (direction(each, *where.T, 1.6)
                     for each, where in ((image, places), (seen, project(matrix, places))))
    return measures.orientation_errors(first, second, matrix, places)


def test_directions_stay_on_a_tilted_surface():
    """Where the gradient alone turns towards the direction in which the surface is foreshortened."""
    image = texture((400, 400), seed=5, smoothing=4.0)
    tilt = np.array([[0.45, 0, 110], [0.1, 1, -20], [0, 0, 1]])
    on_the_surface = np.median(errors_at_truth(orientation.direction_of_scales, image, tilt))
    assert on_the_surface < 14
    assert on_the_surface < 0.75 * np.median(errors_at_truth(orientation.gradient_orientation, image, tilt))


def test_without_shape_adaptation_directions_are_the_gradients():
    """A ramp to the right under diagonal stripes, whose normal the adaptation turns away from."""
    y, x = np.mgrid[:160, :160]
    image = (40 + x + 20 * np.cos((x + y) * 2 * np.pi / 16)).astype(np.float32)
    on_a_crest = np.array([80.0]), np.array([80.0])
    (gradients,) = orientation.direction_of_scales(image, *on_a_crest, 1.6, shape_adaptation=False)
    (adapted,) = orientation.direction_of_scales(image, *on_a_crest, 1.6)
    assert min(gradients, 360 - gradients) < 2
    assert 315 < adapted < 350   # 315 runs along the stripes


@pytest.mark.parametrize(('degrees', 'sigma', 'most'), [(40, 2, 2.5), (200, 2, 2.5), (200, 5, 1.1)])
def test_directions_turn_with_a_noisy_picture(degrees, sigma, most):
    photograph = warps.generated_photograph()
    turned, matrix = warps.warped(photograph, 'rotation', degrees)
    noise = np.random.default_rng(0).normal(0, sigma, (2, *turned.shape))
    images = [np.rint(np.clip(image + grey, 0, 255)).astype(np.uint8)
              for image, grey in zip((warps.reference(photograph), turned), noise)]
    first, second = (HarrisDetector(fixed_number_of_points=True, number_of_points=300).detect_arrays(image)
                     for image in images)
    region = CommonRegion(measures.positions(first), measures.positions(second), matrix, *(i.shape for i in images))
    i, j, _ = measures.found_again(region, 1.5)
    errors = measures.orientation_errors(first['angle'][i], second['angle'][j], matrix, measures.positions(first)[i])
    assert len(errors) > 150
    assert np.median(errors) < most   # were all scales trusted alike, 1.25 at the last
    assert np.mean(errors < 10) > 0.9


@pytest.mark.parametrize('shape', [(1, 1), (3, 5), (17, 40), (70, 19)])
def test_images_of_any_size_have_directions(shape):
    image = np.random.default_rng(1).integers(0, 256, shape).astype(np.uint8)
    angles = orientation.direction_of_scales(image, np.array([0.0]), np.array([shape[0] - 1.0]), 1.6)
    assert 0 <= angles[0] < 360
    flat = np.full(shape, 97, np.uint8)
    assert orientation.direction_of_scales(flat, np.array([0.0]), np.array([0.3]), 1.6) == [0]


def test_directions_are_the_same_without_kernels(monkeypatch):
    image = texture((90, 120))
    x, y = np.random.default_rng(2).uniform(0, 89, (2, 100))
    for each in (image, image.astype(np.float32)):
        angles = orientation.direction_of_scales(each, x, y, 1.6)
        with monkeypatch.context() as without:
            without.setattr(compiler, 'available', lambda: False)
            reference = orientation.direction_of_scales(each, x, y, 1.6)
        assert np.abs((angles - reference + 180) % 360 - 180).max() < 0.01
