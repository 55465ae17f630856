"""Everything that is measured on one pair of images, as one job that any process can run."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import importlib
import inspect
import json
import os
import platform
import sys
import time
import traceback
import xml.etree.ElementTree as ElementTree
from typing import Any, Sequence

import cv2
import numpy as np

from rvc_features.comparison import contestants, measures
from rvc_features.comparison.contestants import Contestant, ContestantError
from rvc_features.comparison.correspondences import CommonRegion
from rvc_features.comparison.datasets import Pair
from rvc_features.comparison.survival import Survival
from rvc_features.heap import keep_large_blocks
from rvc_features.odometry.masks import Masks, parse

CURVE = 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0   # epsilons of the curves, in pixels
SWEEP = 100, 250, 500, 1000, 2000   # points asked for, where time is measured against points
_SWEEP_REPEATS = 7                  # times, at the least


@dataclasses.dataclass(frozen=True)
class Settings:
    """What decides the numbers of a pair besides its images; plain values only, to be sent to other processes."""

    specifications: tuple[tuple[str, str, dict[str, Any], float], ...]   # contestants.Contestant.specification
    points: int = 500
    epsilons: tuple[float, ...] = (1.5, 3.0)
    repeats: int = 3
    seed: int = 1
    concurrent: int = 1            # jobs at the same time; told beside the times, and not part of the key
    modules: tuple[str, ...] = ()  # imported first: they register the user's own detectors

    mask: str = ''                 # as masks.parse takes it

    def all_epsilons(self) -> list[float]:
        """Those of the tables and those of the curves, rising."""
        return sorted({*self.epsilons, *CURVE})

    def contestants(self) -> list[Contestant]:
        for module in self.modules:
            importlib.import_module(module)
        masks = Masks(parse(self.mask)) if self.mask else None
        return [dataclasses.replace(contestants.from_specification(*specification), masks=masks)
                for specification in self.specifications]


def key(pair: Pair, settings: Settings) -> str:
    """Name of the result of a pair: a digest of all that decides it, pixels and code included."""
    digest = hashlib.blake2b(digest_size=16)
    about = {'settings': dataclasses.asdict(dataclasses.replace(settings, concurrent=1)), 'code': code_digest(settings),
             'versions': versions(), 'with_ground_truth': pair.homography is not None, 'sweep': pair.sweep}
    digest.update(json.dumps(about, sort_keys=True).encode())
    masks = Masks(parse(settings.mask))
    used = [masks.of(image.shape) for image in (pair.first, pair.second) if image is not None]
    for array in (pair.first, pair.second, pair.homography, *used):
        if array is not None:
            digest.update(f'{array.dtype} {array.shape}'.encode())
            digest.update(array.tobytes())
    return digest.hexdigest()


def measure(pair: Pair, settings: Settings) -> dict[str, Any]:
    """All measures of all contestants on one pair, as what JSON can hold."""
    cv2.setNumThreads(1)
    keep_large_blocks()   # as the node does; otherwise times are largely those of fresh memory
    group = settings.contestants()
    pictures = [pair.first] if pair.second is None else [pair.first, pair.second]
    points, milliseconds = _detected(group, pictures, settings.repeats)

    measured = {}
    for number, contestant in enumerate(group):
        strongest = [found[number][:settings.points] for found in points]
        values = _alone(strongest, pictures)
        values['found'] = [len(found[number]) for found in points]
        values['milliseconds'] = [times[number] for times in milliseconds]
        if pair.second is not None and pair.homography is not None:
            values.update(_against_truth(strongest, pair, settings))
        elif pair.second is not None:
            values.update(_from_frame_to_frame(strongest, pair, settings))
        measured[contestant.label] = values
    if pair.sweep:
        for contestant, sweep in zip(group, _sweeps(group, pair.first, settings)):
            measured[contestant.label]['sweep'] = sweep
    return {'contestants': measured, 'epsilons': settings.all_epsilons(), 'versions': versions(),
            'machine': _machine(), 'date': time.strftime('%Y-%m-%d'), 'concurrent': settings.concurrent}


def versions() -> dict[str, str]:
    """What the numbers were made with."""
    return {'rvc_features': package_version(), 'opencv': cv2.__version__, 'numpy': np.__version__,
            'python': platform.python_version(), 'numba': _numba_version()}


@functools.lru_cache(maxsize=None)
def _numba_version() -> str:
    try:
        import numba
    except ImportError:
        return 'none'
    return numba.__version__


@functools.lru_cache(maxsize=None)
def package_version() -> str:
    """The version in package.xml, in the source tree or where catkin installs it."""
    folder = os.path.dirname(os.path.abspath(__file__))
    for _ in range(6):
        folder = os.path.dirname(folder)
        for candidate in (os.path.join(folder, 'package.xml'),
                          os.path.join(folder, 'share', 'rvc_features', 'package.xml')):
            if os.path.isfile(candidate):
                root = ElementTree.parse(candidate).getroot()
                if root.findtext('name') == 'rvc_features':
                    return root.findtext('version') or 'unknown'
    return 'unknown'


def code_digest(settings: Settings) -> str:
    """A digest of the code that decides the numbers: of the package, and of the contestants' own modules."""
    folders = _PACKAGE, os.path.join(_PACKAGE, 'kernels')
    files = {os.path.join(folder, name) for folder in folders for name in os.listdir(folder)}
    files |= {os.path.join(_PACKAGE, 'comparison', f'{name}.py') for name in _DECIDING}
    files.add(os.path.join(_PACKAGE, 'odometry', 'masks.py'))
    for contestant in settings.contestants():
        with contextlib.suppress(TypeError, OSError):   # a class without a file, made in a notebook
            files.add(inspect.getfile(type(contestant.detector)))
    return _digest_of(tuple(sorted(os.path.abspath(file) for file in files if file.endswith('.py'))))


_PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_DECIDING = 'contestants', 'correspondences', 'homographies', 'measures', 'pair_task', 'survival'   # of this room


@functools.lru_cache(maxsize=None)
def _digest_of(files: tuple[str, ...]) -> str:
    digest = hashlib.blake2b(digest_size=8)
    for path in files:
        with open(path, 'rb') as file:
            digest.update(file.read())
    return digest.hexdigest()


def _detected(group: Sequence[Contestant], pictures: Sequence[np.ndarray],
              repeats: int) -> tuple[list[list[np.ndarray]], list[list[list[float]]]]:
    """Key points and times in milliseconds of every contestant on every picture.

    A first round is not timed: it compiles, and fills the caches alike for all. Then all contestants take turns, so
    that whatever slows the machine down for a while slows all of them down.
    """
    points, milliseconds = [], []
    for image in pictures:
        points.append([_first_found(contestant, image) for contestant in group])
        times: list[list[float]] = [[] for _ in group]
        for _ in range(repeats):
            for number, contestant in enumerate(group):
                start = time.perf_counter()
                contestant.detect(image)
                times[number].append(round((time.perf_counter() - start) * 1000, 4))
        milliseconds.append(times)
    return points, milliseconds


def _first_found(contestant: Contestant, image: np.ndarray) -> np.ndarray:
    try:
        return contestant.detect(image)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        raise ContestantError(f'{contestant.label}: fails on an image of {image.shape[1]}x{image.shape[0]} pixels: '
                              f'{type(error).__name__}: {" ".join(str(error).split())} '
                              f'({where.filename}, line {where.lineno})') from error


def _sweeps(group: Sequence[Contestant], image: np.ndarray, settings: Settings) -> list[list[tuple[int, float]]]:
    """Points found and median milliseconds of each contestant, asked for ever more points; empty where it can't be."""
    sweeps: list[list[tuple[int, float]]] = [[] for _ in group]
    for count in SWEEP:
        asked = [(number, each.asked_for(count)) for number, each in enumerate(group)]
        limited = [(number, each) for number, each in asked if each is not None]
        points, milliseconds = _detected([each for _, each in limited], [image], max(settings.repeats, _SWEEP_REPEATS))
        for (number, _), found, times in zip(limited, points[0], milliseconds[0]):
            sweeps[number].append((len(found), float(np.median(times))))
    return sweeps


def _alone(strongest: Sequence[np.ndarray], pictures: Sequence[np.ndarray]) -> dict[str, Any]:
    positions = [measures.positions(points) for points in strongest]
    return {'coverage': [measures.covered_cells(points, image.shape) for points, image in zip(positions, pictures)],
            'spacing': [measures.spacing(points) for points in positions]}


def _against_truth(strongest: Sequence[np.ndarray], pair: Pair, settings: Settings) -> dict[str, Any]:
    assert pair.second is not None
    assert pair.homography is not None
    first, second = strongest
    shapes, epsilons = (pair.first.shape, pair.second.shape), settings.all_epsilons()
    region = CommonRegion(measures.positions(first), measures.positions(second), pair.homography, *shapes)
    i, j, distance = measures.found_again(region, max(settings.epsilons))
    turned = measures.orientation_errors(first['angle'][i], second['angle'][j], pair.homography,
                                         measures.positions(first)[i])
    counts = len(region.first), len(region.second)
    matches, right = measures.matching_accuracy(first[region.first], second[region.second], pair.first, pair.second,
                                                pair.homography)
    return {'in_region': list(counts),
            'repeatability': measures.repeatability(region, epsilons),
            'chance': _chance(counts, tuple(pair.homography.ravel().tolist()), *shapes, tuple(epsilons),
                              settings.seed),
            'error': float(distance.mean()) if len(distance) else None,
            'orientation_error': float(np.median(turned)) if len(turned) else None,
            'matches': matches, 'right_matches': right}


@functools.lru_cache(maxsize=64)   # most contestants have the same counts in the first image, and some in both
def _chance(counts: tuple[int, int], homography: tuple[float, ...], first_shape: tuple[int, ...],
            second_shape: tuple[int, ...], epsilons: tuple[float, ...], seed: int) -> list[float | None]:
    return measures.chance_level(counts, np.reshape(homography, (3, 3)), first_shape, second_shape, epsilons, seed)


def _from_frame_to_frame(strongest: Sequence[np.ndarray], pair: Pair, settings: Settings) -> dict[str, Any]:
    assert pair.second is not None
    survival = Survival(measures.positions(strongest[0]), measures.positions(strongest[1]),
                                 pair.first, pair.second, settings.all_epsilons())
    return {'tracked': survival.tracked, 'found_again': survival.found_again, 'motion': survival.motion}


@functools.lru_cache(maxsize=None)
def _machine() -> str:
    """The processor, for the reader of the times."""
    if sys.platform.startswith('linux'):
        try:
            with open('/proc/cpuinfo', encoding='utf-8', errors='replace') as file:
                for line in file:
                    if line.startswith('model name'):
                        return line.partition(':')[2].strip()
        except OSError:
            pass
    return platform.processor() or platform.machine() or 'unknown processor'
