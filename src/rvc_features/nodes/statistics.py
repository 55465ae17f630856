"""What a node has done so far, in numbers, for /diagnostics. (No ROS here.)"""

from __future__ import annotations

import re
import statistics
import threading
import time
from collections import deque
from typing import Any, Callable, NamedTuple

import numpy as np

from rvc_features.brief import cut

_WINDOW = 5            # reports over which shares are taken
_FRAMES = 1000         # ages that are kept between two reports
_GAPS = 5              # between images, to know what is usual
_MOST_CAUSES = 12      # kinds of rejection that are told apart; what comes beyond is counted as one
_OTHERS = 'other causes'


class Totals(NamedTuple):
    """Sums since the start, or over a time."""

    seconds: float
    received: int
    processed: int
    dropped: int
    rejected: int
    busy_seconds: float

    def minus(self, earlier: Totals) -> Totals:
        differences: Any = (now - then for now, then in zip(self, earlier))
        return Totals(*differences)


class Report(NamedTuple):
    """What happened lately."""

    interval: Totals             # since the last report
    window: Totals               # over the last few
    age_median: float            # seconds from an image's arrival to the end of its processing, since the last report
    age_worst: float
    silence: float               # seconds since the last image came, or since there could be one
    usual_gap: float             # seconds between two images; 0 as long as there were not two
    stamp_delay: float | None    # seconds from the last image's stamp to its arrival
    points: tuple[int, ...]      # numbers of key points of the last frames
    spread: tuple[float, float]  # of those of the last frame: width and height of all but the outer tenth, in images


class NodeStatistics:
    """Counters that several threads may move.

    Parameters
    ----------
    counts : callable
        How many images were received and dropped so far.

    Attributes
    ----------
    processed, frames_rejected, parameters_rejected : int
        Frames, and values of parameters, since the start.
    points : int
        Key points in the last frame.
    last_problem : str
        Why the last frame was rejected; empty if none was.
    causes : dict of str to int
        How many frames were rejected for which kind of reason.
    """

    def __init__(self, counts: Callable[[], tuple[int, int]] = lambda: (0, 0)) -> None:
        self.processed = 0
        self.frames_rejected = 0
        self.parameters_rejected = 0
        self.points = 0
        self.last_problem = ''
        self.causes: dict[str, int] = {}
        self._counts = counts
        self._busy_seconds = 0.0
        self._lock = threading.Lock()
        self._ages: deque[float] = deque(maxlen=_FRAMES)
        self._last_points: deque[int] = deque(maxlen=_WINDOW)
        self._last_found = (np.empty(0), np.empty(0), (1, 1))
        self._gaps: deque[float] = deque(maxlen=_GAPS)
        self._last_arrival: float | None = None
        self._waiting_since = time.monotonic()
        self._stamp_delay: float | None = None
        self._totals = deque([self._now()], maxlen=_WINDOW)

    def waiting(self) -> None:
        """From now on images may come: after a subscription, silence counts from here."""
        with self._lock:
            self._waiting_since, self._last_arrival = time.monotonic(), None

    def frame_arrived(self, stamp_delay: float | None = None) -> float:
        """Returns when, by time.monotonic."""
        now = time.monotonic()
        with self._lock:
            if self._last_arrival is not None:
                self._gaps.append(now - self._last_arrival)
            self._last_arrival, self._stamp_delay = now, stamp_delay
        return now

    def frame_processed(self, found: np.ndarray, shape: tuple[int, int], seconds: float, age: float) -> None:
        """Count a frame of that shape with its key points, what it took, and how old it was in the end."""
        with self._lock:
            self.processed += 1
            self.points = len(found)
            self._last_points.append(len(found))
            self._last_found = (found['x'], found['y'], shape)
            self._busy_seconds += seconds
            self._ages.append(age)

    def frame_rejected(self, problem: str) -> None:
        problem = cut(problem)
        kind = _kind(problem)
        with self._lock:
            self.frames_rejected += 1
            self.last_problem = problem
            if kind not in self.causes and len(self.causes) >= _MOST_CAUSES:
                kind = _OTHERS
            self.causes[kind] = self.causes.get(kind, 0) + 1

    def parameters_refused(self, count: int) -> None:
        with self._lock:
            self.parameters_rejected += count

    def report(self) -> Report:
        """What happened since the last call, and over the last few."""
        with self._lock:
            now = self._now()
            interval, window = now.minus(self._totals[-1]), now.minus(self._totals[0])
            self._totals.append(now)
            ages, points = list(self._ages), tuple(self._last_points)
            self._ages.clear()
            x, y, shape = self._last_found
            silence = now.seconds - max(self._last_arrival or 0.0, self._waiting_since)
            usual_gap, stamp_delay = max(self._gaps, default=0.0), self._stamp_delay
        return Report(interval, window, statistics.median(ages) if ages else 0.0, max(ages, default=0.0), silence,
                      usual_gap, stamp_delay, points, (_spread(x, shape[1]), _spread(y, shape[0])))

    def causes_in_words(self) -> str:
        """The most frequent first; empty if there was none."""
        with self._lock:
            causes = sorted(self.causes.items(), key=lambda item: -item[1])
        return '; '.join(f'{count:,} times {kind}' for kind, count in causes)

    def _now(self) -> Totals:
        received, dropped = self._counts()
        return Totals(time.monotonic(), received, self.processed, dropped, self.frames_rejected, self._busy_seconds)


def _kind(problem: str) -> str:
    """A reason without what differs from case to case: quoted values and numbers."""
    kind = re.sub(r"b?'[^']*'?|\"[^\"]*\"?", "'...'", problem)
    return cut(re.sub(r'\b[0-9a-f]{6,}\b|\d[\d.,e+-]*', '#', kind), 100)


def _spread(positions: np.ndarray, length: int) -> float:
    """Of positions along a side of that length: the share of it that all but the outer tenth of them take."""
    if len(positions) == 0:
        return 0.0
    ordered = np.sort(positions)
    outer = len(ordered) // 20
    return float(ordered[len(ordered) - 1 - outer] - ordered[outer]) / length
