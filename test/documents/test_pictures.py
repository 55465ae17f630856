"""The pictures of the course's pages show what they say."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'docs' / 'extensions'))
import drawings

from rvc_features import presets
from rvc_features.drawing import draw_key_points
from rvc_features.exercise.mistakes import TABLE


# One that shows in the places of points, one in the rays, one in the circles; the build of the site draws the others.
@pytest.mark.parametrize('name', ['trace not squared', 'angle mirrored', 'octave not set'])
def test_mistakes_have_a_picture_and_a_sentence(name):
    picture, sentence = drawings.mistake(name)
    assert sentence in {' '.join(way.__doc__.split()) for way in TABLE[name]}
    assert min(picture.shape[:2]) > 150
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10


def test_a_mistake_that_there_is_not_is_refused():
    with pytest.raises(ValueError, match='is no known mistake; there are trace not squared'):
        drawings.mistake('spelling')


def test_the_panels_of_settings_are_what_the_detector_finds():
    image = drawings.photograph()
    points = presets.create('course', threshold=0.1).detect_arrays(image)
    shown = drawings.sliders(['course:threshold=0.1', 'course'])
    panel = cv2.resize(draw_key_points(image, points), (400, 300), interpolation=cv2.INTER_CUBIC)
    first = shown[-300:, :400]
    np.testing.assert_array_equal(first, panel)
    assert (shown[-300:, -400:] != first).any()
