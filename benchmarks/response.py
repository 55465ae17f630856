"""The Harris response against cv2.cornerHarris and skimage's corner_harris; box and Gaussian, sizes and windows."""

from __future__ import annotations

import cv2
import numpy as np

from benchmarks import images
from benchmarks.harness import SIZES, Report, in_turn
from rvc_features.response import harris_response

_REACH = {('box', '1080p'): {3: 0.25, 7: 0.30, 15: 0.40, 31: 0.40},
          ('box', 'VGA'): {3: 0.33, 7: 0.40, 15: 0.54, 31: 0.54},
          ('gaussian', '1080p'): {3: 0.50, 7: 0.70, 15: 0.90, 31: 0.90}}


def run(quick: bool) -> Report:
    report = Report('response', 'Harris response of a grey image', x_label='pixels')
    windows = (3, 7, 15, 31) if quick else range(3, 32, 2)
    flat: dict[str, list[float]] = {}
    for size in ('VGA', '1080p') if quick else SIZES:
        image = images.picture(SIZES[size])
        for window_size in windows:
            times = in_turn({
                'cv2.cornerHarris': lambda image=image, w=window_size: cv2.cornerHarris(image, w, 3, 0.04),
                'box': lambda image=image, w=window_size: harris_response(image, w, 'box'),
                'gaussian': lambda image=image, w=window_size: harris_response(image, w, 'gaussian'),
                'gaussian, smoothed': lambda image=image, w=window_size: harris_response(image, w, 'gaussian',
                                                                                         derivative_sigma=0.7),
            }, 9 if quick or size == '4K' else 21)
            for window in ('box', 'gaussian', 'gaussian, smoothed'):
                reach = _REACH.get((window, size), {}).get(window_size)
                report.compare(f'{size} {window} {window_size}', times, window, 'cv2.cornerHarris', reach)
            for name in times:
                if window_size in (3, 31):
                    report.point(f'{name} {window_size}', image.size, times[name])
            if size == '1080p':
                flat.setdefault('box', []).append(float(np.median(times['box'])))
    _compare_skimage(report)
    report.notes.append('growth with pixels, exponent: ' + ', '.join(
        f'{name} {report.growth(name):.2f}' for name in report.curves))
    report.notes.append(f'box at 1080p, window {windows[-1]} to window {windows[0]}: '
                        f'{flat["box"][-1] / flat["box"][0]:.2f} times the cost')
    return report


def _compare_skimage(report: Report) -> None:
    try:
        from skimage.feature import corner_harris
    except ImportError:
        report.notes.append('skimage.feature.corner_harris was left out: scikit-image is not installed '
                            '(a development dependency, pip install scikit-image).')
        return
    image = images.picture(SIZES['VGA'])
    times = in_turn({'skimage': lambda: corner_harris(image, k=0.04, sigma=1.4),
                     'gaussian': lambda: harris_response(image, 7, 'gaussian')}, 5)
    report.compare('VGA gaussian, sigma 1.4', times, 'gaussian', 'skimage')
