"""What every detector keeps to, as checks that run on any of them, also on your own.

    python3 -m rvc_features.conformance my_package.my_detector

imports the modules named and checks every detector that is registered then; in a test of your own:

    conformance.check(detectors.create('mine'))
"""

from __future__ import annotations

import argparse
import importlib
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Callable

import cv2
import numpy as np

from rvc_features import detectors, key_points
from rvc_features.feature_detector import FeatureDetector

Check = Callable[[FeatureDetector], None]


def check(detector: FeatureDetector) -> None:
    """Run every check on a detector.

    Raises
    ------
    AssertionError
        With a line for each check that failed: which, and what was seen.
    """
    problems = []
    for one in CHECKS:
        try:
            one(detector)
        except Exception as error:   # whatever a detector that is not ours raises is a finding, and the next check runs
            problems.append(f'{name_of(one)}: {error if isinstance(error, AssertionError) else repr(error)}')
    if problems:
        raise AssertionError(f'{detector!r} does not keep to the interface:\n  ' + '\n  '.join(problems))


def name_of(one: Check) -> str:
    """A check's name in words."""
    return one.__name__.lstrip('_').replace('_', ' ')


def _types_and_bounds(detector: FeatureDetector) -> None:
    for image in (TEXTURE, cv2.cvtColor(TEXTURE, cv2.COLOR_GRAY2BGR)):
        points = _detect(detector, image)
        _require(len(points) > 0, 'no point at all on an image full of texture')


def _strongest_first(detector: FeatureDetector) -> None:
    responses = _detect(detector, TEXTURE)['response']
    _require(bool((np.diff(responses) <= 0).all()), 'responses rise from one point to the next')


def _objects_equal_arrays(detector: FeatureDetector) -> None:
    objects = detector.detect(TEXTURE)
    _require(all(isinstance(point, cv2.KeyPoint) for point in objects), 'detect gives something else than cv2.KeyPoint')
    _require(np.array_equal(key_points.from_objects(objects), _detect(detector, TEXTURE)),
             'detect and detect_arrays give different points')


def _mask_is_obeyed(detector: FeatureDetector) -> None:
    mask = np.zeros(TEXTURE.shape, np.uint8)
    mask[40:200, 60:260] = 255
    points = _detect(detector, TEXTURE, mask)
    inside = mask[np.rint(points['y']).astype(int), np.rint(points['x']).astype(int)] != 0
    _require(bool(inside.all()), f'{int((~inside).sum())} points lie where the mask is 0')
    for other in (mask.astype(bool), (mask != 0).astype(np.uint8)):
        _require(np.array_equal(_detect(detector, TEXTURE, other), points),
                 f'a mask of {other.dtype} with values up to {other.max()} gives other points than one of 0 and 255')
    _require(len(_detect(detector, TEXTURE, np.zeros_like(mask))) == 0, 'points in spite of a mask that allows none')
    mask[:] = 255
    _require(len(_detect(detector, TEXTURE, mask)) > 0, 'no points with a mask that allows everything')


def _tiny_and_narrow_images(detector: FeatureDetector) -> None:
    for shape in ((1, 1), (1, 200), (200, 1), (2, 3), (7, 7), (16, 15), (4, 300), (300, 4)):
        _detect(detector, np.random.RandomState(0).randint(0, 256, shape).astype(np.uint8))


def _flat_images_have_no_points(detector: FeatureDetector) -> None:
    for value in (0, 128, 255):
        points = _detect(detector, np.full((120, 160), value, np.uint8))
        _require(len(points) == 0, f'{len(points)} points on a flat image of {value}')


def _images_are_left_as_they_are(detector: FeatureDetector) -> None:
    image, mask = TEXTURE.copy(), np.full(TEXTURE.shape, 255, np.uint8)
    _detect(detector, image, mask)
    _require(np.array_equal(image, TEXTURE), 'the image was changed')
    _require(bool((mask == 255).all()), 'the mask was changed')


def _read_only_and_strided_views(detector: FeatureDetector) -> None:
    expected = _detect(detector, TEXTURE)
    fixed = TEXTURE.copy()
    fixed.flags.writeable = False
    strided = np.repeat(TEXTURE, 2, axis=1)[:, ::2]
    flipped = TEXTURE[::-1].copy()[::-1]
    for name, view in (('read-only', fixed), ('strided', strided), ('bottom-up', flipped)):
        _require(np.array_equal(_detect(detector, view), expected), f'a {name} view gives other points than the image')


