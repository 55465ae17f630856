"""`detect()` with 500 key points and their angles against OpenCV's detectors."""

from __future__ import annotations

from typing import Any, Callable

import cv2
import numpy as np

from benchmarks import images
from benchmarks.harness import SIZES, Report, in_turn
from rvc_features import presets

_REACH = {'1080p': 0.30, 'VGA': 0.45}
_OURS = {
    'course, box 3': presets.create('course', 500, window_size=3),
    'course': presets.create('course', 500),
    'repeatable': presets.create('repeatable', 500),
    'even': presets.create('even', 500),
}


def run(quick: bool) -> Report:
    report = Report('detect', '500 key points with angle, as cv2.KeyPoint objects', x_label='pixels')
    peers = {
        'GFTT-Harris': cv2.GFTTDetector_create(500, 0.01, 1, 3, True, 0.04),
        'FAST': cv2.FastFeatureDetector_create(20),
        'ORB': cv2.ORB_create(500),
    }
    fast_of_kornia = _fast_of_kornia()
    for size in ('VGA', '1080p') if quick else SIZES:
        pictures = images.pictures(SIZES[size])
        for name, image in pictures.items():
            is_first = name == next(iter(pictures))
            contestants = {'FAST': lambda image=image: peers['FAST'].detect(image),
                           'course, arrays': lambda image=image: _OURS['course, box 3'].detect_arrays(image)}
            if fast_of_kornia is not None:
                contestants['FAST of kornia_rs'] = lambda image=image: fast_of_kornia(image, 20.0)
            if is_first or not quick:
                contestants.update({key: lambda detector=detector, image=image: detector.detect(image)
                                    for key, detector in {**peers, **_OURS}.items()})
            times = in_turn(contestants, 9 if quick or size == '4K' else 21)
            fastest = min((peer for peer in times if 'FAST' in peer), key=lambda peer: float(np.median(times[peer])))
            times['fastest FAST'] = times[fastest]
            report.compare(f'{size} {name} course, box 3, arrays ({fastest} is the fastest)', times, 'course, arrays',
                           'fastest FAST', 1.0)
            if is_first or not quick:
                for ours in _OURS:
                    reach = _REACH.get(size) if ours.startswith('course') else None
                    report.compare(f'{size} {name} {ours}', times, ours, 'GFTT-Harris', reach)
                for peer in ('FAST', 'ORB'):
                    report.compare(f'{size} {name} course, box 3', times, 'course, box 3', peer)
            if is_first:
                for key, seconds in times.items():
                    report.point(key, image.size, seconds)
    report.notes.append('growth with pixels, exponent: ' + ', '.join(
        f'{name} {report.growth(name):.2f}' for name in report.curves))
    report.notes.append('FAST takes all points that pass its threshold, some thousand, and has no direction for them.')
    return report


def _fast_of_kornia() -> Callable[..., Any] | None:
    try:
        from kornia_rs import features
    except ImportError:
        return None
    return features.fast_detect
