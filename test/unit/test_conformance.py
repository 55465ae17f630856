"""Every registered detector keeps to the interface, with its defaults and with what else it can be set to."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from rvc_features import conformance, detectors, key_points
from rvc_features.feature_detector import FeatureDetector

SETTINGS = [(name, {}) for name in detectors.names()] + [
    ('harris', {'fixed_number_of_points': True, 'octaves': 4, 'number_of_points': 80}),
    ('harris', {'anms': True, 'octaves': 3, 'anms_points': 60}),
    ('harris', {'strength': 'harris', 'evenness': 0.0, 'octaves': 3, 'fixed_number_of_points': True}),
    ('harris', {'strength': 'harris', 'window': 'box', 'window_size': 31, 'subpixel': False}),
    ('harris', {'strength': 'harris', 'local_maxima': False, 'derivative_sigma': 1.5}),
    ('good_features_to_track', {'use_harris': True, 'minimum_distance': 9.0}),
]


@pytest.mark.parametrize('one', conformance.CHECKS, ids=conformance.name_of)
@pytest.mark.parametrize(('name', 'values'), SETTINGS, ids=lambda value: str(value))
def test_detectors_keep_to_the_interface(name, values, one):
    one(detectors.create(name, **values))


@dataclasses.dataclass(frozen=True)
class Wrong(FeatureDetector):
    """A detector with one fault, that the test sets."""

    name: ClassVar[str] = 'wrong'
    fault: str = 'none'

    def detect_impl(self, image, mask):
        if self.fault == 'raises' and min(image.shape) < 5:
            raise ZeroDivisionError('small')
        found = key_points.empty(0 if image.max() == image.min() or (mask is not None and not mask.any()) else 3)
        allowed = np.argwhere(np.ones(image.shape) if mask is None or self.fault == 'mask' else mask)[:len(found)]
        found = found[:len(allowed)]
        found['y'], found['x'] = allowed.T
        found['size'], found['response'] = 5, np.arange(len(found))
        if self.fault == 'outside':
            found['x'] = image.shape[1]
        if self.fault == 'nan':
            found['y'] = np.nan
        if self.fault == 'draws' and image.flags.writeable:
            image[0, 0] += 1
        if self.fault == 'random':
            found['angle'] = np.random.default_rng().integers(0, 360)
        return found.astype([(name, float) for name in key_points.NAMES]) if self.fault == 'type' else found


@pytest.mark.parametrize(('fault', 'text'), [
    ('raises', r"tiny and narrow images: ZeroDivisionError\('small'\)"),
    ('mask', 'mask is obeyed: . points lie where the mask is 0'),
    ('outside', 'x lies outside the image of 320 x 240|at x = 320'),
    ('nan', 'a key point whose y is not finite'),
    ('draws', 'images are left as they are: the image was changed'),
    ('random', 'same image same points: the second time other points are found'),
    ('type', 'must return an array of key_points.DTYPE, one-dimensional; got'),
])
def test_a_detector_that_does_not_is_told_why(fault, text):
    conformance.check(Wrong())
    with pytest.raises(AssertionError, match=text):
        conformance.check(Wrong(fault))


def test_from_the_command_line_with_a_module_of_ones_own(tmp_path):
    source = Path(conformance.__file__).parents[1]
    tests = Path(__file__).parents[1]
    result = subprocess.run([sys.executable, '-m', 'rvc_features.conformance', 'own_detector'], capture_output=True,
                            text=True, check=False, cwd=tmp_path,
                            env={**os.environ, 'PYTHONPATH': f'{source}:{tests}'})
    assert result.returncode == 0, result.stdout + result.stderr
    for name in (*detectors.names(), 'centre'):
        assert f'{name}: {len(conformance.CHECKS)} checks passed' in result.stdout