def _same_image_same_points(detector: FeatureDetector) -> None:
    first = _detect(detector, TEXTURE)
    _detect(detector, TEXTURE[:100, :150])
    _require(np.array_equal(_detect(detector, TEXTURE), first), 'the second time other points are found')


def _several_threads_at_once(detector: FeatureDetector) -> None:
    images = [TEXTURE, TEXTURE[:, ::-1].copy(), TEXTURE[20:, 30:].copy()]
    expected = [_detect(detector, image) for image in images]
    with ThreadPoolExecutor(3) as threads:
        found = list(threads.map(lambda which: _detect(detector, images[which % 3]), range(12)))
    _require(all(np.array_equal(points, expected[which % 3]) for which, points in enumerate(found)),
             'threads that detect at the same time get other points than one alone')


def _response_map_fits_the_image(detector: FeatureDetector) -> None:
    response = detector.response_map(TEXTURE)
    if response is not None:
        _require(isinstance(response, np.ndarray) and response.dtype == np.float32 and response.shape == TEXTURE.shape,
                 'response_map must be None or float32 of the image\'s shape; '
                 f'got {getattr(response, "dtype", type(response).__name__)} {getattr(response, "shape", "")}')


def _bad_arguments_are_refused(detector: FeatureDetector) -> None:
    for image, mask in ((None, None), (TEXTURE.astype(np.float64), None), (TEXTURE[0], None), (TEXTURE[:0], None),
                        (TEXTURE, np.zeros((3, 3), np.uint8)), (TEXTURE, 'all')):
        try:
            detector.detect(image, mask)   # type: ignore[arg-type]
        except (TypeError, ValueError):
            continue
        raise AssertionError(f'took {type(image).__name__} as image and {type(mask).__name__} as mask')


CHECKS: tuple[Check, ...] = (
    _types_and_bounds, _strongest_first, _objects_equal_arrays, _mask_is_obeyed, _tiny_and_narrow_images,
    _flat_images_have_no_points, _images_are_left_as_they_are, _read_only_and_strided_views, _same_image_same_points,
    _several_threads_at_once, _response_map_fits_the_image, _bad_arguments_are_refused)


def _texture() -> np.ndarray:
    """Smooth random grey values with a few sharp shapes on them: something for every detector."""
    noise = cv2.GaussianBlur(np.random.RandomState(0).normal(size=(240, 320)), (0, 0), 2)
    image = np.interp(noise, (noise.min(), noise.max()), (40, 215)).astype(np.uint8)
    for x, y in ((60, 60), (200, 80), (120, 160), (250, 190)):
        image[y:y + 24, x:x + 30] = 255 - image[y:y + 24, x:x + 30]
    return image


TEXTURE = _texture()


def _detect(detector: FeatureDetector, image: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Points of an image, whatever it is, with what must hold for each beyond what `detect_arrays` checks itself."""
    points = detector.detect_arrays(image, mask)
    height, width = image.shape[:2]
    for name, length in (('x', width), ('y', height)):
        _require(bool(((points[name] >= 0) & (points[name] <= length - 1)).all()),
                 f'{name} lies outside the image of {width} x {height}')
    _require(bool((points['size'] > 0).all()), 'size must be positive')
    _require(bool((points['octave'] >= 0).all()), 'octave must be 0 or more')
    angle = points['angle']
    _require(bool(((angle == -1) | ((angle >= 0) & (angle < 360))).all()), 'angle must lie in [0, 360), or be -1')
    return points


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise AssertionError(otherwise)


def main() -> int:
    """Check every registered detector with its defaults; the exit status."""
    parser = argparse.ArgumentParser(prog='python3 -m rvc_features.conformance', description=__doc__.partition('\n')[0])
    parser.add_argument('modules', nargs='*', help='Python modules that register detectors of their own')
    for module in parser.parse_args().modules:
        importlib.import_module(module)
    status = 0
    for name in detectors.names():
        try:
            check(detectors.create(name))
        except AssertionError as error:
            status = 1
            print(error)
        else:
            print(f'{name}: {len(CHECKS)} checks passed')
    return status


if __name__ == '__main__':
    sys.exit(main())
