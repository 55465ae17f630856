"""Masks: rectangles, files, newest images, borders; and that no point ever lies under one."""

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features import detectors
from rvc_features.comparison import live
from rvc_features.comparison.datasets import Pair
from rvc_features.comparison.pair_task import Settings, key
from rvc_features.odometry.masks import Border, FixedMask, MaskError, Masks, parse, shaded
from rvc_features.odometry.tracks import Tracker


def test_rectangles_are_left_out_and_cut_at_the_rim():
    mask = Masks(parse('2,1,3,2; -5,-5,7,6')).of((5, 8))
    expected = np.full((5, 8), 255, np.uint8)
    expected[1:3, 2:5] = 0
    expected[:1, :2] = 0
    np.testing.assert_array_equal(mask, expected)


@pytest.mark.parametrize('given', ['2,1,3,2 0,0,1,1', '2, 1, 3, 2;0 ,0,1,1', [[2, 1, 3, 2], [0, 0, 1, 1]]])
def test_rectangles_in_every_spelling(given):
    assert parse(given).rectangles == ((2, 1, 3, 2), (0, 0, 1, 1))


def test_one_rectangle_as_numbers_and_none_at_all():
    assert parse([2, 1, 3, 2]).rectangles == ((2, 1, 3, 2),)
    for nothing in ('', ' ', []):
        assert Masks(parse(nothing)).of((5, 8)) is None


@pytest.mark.parametrize('given', ['1,2,3', '1,2,3,0', '1,2,3,4,5', '1.5,2,3,4', [1, 2], [[1, 2, 3, 'x']], 5, True, {},
                                   'no_such_file.png', '/'])
def test_what_is_no_mask_is_refused_with_what_is_accepted(given):
    with pytest.raises(MaskError, match=r'accepted are an image file .* or rectangles'):
        parse(given)


def test_a_file_counts_for_images_of_its_size_only(tmp_path):
    image = np.zeros((30, 40), np.uint8)
    image[:, 20:] = 7
    cv2.imwrite(str(tmp_path / 'mask.png'), image)
    masks = Masks(parse(str(tmp_path / 'mask.png')))
    np.testing.assert_array_equal(masks.of((30, 40)), np.where(image, 255, 0))
    assert masks.problem((30, 40)) == ''
    assert masks.of((40, 30)) is None
    assert masks.problem((40, 30)) == 'mask file refused: it has 40 x 30 pixels, and the images have 30 x 40'


def test_the_newest_image_counts_and_one_of_another_size_leaves_it():
    masks = Masks(FixedMask(image=np.zeros((4, 6), np.uint8)))
    first, second = np.full((4, 6), 1, np.uint8), np.eye(4, 6, dtype=np.uint8)
    for image in (first, second):
        masks.add(image)
        np.testing.assert_array_equal(masks.of((4, 6)), image * 255)
        assert masks.problem((4, 6)) == ''
    for _ in range(3):
        masks.add(np.ones((6, 4), np.uint8))
        np.testing.assert_array_equal(masks.of((4, 6)), second * 255)
    assert masks.problem((4, 6)) == ('mask refused: it has 4 x 6 pixels, and the images have 6 x 4, the last one that '
                                     'fits stays')


@pytest.mark.parametrize('image', [np.zeros((4, 6)), np.zeros((4, 6, 3), np.uint8), np.zeros((0, 6), np.uint8), None])
def test_what_is_no_mask_image_is_refused(image):
    with pytest.raises(MaskError, match=r'a mask must be a uint8 array of shape \(height, width\); got'):
        Masks().add(image)


def test_each_side_has_its_own_border():
    mask = Masks(border=Border(1, 2, 3, 4)).of((10, 12))
    expected = np.zeros((10, 12), np.uint8)
    expected[3:6, 1:10] = 255
    np.testing.assert_array_equal(mask, expected)
    assert not Masks(border=Border(left=500, bottom=500)).of((10, 12)).any()


def test_the_mask_is_made_once_and_can_not_be_written_to():
    masks = Masks(parse('0,0,2,2'))
    mask = masks.of((10, 12))
    assert masks.of((10, 12)) is mask
    with pytest.raises(ValueError, match='read-only'):
        mask[0, 0] = 1
    masks.border = Border(1)
    assert masks.of((10, 12)) is not mask


def test_masked_pixels_are_half_as_bright_and_the_others_as_before():
    picture = np.random.default_rng(0).integers(0, 256, (20, 30, 3), np.uint8)
    mask = Masks(parse('5,5,10,10')).of((20, 30))
    drawn = shaded(picture.copy(), mask)
    np.testing.assert_array_equal(drawn[mask > 0], picture[mask > 0])
    assert np.abs(drawn[mask == 0] - picture[mask == 0] / 2).max() <= 1
    np.testing.assert_array_equal(shaded(picture.copy(), None), picture)


@pytest.mark.parametrize('name', detectors.names())
def test_no_point_and_no_track_is_ever_under_the_mask(name):
    image = texture((240, 320), 3)
    detector, tracker = detectors.create(name), Tracker()
    masks = Masks(parse('100,60,90,80'), Border(40, 35, 33, 36))
    for step in range(6):
        moved = np.roll(image, 7 * step, axis=1)
        mask = masks.of(moved.shape)
        for points in (detector.detect_arrays(moved, mask), tracker.track(moved, step / 10, detector, mask)):
            assert len(points) > 20
            columns, rows = (np.rint(points[axis]).astype(int) for axis in 'xy')
            assert (mask[rows, columns] == 255).all()


def test_what_is_compared_has_no_points_under_the_mask(tmp_path):
    group = tuple(contestant.specification() for contestant in live.contestants())
    image = texture((240, 320), 3)
    for contestant in Settings(group, mask='0,0,200,240').contestants():
        assert contestant.detect(image)['x'].min() >= 199.5
    pair = Pair('scene', 'one', None, image, None, None)
    file = tmp_path / 'mask.png'
    keys = {key(pair, Settings(group)), key(pair, Settings(group, mask='0,0,200,240'))}
    for value in (0, 255):
        cv2.imwrite(str(file), np.full((240, 320), value, np.uint8))
        keys.add(key(pair, Settings(group, mask=str(file))))
    assert len(keys) == 4   # a result is kept under what decides it, and so does what is in the file


def test_the_mosaic_shows_the_mask():
    image = texture((240, 320), 3)
    plain = live.SideBySide(live.contestants(['harris'])).mosaic(image)
    masked = live.SideBySide(live.contestants(['harris']), masks=Masks(parse('0,0,320,240'))).mosaic(image)
    assert masked.shape == plain.shape
    assert masked[-240:].mean() < 0.6 * plain[-240:].mean()
