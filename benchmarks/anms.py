"""Exact adaptive non-maximal suppression against brute force and square covering, in Python and compiled."""

from __future__ import annotations

from typing import Callable

import numpy as np

from benchmarks import images
from benchmarks.baselines import brute_force, square_covering
from benchmarks.harness import SIZES, Report, in_turn
from rvc_features.filters import adaptive_non_maximal_suppression
from rvc_features.maxima import local_maxima
from rvc_features.response import harris_response

_REACH = {20_000: 0.8, 100_000: 0.5}   # of SSC in Python; compiled: 1
_WIDTH, _HEIGHT = SIZES['4K']
_CHOSEN = 500


def run(quick: bool) -> Report:
    report = Report('anms', f'Adaptive non-maximal suppression, {_CHOSEN} points out of N', x_label='candidates')
    counts = (1_000, 5_000, 20_000, 100_000) if quick else (1_000, 5_000, 20_000, 50_000, 100_000, 200_000, 400_000)
    compiled = _compiled_square_covering()
    for kind, candidates in (('uniform', _uniform), ('real', _real), ('clusters', _clusters)):
        for count in counts:
            points, responses = candidates(count)
            if len(points) < count:
                continue
            contestants = {
                'ours': lambda p=points, r=responses: adaptive_non_maximal_suppression(p, r, _CHOSEN),
                'ours, all radii': lambda p=points, r=responses: adaptive_non_maximal_suppression(p, r, len(p)),
                'SSC': lambda p=points, r=responses: square_covering(p, r, _CHOSEN, _WIDTH, _HEIGHT),
            }
            if compiled is not None:
                contestants['SSC, compiled'] = lambda p=points, r=responses: compiled(p, r, _WIDTH, _HEIGHT, _CHOSEN,
                                                                                      True)
            if count <= (1_000 if quick else 5_000):
                contestants['brute force'] = lambda p=points, r=responses: brute_force(p, r, _CHOSEN)
            times = in_turn(contestants, 5 if quick or count > 100_000 else 9)
            report.compare(f'{count} {kind}', times, 'ours', 'SSC', _REACH.get(count))
            if compiled is not None:
                report.compare(f'{count} {kind}', times, 'ours', 'SSC, compiled', 1.0)
            report.compare(f'{count} {kind}, all radii', times, 'ours, all radii', 'SSC')
            if 'brute force' in times:
                report.compare(f'{count} {kind}', times, 'ours', 'brute force')
            for name, seconds in times.items():
                report.point(f'{name}, {kind}', count, seconds)
    for name in ('ours', 'ours, all radii'):
        report.notes.append(f'growth of {name} from 5k to 100k, exponent (reach 1.25): ' + ', '.join(
            f'{kind} {report.growth(f"{name}, {kind}", 5_000, 100_000):.2f}' for kind in ('uniform', 'real', 'clusters')
            if f'{name}, {kind}' in report.curves))
    report.notes.append('SSC gives about as many points, spread alike, but not those of the definition; ours does. '
                        '"All radii": every radius is wanted, so no search can end early.')
    return report


def _compiled_square_covering() -> Callable[..., np.ndarray] | None:
    try:
        from adaptivenms import square_covering_adaptive_nms
    except ImportError:
        return None
    return square_covering_adaptive_nms


def _uniform(count: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(count)
    return random.uniform((0, 0), (_WIDTH, _HEIGHT), (count, 2)), random.exponential(100, count)


def _clusters(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Twenty clusters from 1 to 100 pixels wide."""
    random = np.random.default_rng(count)
    centres = random.uniform((0, 0), (_WIDTH, _HEIGHT), (20, 2))
    which = random.integers(0, 20, count)
    points = random.normal(centres[which], np.geomspace(1, 100, 20)[which][:, None])
    return np.clip(points, 0, (_WIDTH - 1, _HEIGHT - 1)), random.exponential(100, count)


def _real(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Local maxima of the response of a picture, with a little noise for there to be enough of them."""
    image = images.picture((_WIDTH, _HEIGHT))
    noise = np.random.default_rng(0).normal(0, 3, image.shape)
    response = harris_response(np.clip(image + noise, 0, 255).astype(np.uint8), 3)
    x, y = local_maxima(response, 0)
    strongest = np.sort(np.argsort(-response[y, x])[:count])
    x, y = x[strongest], y[strongest]
    return np.column_stack((x, y)).astype(float), response[y, x].astype(float)
