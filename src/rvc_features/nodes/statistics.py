"""What a node has done so far, in numbers, for /diagnostics. (No ROS here.)"""

from __future__ import annotations

import threading
import time
from typing import NamedTuple


class Interval(NamedTuple):
    """Sums over the time since the last report."""

    seconds: float
    frames: int
    frames_rejected: int
    busy_seconds: float


class NodeStatistics:
    """Counters that several threads may move.

    Attributes
    ----------
    processed, frames_rejected, parameters_rejected : int
        Frames, and values of parameters, since the start.
    points : int
        Key points in the last frame.
    last_problem : str
        Why the last frame was rejected; empty if none was.
    """

    def __init__(self) -> None:
        self.processed = 0
        self.frames_rejected = 0
        self.parameters_rejected = 0
        self.points = 0
        self.last_problem = ''
        self._busy_seconds = 0.0
        self._lock = threading.Lock()
        self._last_report = Interval(time.monotonic(), 0, 0, 0.0)

    def frame_processed(self, points: int, seconds: float) -> None:
        with self._lock:
            self.processed += 1
            self.points = points
            self._busy_seconds += seconds

    def frame_rejected(self, problem: str) -> None:
        with self._lock:
            self.frames_rejected += 1
            self.last_problem = problem

    def parameter_rejected(self) -> None:
        with self._lock:
            self.parameters_rejected += 1

    def interval(self) -> Interval:
        """What happened since the last call."""
        with self._lock:
            now = Interval(time.monotonic(), self.processed, self.frames_rejected, self._busy_seconds)
            then, self._last_report = self._last_report, now
        return Interval(now.seconds - then.seconds, now.frames - then.frames,
                        now.frames_rejected - then.frames_rejected, now.busy_seconds - then.busy_seconds)
