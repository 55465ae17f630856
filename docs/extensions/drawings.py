"""The pictures of the course's pages, each made by the code that the page is about."""

from __future__ import annotations

from typing import Callable, Sequence

import cv2
import numpy as np

from rvc_features import presets
from rvc_features.comparison import contestants, warps
from rvc_features.comparison.datasets import Pair
from rvc_features.comparison.pictures import Picture, mosaic, of_pair, with_legend
from rvc_features.drawing import displayable_response, draw_key_points
from rvc_features.exercise import findings, mistakes, pictures
from rvc_features.exercise.questions import Probe, questions
from rvc_features.exercise.reference import Reference
from rvc_features.exercise.scenes import directions
from rvc_features.recordings.image_sources import read_image
from rvc_features.response import BORDER, window_average

_WIDTH = 400            # pixels: of one picture out of several
_IN_A_ROW = 2


def photograph(scale: float = 0.5) -> np.ndarray:
    """A chessboard held before a camera, uint8 (480, 640) times scale; without opencv-doc a drawn picture."""
    path = warps.opencv_example('left01.jpg')
    image = read_image(path, grey=True) if path else warps.generated_photograph()
    return cv2.resize(image, (round(640 * scale), round(480 * scale)), interpolation=cv2.INTER_AREA)


def gradients() -> np.ndarray:
    """I_x and I_y."""
    i_x, i_y = _gradients()
    return _mosaic([('I_x', 'white: from dark to light, seen from left to right', _signed(i_x)),
                    ('I_y', 'the same from top to bottom', _signed(i_y))])


def products() -> np.ndarray:
    """A, B and C, before and after the window."""
    i_x, i_y = _gradients()
    panels = []
    for name, product in (('A: I_x I_x', i_x * i_x), ('B: I_x I_y', i_x * i_y), ('C: I_y I_y', i_y * i_y)):
        panels += [(name, 'pixel by pixel', _signed(product)),
                   (name, 'averaged over 7x7', _signed(window_average(product, 7, 'box')))]
    return _mosaic(panels)


def response() -> np.ndarray:
    """H, beside the image."""
    image = photograph()
    detector = contestants.parse('course:window_size=5', 0).detector
    strength = detector.response_map(image)
    assert strength is not None
    return _mosaic([('the image', '', image),
                    ('H', 'corners white, edges black, flat grey', displayable_response(strength))])


def orientation() -> np.ndarray:
    """The direction of the gradient at each corner in an image with noise, with a small kernel and a large one."""
    scene = directions().image
    noise = np.random.default_rng(1).normal(20, 12, scene.shape)
    image = np.clip(scene * 0.6 + noise, 0, 255).astype(np.uint8)
    panels = []
    for sigma in (0.5, 2.5):
        points = presets.create('course', 8, orientation_sigma=sigma).detect_arrays(image)
        panels.append((f'orientation_sigma {sigma}', '', _enlarged(image, points, 24)))
    return _mosaic(panels)


def comparison() -> np.ndarray:
    """Which of the 100 strongest points of each detector are found again when the photograph is turned."""
    image = photograph(1.0)
    turned, homography = warps.warped(image, 'rotation', 30)
    pair = Pair('rotation', '30 degrees', 30, warps.reference(image), turned, homography)
    detectors = [contestants.parse(name, 100) for name in ('course', 'repeatable', 'good_features_to_track', 'orb')]
    return with_legend(mosaic(of_pair(pair, detectors, 100, 1.5, _WIDTH), _IN_A_ROW), pair, 1.5)


def sliders(texts: Sequence[str]) -> np.ndarray:
    """What detectors find, each written as on the command line of compare_detectors, with its number of points."""
    image, panels = photograph(), []
    for text in texts:
        points = contestants.parse(text, 0).detect(image)
        panels.append((text, f'{len(points)} points', draw_key_points(image, points)))
    return _mosaic(panels)


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


FIXED: dict[str, Callable[[], np.ndarray]] = {
    each.__name__: each for each in (gradients, products, response, orientation, comparison)}


def _gradients() -> tuple[np.ndarray, np.ndarray]:
    image = photograph().astype(np.float64)
    return (cv2.Sobel(image, cv2.CV_64F, 1, 0, ksize=3, borderType=BORDER),
            cv2.Sobel(image, cv2.CV_64F, 0, 1, ksize=3, borderType=BORDER))


def _signed(values: np.ndarray) -> np.ndarray:
    """0 as middle grey; the hundredth part of the pixels that is farthest from it saturates."""
    scale = max(float(np.percentile(np.abs(values), 99)), 1e-12)
    return np.clip(np.rint(128 + 127 * values / scale), 0, 255).astype(np.uint8)


def _as_drawn(probe: Probe, found: np.ndarray, right: np.ndarray) -> np.ndarray:
    """What was found beside what was expected, drawn with angle, size and octave."""
    as_large = 4 if len(np.unique(found['size'])) > 1 or len(np.unique(right['octave'])) > 1 else 24
    return _mosaic([('found', '', _enlarged(probe.scene.image, found, as_large)),
                    ('expected', '', _enlarged(probe.scene.image, right, as_large))])


def _enlarged(image: np.ndarray, points: np.ndarray, as_large: int) -> np.ndarray:
    """Key points on the darkened image, four times as large; their circles so many times."""
    points = points.copy()
    points['x'], points['y'] = points['x'] * 4 + 1.5, points['y'] * 4 + 1.5
    points['size'] *= as_large
    return draw_key_points(cv2.resize(image // 2, None, fx=4, fy=4, interpolation=cv2.INTER_NEAREST), points)


def _mosaic(panels: Sequence[tuple[str, str, np.ndarray]]) -> np.ndarray:
    """Pictures of any size, grey or BGR, under a label and a caption."""
    tiles = []
    for label, caption, image in panels:
        size = _WIDTH, round(image.shape[0] * _WIDTH / image.shape[1])
        scaled = cv2.resize(image, size, interpolation=cv2.INTER_AREA if image.shape[1] > _WIDTH else cv2.INTER_CUBIC)
        tiles.append(Picture(label, caption, cv2.cvtColor(scaled, cv2.COLOR_GRAY2BGR) if scaled.ndim == 2 else scaled))
    return mosaic(tiles, _IN_A_ROW)
