"""Detectors side by side on images as they come."""

import numpy as np
import pytest
from conftest import texture

from rvc_features.comparison import live, pictures
from rvc_features.comparison.contestants import ContestantError
from rvc_features.comparison.live import SideBySide


def test_four_by_default_and_words_for_each():
    chosen = live.contestants()
    assert [each.label for each in chosen] == ['harris', 'good_features_to_track', 'fast', 'orb']
    picture = SideBySide(chosen).mosaic(texture((120, 160)))
    assert picture.dtype == np.uint8
    assert picture.shape == (2 * (120 + 40) + 10, 2 * 160 + 10, 3)


def test_labels_captions_and_points(monkeypatch):
    tiles = []
    monkeypatch.setattr(pictures, 'mosaic', lambda given, columns: tiles.append((given, columns)))
    image = np.full((80, 80), 30, np.uint8)
    image[20:40, 20:60] = 200       # corners (20, 20), (59, 20), (20, 39), (59, 39): four cells of 10 pixels
    side_by_side = SideBySide(live.contestants(['four=harris:window_size=3', 'fast:threshold=250']))
    side_by_side.mosaic(image)
    (harris, fast), columns = tiles[0]
    assert columns == 2
    assert harris.label.startswith('four: 4 points, ')
    assert harris.label.endswith(' ms')
    assert harris.caption == '0.1 points per cell, 4 of 64 cells hit'
    assert fast.label.startswith('fast: 0 points, ')
    assert fast.caption == '0.0 points per cell, 0 of 64 cells hit'
    changed = np.abs(harris.image.astype(int) - image[:, :, None]).max(axis=2) > 20
    assert changed[15:26, 15:26].any()
    assert not changed[45:, :].any()
    assert (fast.image == image[:, :, None]).all()


def test_wide_images_are_shrunk_for_the_picture_only(monkeypatch):
    tiles = []
    monkeypatch.setattr(pictures, 'mosaic', lambda given, columns: tiles.extend(given))
    image = np.full((400, 800, 3), 30, np.uint8)
    image[200:300, 400:600] = 220
    side_by_side = SideBySide(live.contestants(['harris']), tile_width=400)
    side_by_side.mosaic(image)
    assert tiles[0].image.shape == (200, 400, 3)
    assert tiles[0].label.startswith('harris: 4 points')
    drawn = np.abs(tiles[0].image.astype(int) - image[::2, ::2]).max(axis=2) > 60
    assert drawn[95:105, 195:205].any()
    assert not drawn[:80].any()


def test_a_large_mosaic_has_large_letters():
    small, large = (pictures.mosaic([pictures.Picture('harris', 'points', np.zeros((10, width, 3), np.uint8))], 1)
                    for width in (400, 800))
    assert small.shape[0] == 50
    assert large.shape[0] == 90
    assert (large == 0).sum() > 2 * (small == 0).sum()


def test_letters_fit_their_picture():
    tile = pictures.Picture('a very long name: ' * 5, '', np.zeros((10, 100, 3), np.uint8))
    picture = pictures.mosaic([tile, tile], 2)
    assert (picture[:40, 99:111] == 255).all()


def test_bad_detectors():
    with pytest.raises(ContestantError, match="unknown detector 'surf'"):
        live.contestants(['harris', 'surf'])


def test_detectors_that_find_nothing_have_a_tile_too_also_with_numpy_1_17(monkeypatch):
    """There np.unique(axis=0) fails on no rows at all, and the node published nothing."""
    unique = np.unique

    def old_unique(array, *arguments, axis=None, **named):
        if axis is not None and len(array) == 0:
            raise ValueError('zero-size array to reduction operation')
        return unique(array, *arguments, axis=axis, **named)

    monkeypatch.setattr(np, 'unique', old_unique)
    blank = np.full((120, 160), 7, np.uint8)
    mosaic = live.SideBySide(live.contestants(), 160).mosaic(blank)
    tile = mosaic[-120:, -160:]
    assert (tile == 7).all()
