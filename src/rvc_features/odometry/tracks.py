"""Tracks: points that keep their identity from frame to frame, as visual odometry wants them.

`flow` carries the points from one frame to the next; what is not found again ends there. Where tracks have become thin,
the detector finds new points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable

import cv2
import numpy as np

from rvc_features import parameters
from rvc_features.feature_detector import FeatureDetector, as_grey
from rvc_features.odometry.flow import flow
from rvc_features.parameters import Flag, Integer, Real, parameter

DTYPE = np.dtype([
    ('id', np.uint64),             # of this track alone, for as long as the tracker lives
    ('age', np.uint32),            # frames in which it was seen before this one; 0: new
    ('x', np.float32),             # position in pixels; (0, 0) is the centre of the top left pixel
    ('y', np.float32),
    ('velocity_x', np.float32),    # pixels per second since the frame before; 0 for a new track
    ('velocity_y', np.float32),
    ('start_x', np.float32),       # where it was seen first
    ('start_y', np.float32),
    ('start_time', np.float64),    # seconds, the time of that frame
])
NAMES = tuple(DTYPE.names or ())


@dataclass(frozen=True)
class TrackerSettings:
    """What a tracker goes by."""

    number_of_tracks: int = parameter(300, Integer('How many tracks there are at the most.', 0))
    least_distance: float = parameter(12.0, Real(
        'A new track starts no nearer than that to another one, in pixels.', 1))
    window_size: int = parameter(17, Integer('Side of the window that is searched for in the next frame, in pixels.',
                                             5, 63, odd=True))
    levels: int = parameter(4, Integer('Levels of the pyramid; each doubles the motion that can be followed.', 1, 8))
    forward_backward: float = parameter(1.0, Real(
        'A track ends when it comes back farther than that from where it was, in pixels.', 0, above_low=True))
    epipolar: bool = parameter(False, Flag(
        'End tracks that move otherwise than a rigid scene would (RANSAC of the fundamental matrix).'))
    epipolar_distance: float = parameter(1.0, Real(
        'With epipolar: distance from the epipolar line that is still taken, in pixels.', 0, above_low=True))

    def __post_init__(self) -> None:
        parameters.validate(self)


class Tracker:
    """Follows points through the frames of one camera.

    Parameters
    ----------
    settings : TrackerSettings
        May be replaced between two frames.

    Attributes
    ----------
    interval : float
        Seconds between the last two frames; 0 at a start.

    Examples
    --------
    >>> from rvc_features import detectors
    >>> tracker = Tracker(TrackerSettings(number_of_tracks=100))
    >>> image = np.kron(np.eye(8, dtype=np.uint8) * 255, np.ones((16, 16), np.uint8))
    >>> first = tracker.track(image, 0.0, detectors.create('harris'))
    >>> second = tracker.track(np.roll(image, 2, axis=1), 0.1, detectors.create('harris'))
    >>> int(np.isin(second['id'], first['id']).sum()) > 5
    True
    """

    def __init__(self, settings: TrackerSettings | None = None) -> None:
        self.settings = settings or TrackerSettings()
        self._tracks = np.zeros(0, DTYPE)
        self._image: np.ndarray | None = None
        self._time = -np.inf
        self._next_id = 0
        self._lacking = 0.0   # see `_PATIENCE`
        self._most = 0        # tracks after new ones were looked for last
        self.interval = 0.0

    def track(self, image: np.ndarray, time: float, detector: FeatureDetector, mask: np.ndarray | None = None,
              undistort: Callable[[np.ndarray], np.ndarray] | None = None,
              found: np.ndarray | None = None) -> np.ndarray:
        """The tracks in the next frame, the oldest first and among the new ones the strongest.

        A frame that is earlier than the one before, or of another size, starts anew: all its tracks are new ones.

        Parameters
        ----------
        image : ndarray, uint8, shape (H, W) or (H, W, 3)
            Grey or BGR.
        time : float
            Of that frame, in seconds.
        detector : FeatureDetector
            Finds new points.
        mask : ndarray, uint8 or bool, shape (H, W), optional
            Where tracks may be: not zero.
        undistort : callable, optional
            Takes positions, float64 (N, 2) in pixels, to those of an image without distortion, for the epipolar test.
        found : structured array with x and y, optional
            Key points of this frame under that mask, strongest first, where they are known already: new tracks begin at
            them, and the detector is asked only where they are too few.

        Returns
        -------
        ndarray of `DTYPE`
            A new array.
        """
        grey = as_grey(image)
        if not np.isfinite(time):
            raise ValueError(f'time must be a finite number of seconds; got {time}')
        if self._image is None or self._image.shape != grey.shape or time < self._time:
            kept, self.interval = np.zeros(0, DTYPE), 0.0
        else:
            self.interval = time - self._time
            kept = self._follow(self._image, grey, self.interval, mask, undistort)
        new = self._begin(grey, time, kept, detector, mask, found)
        self._tracks = np.concatenate((kept, new))
        # A copy where the caller may draw on his image, or a driver use its memory again.
        self._image, self._time = (grey.copy() if np.shares_memory(grey, image) else grey), time
        return self._tracks.copy()

    def reset(self) -> None:
        """Forget the last frame: the next one starts anew, with ids that no track had before."""
        self._image = None

    def _follow(self, before: np.ndarray, now: np.ndarray, seconds: float, mask: np.ndarray | None,
                undistort: Callable[[np.ndarray], np.ndarray] | None) -> np.ndarray:
        """The tracks that are found again, with their new positions."""
        tracks = self._tracks
        if len(tracks) == 0:
            return tracks
        start = _positions(tracks)
        settings = self.settings
        there, found = flow(before, now, start, settings.window_size, settings.levels, settings.forward_backward)
        alive = found & _inside(there, now.shape, mask)
        tracks, start, there = tracks[alive], start[alive], there[alive]
        if self.settings.epipolar and len(tracks) >= _FEWEST_FOR_EPIPOLAR:
            fits = _epipolar_inliers(start, there, self.settings.epipolar_distance, undistort)
            tracks, start, there = tracks[fits], start[fits], there[fits]
        tracks = tracks.copy()
        tracks['x'], tracks['y'] = there.T
        velocity = (there - start) / seconds if seconds > 0 else np.zeros_like(there)
        tracks['velocity_x'], tracks['velocity_y'] = velocity.T
        tracks['age'] += 1
        return tracks[_unmerged(there)[:self.settings.number_of_tracks]]

    def _begin(self, grey: np.ndarray, time: float, kept: np.ndarray, detector: FeatureDetector,
               mask: np.ndarray | None, found: np.ndarray | None) -> np.ndarray:
        """New tracks where there is none within the least distance, as many as are missing.

        The detector takes about as long as the flow itself, so that few are not worth it, unless they are missed long.
        """
        missing = self.settings.number_of_tracks - len(kept)
        lost = 1 - len(kept) / self._most if self._most else 1.0
        self._lacking += max(lost, missing / max(self.settings.number_of_tracks, 1) / 3)
        if missing <= 0 or self._lacking < _PATIENCE:
            return np.zeros(0, DTYPE)
        free = np.full(grey.shape, 255, np.uint8) if mask is None else (mask != 0).astype(np.uint8) * np.uint8(255)
        _occupy(free, _positions(kept), self.settings.least_distance)
        chosen = np.zeros((0, 2), np.float32)
        if found is not None:
            chosen = _spread(_positions(found), free, self.settings.least_distance, missing)
        if len(chosen) < missing / 2:
            found = detector.detect_arrays(grey, free)
            more = _spread(_positions(found), free, self.settings.least_distance, missing - len(chosen))
            chosen = np.concatenate((chosen, more))
        self._lacking, self._most = 0.0, len(kept) + len(chosen)
        tracks = np.zeros(len(chosen), DTYPE)
        tracks['id'] = self._next_id + np.arange(len(chosen))
        tracks['x'], tracks['y'] = tracks['start_x'], tracks['start_y'] = chosen.T
        tracks['start_time'] = time
        self._next_id += len(chosen)
        return tracks


_FEWEST_FOR_EPIPOLAR = 8   # points, that the fundamental matrix takes
_MERGED = 1.5              # pixels: tracks that are nearer follow the same corner
_PIXEL = 0.9               # pixels from a point to anywhere in its own, and by which a drawn disc may be too small
_PART = 256                # points that are looked at together
_PATIENCE = 0.5            # shares of the tracks that are gone, summed up over the frames, until new are looked for


def _positions(points: np.ndarray) -> np.ndarray:
    return np.column_stack((points['x'], points['y']))


def _inside(points: np.ndarray, shape: tuple[int, ...], mask: np.ndarray | None) -> np.ndarray:
    """Whether each point lies in the image, and where the mask allows."""
    height, width = shape[:2]
    inside = (points > -0.5).all(axis=1) & (points[:, 0] < width - 0.5) & (points[:, 1] < height - 0.5)
    if mask is not None:
        column, row = np.rint(points[inside]).astype(np.intp).T
        inside[inside] = mask[row, column] != 0
    return inside


def _unmerged(points: np.ndarray) -> np.ndarray:
    """Indices of the points without those that have run into one before, and so would follow the same thing."""
    cells = np.floor(points / _MERGED).astype(np.int64)
    return np.sort(np.unique(cells[:, 0] + (cells[:, 1] << 32), return_index=True)[1])


def _occupy(free: np.ndarray, points: np.ndarray, distance: float) -> None:
    """Set `free` to zero in place wherever a pixel may hold a point within the distance of one of those."""
    radius = round((distance + _PIXEL) * 16)
    for x, y in np.rint(points * 16).astype(int).tolist():
        cv2.circle(free, (x, y), radius, (0,), cv2.FILLED, cv2.LINE_8, 4)


def _spread(points: np.ndarray, free: np.ndarray, distance: float, most: int) -> np.ndarray:
    """Up to `most` of the points, in their order, where it is free and none within `distance` of one before.

    What they take is set to zero in `free`.
    """
    chosen: list[int] = []
    nearest = np.clip(np.rint(points).astype(np.intp), 0, (free.shape[1] - 1, free.shape[0] - 1))
    for start in range(0, len(points), _PART):
        column, row = nearest[start:start + _PART].T
        for index in (start + np.flatnonzero(free[row, column])).tolist():
            if len(chosen) >= most:
                return points[chosen]
            x, y = nearest[index].tolist()
            if free.item(y, x):
                chosen.append(index)
                _occupy(free, points[index:index + 1], distance)
    return points[chosen]


def _epipolar_inliers(start: np.ndarray, there: np.ndarray, distance: float,
                      undistort: Callable[[np.ndarray], np.ndarray] | None) -> np.ndarray:
    """Whether each pair fits the motion of a rigid scene; all of them where no motion can be found."""
    first, second = start.astype(np.float64), there.astype(np.float64)
    if undistort is not None:
        first, second = undistort(first), undistort(second)
    _, inliers = cv2.findFundamentalMat(first, second, cv2.FM_RANSAC, distance, 0.99)
    return np.ones(len(start), bool) if inliers is None else inliers.ravel() != 0
