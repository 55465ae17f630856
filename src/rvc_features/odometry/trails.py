"""Tracks as pictures: the way that each point has come lately."""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np

_COLOUR = (60, 200, 255)   # BGR, of the newest piece; older ones fade
_FAINTEST = 0.25


class Trails:
    """Remembers where tracks were in the last frames, and draws it.

    Parameters
    ----------
    length : int
        Frames that a trail goes back.
    """

    def __init__(self, length: int = 20) -> None:
        self._frames: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=length + 1)

    def add(self, tracks: np.ndarray) -> None:
        """The tracks of the next frame, an array of tracks.DTYPE."""
        order = np.argsort(tracks['id'])
        positions = np.column_stack((tracks['x'], tracks['y']))[order]
        self._frames.append((tracks['id'][order], np.rint(positions * 16).astype(np.int32)))

    def clear(self) -> None:
        self._frames.clear()

    def draw(self, picture: np.ndarray) -> np.ndarray:
        """Draw the trails of the tracks that are alive in place; the picture, uint8 (H, W, 3) BGR, is returned."""
        if not self._frames:
            return picture
        alive = self._frames[-1][0]
        frames = list(self._frames)
        for number, ((ids, start), (next_ids, end)) in enumerate(zip(frames, frames[1:]), 1):
            both = np.intersect1d(ids, np.intersect1d(next_ids, alive, assume_unique=True), assume_unique=True)
            pieces = np.stack((start[np.searchsorted(ids, both)], end[np.searchsorted(next_ids, both)]), axis=1)
            strength = _FAINTEST + (1 - _FAINTEST) * number / max(len(frames) - 1, 1)
            cv2.polylines(picture, list(pieces), False, [strength * channel for channel in _COLOUR], 1, cv2.LINE_8, 4)
        for x, y in self._frames[-1][1].tolist():
            cv2.circle(picture, (x, y), 2 << 4, _COLOUR, cv2.FILLED, cv2.LINE_8, 4)
        return picture
