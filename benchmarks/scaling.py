"""Where the time of `detect` goes, per megapixel, and how many camera streams one core can serve."""

from __future__ import annotations

from typing import Any, Callable

import cv2
import numpy as np

from benchmarks import images
from benchmarks.harness import SIZES, Report, in_turn
from rvc_features import filters, key_points, maxima
from rvc_features.harris_detector import HarrisDetector
from rvc_features.orientation import direction_of_scales
from rvc_features.response import response_and_maximum

_RATE = 30   # frames per second of a camera


def run(quick: bool) -> Report:
    report = Report('scaling', 'Cost of a frame and its parts; 500 key points by the sheet\'s H', x_label='pixels')
    detector = HarrisDetector(strength='harris', evenness=0.0, fixed_number_of_points=True)
    for size in ('VGA', '1080p') if quick else SIZES:
        image = images.picture(SIZES[size])
        megapixels = image.size / 1e6
        times = in_turn(_parts(detector, image), 9 if quick else 21)
        for name, seconds in times.items():
            report.point(name, image.size, seconds)
        median = {name: float(np.median(seconds)) * 1e3 for name, seconds in times.items()}
        report.notes.append(
            f'{size:>5}: {median["detect"]:6.2f} ms a frame, {median["detect"] / megapixels:5.2f} ms a megapixel, '
            f'{1000 / _RATE / median["detect"]:5.1f} streams of {_RATE} Hz on a core; of this '
            + ', '.join(f'{name} {milliseconds:.2f}' for name, milliseconds in median.items() if name != 'detect'))
    report.notes.append('growth with pixels, exponent: ' + ', '.join(
        f'{name} {report.growth(name):.2f}' for name in report.curves))
    return report


def _parts(detector: HarrisDetector, image: np.ndarray) -> dict[str, Callable[[], Any]]:
    response = np.empty(image.shape, np.float32)
    largest = response_and_maximum(image, detector.window_size, detector.window, detector.harris_k, 0.0, response)[1]
    least = max(detector.minimum_response, 0.002 * largest)   # where the detector looks first
    x, y = maxima.local_maxima(response, least)
    strength = response[y, x]
    chosen = filters.strongest(strength, 500)
    found = detector.detect_arrays(image)
    colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    return {
        'detect': lambda: detector.detect(image),
        'response': lambda: response_and_maximum(image, detector.window_size, detector.window, detector.harris_k, 0.0,
                                                 response),
        'local maxima': lambda: maxima.local_maxima(response, least),
        'strongest 500': lambda: filters.strongest(strength, 500),
        'sub-pixel': lambda: maxima.refine(response, x[chosen], y[chosen]),
        'orientation': lambda: direction_of_scales(image, found['x'], found['y'], detector.orientation_sigma),
        'KeyPoint objects': lambda: key_points.to_objects(found),
        'grey from colour (not part of it)': lambda: cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY),
    }
