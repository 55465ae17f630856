"""The pictures of the course's pages, each made by the code that the page is about."""

from __future__ import annotations

import textwrap
from typing import Callable, Sequence

import cv2
import numpy as np

from rvc_features.comparison import contestants, warps
from rvc_features.drawing import displayable_response, draw_key_points
from rvc_features.exercise import findings, mistakes, pictures
from rvc_features.exercise.questions import Probe, questions
from rvc_features.exercise.reference import Reference
from rvc_features.recordings.image_sources import read_image
from rvc_features.response import BORDER, window_average

_PANEL = 400            # pixels: width of one picture out of several side by side
_IN_A_ROW = 2
_CAPTION = 26           # pixels
_INK, _PAPER = (235, 235, 235), (40, 40, 40)


def photograph() -> np.ndarray:
    """A chessboard held before a camera, uint8 (240, 320); a drawn picture where opencv-doc is not installed."""
    path = warps.opencv_example('left01.jpg')
    image = read_image(path, grey=True) if path else warps.generated_photograph()
    return cv2.resize(image, (320, 240), interpolation=cv2.INTER_AREA)


def gradients() -> np.ndarray:
    """I_x and I_y."""
    i_x, i_y = _gradients()
    return _side_by_side([(_signed(i_x), 'I_x: dark to light from left to right is light'),
                          (_signed(i_y), 'I_y: the same from top to bottom')])


def products() -> np.ndarray:
    """A, B and C, before and after the window."""
    i_x, i_y = _gradients()
    panels = []
    for name, product in (('A: I_x I_x', i_x * i_x), ('B: I_x I_y', i_x * i_y), ('C: I_y I_y', i_y * i_y)):
        panels += [(_signed(product), f'{name}, pixel by pixel'),
                   (_signed(window_average(product, 7, 'box')), f'{name}, averaged over 7x7')]
    return _side_by_side(panels)


def response() -> np.ndarray:
    """H, beside the image."""
    image = photograph()
    detector = contestants.parse('course:window_size=5', 0).detector
    strength = detector.response_map(image)
    assert strength is not None
    return _side_by_side([(image, 'the image'),
                          (displayable_response(strength), 'H: corners white, edges black, flat grey')])


def sliders(texts: Sequence[str]) -> np.ndarray:
    """What detectors find, each written as on the command line of compare_detectors, with its number of points."""
    image, panels = photograph(), []
    for text in texts:
        points = contestants.parse(text, 0).detect(image)
        panels.append((draw_key_points(image, points), f'{text.replace(",", ", ")}: {len(points)} points'))
    return _side_by_side(panels)


def mistake(name: str) -> tuple[np.ndarray, str]:
    """What a solution with that mistake finds in an image made for it, and what the mistake is, in a sentence."""
    if name not in mistakes.TABLE:
        raise ValueError(f'{name!r} is no known mistake; there are {", ".join(mistakes.TABLE)}')
    for way in mistakes.TABLE[name]:
        sentence = ' '.join((way.__doc__ or '').split())
        for question in questions():
            if question.decides or findings.expected(question, way) == findings.expected(question):
                continue
            for probe in question.probes:
                found, right = (detector(**probe.parameters).detect(probe.scene.image, probe.scene.mask)
                                for detector in (way, Reference))
                if probe.scene.sites_of(found) != probe.scene.sites_of(right):
                    return pictures.draw(probe.scene.image, found, right, sentence), sentence
            return _as_drawn(probe, found, right), sentence   # angles, sizes or octaves differ
    raise ValueError(f'{name!r} shows in none of the images')


FIXED: dict[str, Callable[[], np.ndarray]] = {each.__name__: each for each in (gradients, products, response)}


def _gradients() -> tuple[np.ndarray, np.ndarray]:
    image = photograph().astype(np.float64)
    return (cv2.Sobel(image, cv2.CV_64F, 1, 0, ksize=3, borderType=BORDER),
            cv2.Sobel(image, cv2.CV_64F, 0, 1, ksize=3, borderType=BORDER))


def _signed(values: np.ndarray) -> np.ndarray:
    """0 as middle grey; the hundredth part of the pixels that is farthest from it saturates."""
    scale = max(float(np.percentile(np.abs(values), 99)), 1e-12)
    return np.clip(np.rint(128 + 127 * values / scale), 0, 255).astype(np.uint8)


def _as_drawn(probe: Probe, found: np.ndarray, right: np.ndarray) -> np.ndarray:
    """What was found beside what was expected, drawn with angle, size and octave, enlarged."""
    panels = []
    for points, text in ((found, 'found'), (right, 'expected')):
        large = cv2.resize(probe.scene.image // 2, None, fx=4, fy=4, interpolation=cv2.INTER_NEAREST)
        points = points.copy()
        points['x'], points['y'] = points['x'] * 4 + 1.5, points['y'] * 4 + 1.5
        points['size'] *= 4 if len(np.unique(points['octave'])) > 1 or len(np.unique(points['size'])) > 1 else 24
        panels.append((draw_key_points(large, points), text))
    return _side_by_side(panels)


def _side_by_side(panels: Sequence[tuple[np.ndarray, str]]) -> np.ndarray:
    """Pictures under their captions, in rows."""
    tiles = []
    for picture, text in panels:
        height = round(picture.shape[0] * _PANEL / picture.shape[1])
        large = cv2.resize(picture, (_PANEL, height), interpolation=cv2.INTER_AREA if picture.shape[1] > _PANEL
                           else cv2.INTER_CUBIC)
        lines = textwrap.wrap(text, _PANEL // 8)
        head = np.full((_CAPTION * len(lines), _PANEL, 3), _PAPER, np.uint8)
        for number, line in enumerate(lines):
            cv2.putText(head, line, (6, _CAPTION * number + 18), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
        tiles.append(np.vstack((head, cv2.cvtColor(large, cv2.COLOR_GRAY2BGR) if large.ndim == 2 else large)))
    tallest = max(tile.shape[0] for tile in tiles)
    tiles = [cv2.copyMakeBorder(tile, 0, tallest - tile.shape[0], 0, 4, cv2.BORDER_CONSTANT, value=_PAPER)
             for tile in tiles]
    blank = np.full_like(tiles[0], 40)
    tiles += [blank] * (-len(tiles) % _IN_A_ROW)
    return np.vstack([np.hstack(tiles[start:start + _IN_A_ROW]) for start in range(0, len(tiles), _IN_A_ROW)])
