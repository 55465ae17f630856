"""`detect()` with 500 key points and their angles against OpenCV's detectors."""

from __future__ import annotations

import cv2

from benchmarks import images
from benchmarks.harness import SIZES, Report, in_turn
from rvc_features.harris_detector import HarrisDetector

_REACH = {'1080p': 0.30, 'VGA': 0.45}
_OURS = {
    'default window': HarrisDetector(fixed_number_of_points=True),
    'box 3': HarrisDetector(window_size=3, window='box', fixed_number_of_points=True),
    'smoothed': HarrisDetector(derivative_sigma=0.7, fixed_number_of_points=True),
    'threshold': HarrisDetector(),
    'ANMS': HarrisDetector(anms=True),
}


def run(quick: bool) -> Report:
    report = Report('detect', '500 key points with angle, as cv2.KeyPoint objects', x_label='pixels')
    peers = {
        'GFTT-Harris': cv2.GFTTDetector_create(500, 0.01, 1, 3, True, 0.04),
        'FAST': cv2.FastFeatureDetector_create(),
        'ORB': cv2.ORB_create(500),
    }
    for size in ('VGA', '1080p') if quick else SIZES:
        for name, image in images.pictures(SIZES[size]).items():
            contestants = {key: lambda detector=detector, image=image: detector.detect(image)
                           for key, detector in {**peers, **_OURS}.items()}
            times = in_turn(contestants, 9 if quick or size == '4K' else 21)
            for ours in _OURS:
                reach = _REACH.get(size) if ours in ('default window', 'box 3') else None
                report.compare(f'{size} {name} {ours}', times, ours, 'GFTT-Harris', reach)
            for peer in ('FAST', 'ORB'):
                report.compare(f'{size} {name} default window', times, 'default window', peer)
            if name == next(iter(images.pictures(SIZES[size]))):
                for key, seconds in times.items():
                    report.point(key, image.size, seconds)
            if quick:
                break
    report.notes.append('growth with pixels, exponent: ' + ', '.join(
        f'{name} {report.growth(name):.2f}' for name in report.curves))
    report.notes.append('The number of points differs: "threshold" and FAST take all that pass theirs.')
    return report
