"""Pictures, by their pixels."""

import cv2
import numpy as np
import pytest

from rvc_features import key_points
from rvc_features.drawing import OCTAVE_COLOURS, displayable_response, draw_key_points


def point(x=50.0, y=40.0, size=20.0, angle=-1.0, octave=0):
    return cv2.KeyPoint(x, y, size, angle, 1.0, octave)


@pytest.mark.parametrize('octave', range(len(OCTAVE_COLOURS)))
def test_circle_has_the_size_and_the_octave_its_colour(octave):
    picture = draw_key_points(np.zeros((80, 100), np.uint8), [point(octave=octave)])
    colour = np.array(OCTAVE_COLOURS[octave])
    for x, y in ((60, 40), (40, 40), (50, 50), (50, 30)):
        assert np.array_equal(picture[y, x], colour)
    assert not picture[40, 50].any()
    assert not picture[:, 65:].any()


def test_octaves_beyond_the_palette_are_drawn():
    picture = draw_key_points(np.zeros((80, 100), np.uint8), [point(octave=len(OCTAVE_COLOURS))])
    first = draw_key_points(np.zeros((80, 100), np.uint8), [point()])
    assert picture.any()
    assert np.array_equal(picture, first)


@pytest.mark.parametrize(('angle', 'on_ray', 'off_ray'), [
    (0, (55, 40), (45, 40)), (90, (50, 45), (50, 35)), (180, (45, 40), (55, 40)), (270, (50, 35), (50, 45))])
def test_ray_points_along_the_angle(angle, on_ray, off_ray):
    picture = draw_key_points(np.zeros((80, 100), np.uint8), [point(angle=float(angle))])
    assert picture[on_ray[1], on_ray[0]].any()
    assert not picture[off_ray[1], off_ray[0]].any()


def test_the_image_is_not_changed_and_the_picture_is_new():
    for image in (np.full((80, 100), 7, np.uint8), np.full((80, 100, 3), 7, np.uint8)):
        picture = draw_key_points(image, [point()])
        assert (image == 7).all()
        assert picture.shape == (80, 100, 3)
        assert np.array_equal(picture[0, 0], [7, 7, 7])
        assert not np.shares_memory(draw_key_points(image, []), image)


def test_picture_may_be_given_and_be_the_image_itself():
    image, given = np.full((80, 100, 3), 7, np.uint8), np.full((80, 100, 3), 9, np.uint8)
    expected = draw_key_points(image, [point()])
    assert draw_key_points(image, [point()], given) is given
    assert draw_key_points(image, [point()], image) is image
    assert np.array_equal(given, expected)
    assert np.array_equal(image, expected)


def test_read_only_and_strided_images():
    image = np.zeros((80, 200, 3), np.uint8)[:, ::2]
    image.flags.writeable = False
    assert draw_key_points(image, [point()]).any()


def test_arrays_and_objects_give_the_same_picture():
    objects = [point(10, 12.25, 8, 33), point(70.5, 60, 14, octave=2)]
    image = np.zeros((80, 100), np.uint8)
    assert np.array_equal(draw_key_points(image, objects),
                          draw_key_points(image, key_points.from_objects(objects)))


def test_points_at_and_beyond_the_rim():
    assert draw_key_points(np.zeros((80, 100), np.uint8), [point(0, 0), point(99, 79), point(-30, 500)]).any()


def test_a_large_circle_is_as_round_as_a_small_one():
    picture = draw_key_points(np.zeros((900, 900), np.uint8), [point(450, 450, 800)])
    y, x = np.nonzero(picture.any(axis=2))
    assert np.abs(np.hypot(x - 450, y - 450) - 400).max() < 0.8
    quadrants = [((x > 450) == right) & ((y > 450) == low) for right in (True, False) for low in (True, False)]
    for quadrant in quadrants:   # without a gap: on either diagonal half one pixel for each column or row
        assert len(set(x[quadrant])) + len(set(y[quadrant])) >= 2 * 400 - 3


@pytest.mark.parametrize('size', [5e4, 1e6, 1e30, np.inf, np.nan, -5])
def test_sizes_beyond_reason_cost_nothing(size):
    """They ended in a MemoryError."""
    array = key_points.empty(2)
    array['x'], array['y'], array['size'], array['angle'] = (50, np.nan), 40, size, 0
    picture = draw_key_points(np.zeros((80, 100), np.uint8), array)
    assert picture[40, 50:54].any() or np.isnan(size)   # the ray, at least


def test_other_arrays_are_refused():
    with pytest.raises(TypeError, match=r'array of key_points.DTYPE; got an array of float64'):
        draw_key_points(np.zeros((8, 8), np.uint8), np.zeros((3, 2)))


def test_displayable_response_keeps_signs_apart():
    response = np.array([[0, 1e10, -1e10], [1, -1, 1e6]], np.float32)
    picture = displayable_response(response)
    assert picture.dtype == np.uint8
    assert picture[0].tolist() == [128, 255, 1]
    assert picture[1, 0] >= 128 >= picture[1, 1]
    assert 128 < picture[1, 2] < 255
    assert (displayable_response(np.zeros((4, 5), np.float32)) == 128).all()
