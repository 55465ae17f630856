"""The Harris response against cv2.cornerHarris and skimage's corner_harris; box and Gaussian, sizes and windows."""

from __future__ import annotations

import cv2
import numpy as np

from benchmarks import halide_harris, images
from benchmarks.harness import SIZES, Report, deviation, in_turn
from rvc_features.response import harris_response, reference_response

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
            for window, sigma in (('box', 0.0), ('gaussian', 0.0), ('gaussian, smoothed', 0.7)):
                reach = _REACH.get((window, size), {}).get(window_size)
                kind = window.split(',')[0]
                off = None if size == '4K' else deviation(
                    harris_response(image, window_size, kind, derivative_sigma=sigma),
                    reference_response(image, window_size, kind, 0.04, sigma))
                report.compare(f'{size} {window} {window_size}', times, window, 'cv2.cornerHarris', reach, off)
            for name in times:
                if window_size in (3, 31):
                    report.point(f'{name} {window_size}', image.size, times[name])
            if size == '1080p':
                flat.setdefault('box', []).append(float(np.median(times['box'])))
        if size in ('VGA', '1080p'):
            _compare_halide(report, size, image, 15 if quick else 31)
    _compare_skimage(report)
    report.notes.append('growth with pixels, exponent: ' + ', '.join(
        f'{name} {report.growth(name):.2f}' for name in report.curves))
    report.notes.append(f'box at 1080p, window {windows[-1]} to window {windows[0]}: '
                        f'{flat["box"][-1] / flat["box"][0]:.2f} times the cost')
    return report


def _compare_halide(report: Report, size: str, image: np.ndarray, rounds: int) -> None:
    """As a user calls ours, with memory of its own for each map; Halide writes into memory that is there.

    Ours and the best variant of Halide are timed by turns, and no third: in turn with all twelve variants, which write
    into the same memory, Halide finds it in the caches and ours does not.
    Beside them the least that can be done: to read and to write.
    """
    try:
        halide = halide_harris.variants()
    except ImportError:
        report.notes.append('Halide was left out: it is not installed (pip install halide).')
        return
    out = np.empty(image.shape, np.float32)
    variants = in_turn({name: lambda function=function: function(image, out) for name, function in halide.items()},
                       rounds)
    best = min(halide, key=lambda name: float(np.median(variants[name])))
    ours = {f'{window} {size}': lambda w=size, kind=window: harris_response(image, w, kind)
            for window, size in (('box', 3), ('box', 31), ('gaussian', 7))}
    times = in_turn({'copy': lambda: np.copyto(out, image), **ours}, rounds)
    against = in_turn({'box 3': ours['box 3'], 'Halide': lambda: halide[best](image, out)}, rounds)
    off = deviation(harris_response(image, 3, 'box'), reference_response(image, 3, 'box', 0.04, 0.0))
    report.compare(f'{size} box 3, against Halide', against, 'box 3', 'Halide', 0.50, off)
    report.compare(f'{size} box 31, against our box 3', times, 'box 31', 'box 3', 1.25)
    report.notes.append(f'{size}, nanoseconds per pixel: ' + ', '.join(
        f'{name} {float(np.median(seconds)) / image.size * 1e9:.2f}'
        for name, seconds in {**times, 'Halide': against['Halide']}.items()) + f' (the best of its variants: {best})')


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
