"""Detectors as nobody should write them: one that returns rubbish, leaves or hangs, as its parameter says."""

import sys
import threading
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rvc_features import detectors, key_points
from rvc_features.feature_detector import FeatureDetector
from rvc_features.parameters import Choice, parameter

HANGS = 4.0   # seconds
GATE = threading.Event()   # nobody opens it

RUBBISH = {
    'none': lambda shape: None,
    'dtype': lambda shape: np.zeros(5, np.dtype([('x', np.float64), ('response', np.float64)])),
    'shape': lambda shape: key_points.empty(6).reshape(2, 3),
    'nan': lambda shape: one_at(np.nan, 5),
    'outside': lambda shape: one_at(3 * shape[1], 5),
    'no size': lambda shape: one_at(5, 5, size=np.nan),
    'exit': lambda shape: sys.exit('enough'),
    'raise': lambda shape: 1 // 0,
    'hang': lambda shape: threading.Event().wait(HANGS) or key_points.empty(),
    'hang for ever': lambda shape: GATE.wait() or key_points.empty(),
    'huge': lambda shape: one_at(50, 50, size=1e6),
}


def one_at(x, y, size=5.0):
    found = key_points.empty(1)
    found['x'], found['y'], found['size'] = x, y, size
    return found


@detectors.register
@dataclass(frozen=True)
class FaultyDetector(FeatureDetector):
    """Whatever it is told to do wrong."""

    name: ClassVar[str] = 'faulty'

    kind: str = parameter('none', Choice('What it does.', tuple(RUBBISH)))

    def detect_impl(self, image, mask):
        return RUBBISH[self.kind](image.shape)
