"""A picture for each finding: what was found, and what was expected."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import cv2
import numpy as np

from rvc_features.exercise.examination import Check

_ZOOM = 4
_SEEN, _EXPECTED, _INK = (0, 140, 255), (255, 190, 60), (235, 235, 235)      # BGR: orange, light blue
_LINE = 16       # pixels


def write(check: Check, folder: Path) -> Path | None:
    """Write the picture of a check; its path, or None where there is nothing to draw."""
    if check.probe is None or check.found is None or check.expected is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f'{re.sub("[^a-z0-9]+", "_", check.name.lower())}.png'
    if not cv2.imwrite(str(path), draw(check.probe.scene.image, check.found, check.expected, check.sentence)):
        raise OSError(f'{path} can\'t be written')
    return path


def draw(image: np.ndarray, found: np.ndarray, expected: np.ndarray, sentence: str) -> np.ndarray:
    """The image enlarged, with crosses where points were found, and circles where they were expected."""
    large = cv2.resize(image, None, fx=_ZOOM, fy=_ZOOM, interpolation=cv2.INTER_NEAREST)
    picture = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR) if large.ndim == 2 else large
    for points, colour, radius in ((expected, _EXPECTED, 10), (found, _SEEN, 0)):
        for x, y in zip(points['x'].tolist(), points['y'].tolist()):
            at = tuple(round(min(max((value + 0.5) * _ZOOM, -1e4), 1e4)) for value in (x, y))
            if radius:
                cv2.circle(picture, at, radius, colour, 2, cv2.LINE_AA)
            else:
                cv2.drawMarker(picture, at, colour, cv2.MARKER_TILTED_CROSS, 9, 2)
    lines = ['orange crosses: found; blue circles: expected',
             *textwrap.wrap(sentence, max(20, picture.shape[1] // 7))]
    foot = np.full((_LINE * (len(lines) + 1), picture.shape[1], 3), 40, np.uint8)
    for number, line in enumerate(lines, 1):
        cv2.putText(foot, line, (6, _LINE * number), cv2.FONT_HERSHEY_SIMPLEX, 0.4, _INK, 1, cv2.LINE_AA)
    return np.vstack((picture, foot))
