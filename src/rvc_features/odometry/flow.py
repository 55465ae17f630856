"""Flow: where points of one frame are in the next one.

Lucas and Kanade's optical flow in a pyramid (OpenCV's) carries them there, and back: what does not come back to where
it was is not found.

References
----------
J.-Y. Bouguet, "Pyramidal implementation of the Lucas Kanade feature tracker", 2000.
Z. Kalal, K. Mikolajczyk and J. Matas, "Forward-backward error: automatic detection of tracking failures", ICPR 2010.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

# When the flow stops: iterations, and the last step in pixels.
_COARSE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.1)
_EXACT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.01)
_BACK = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 5, 0.05)
_FEWEST_FOR_MOTION = 10   # points, for a motion to be that of most
_LEAST_TURN = 0.005       # radians, or share of the size: less moves nothing in a window
_LEAST_ALIKE = 0.5        # correlation of the windows in two frames


def flow(before: np.ndarray, now: np.ndarray, start: np.ndarray, window_size: int, levels: int,
         forward_backward: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions in the next frame, and whether each of them leads back to where it came from.

    The way there is found in images of a quarter of the size, then exactly in the images themselves. A window that
    turns or grows pulls its point aside, a little in each frame and always to the same side; so the frame before is
    first turned and scaled as most points say.

    Parameters
    ----------
    before, now : ndarray, uint8, shape (H, W)
        The two frames.
    start : ndarray, float32, shape (N, 2)
        Positions in the first one, x and y in pixels; not empty.
    window_size : int
        Side of what is searched for, in pixels of each level.
    levels : int
        Of the pyramid.
    forward_backward : float
        By how many pixels the way back may miss where it began.

    Returns
    -------
    ndarray, float32, shape (N, 2)
        Where they are, or may be.
    ndarray, bool, shape (N,)
        Whether they have been found.
    """
    there = _coarse_flow(before, now, start, window_size, levels)
    turned, motion = _as_turned(before, start, there)
    expected = start if motion is None else _moved(start, motion)
    unknown = np.isnan(there[:, 0])
    there[unknown] = expected[unknown]
    exact: Any = {'winSize': (window_size, window_size), 'maxLevel': 0, 'flags': cv2.OPTFLOW_USE_INITIAL_FLOW}
    there, found, _ = cv2.calcOpticalFlowPyrLK(turned, now, expected, there.copy(), criteria=_EXACT, **exact)
    # Back it has come from where it belongs, so that in images of different things it may well stay there.
    alike = _alike(turned, expected, now, there, window_size) >= _LEAST_ALIKE
    followed = np.flatnonzero((found.ravel() != 0) & alike)
    kept = np.zeros(len(start), bool)
    if len(followed):
        home = expected[followed]
        back, found, _ = cv2.calcOpticalFlowPyrLK(now, turned, there[followed], home.copy(), criteria=_BACK, **exact)
        kept[followed] = (found.ravel() != 0) & (np.hypot(*(back - home).T) <= forward_backward)
    return there, kept


def _coarse_flow(before: np.ndarray, now: np.ndarray, start: np.ndarray, side: int, levels: int) -> np.ndarray:
    """Positions in the next frame to about a pixel; NaN where the flow has lost a point."""
    halvings = min(levels - 1, 2)
    for _ in range(halvings):
        before, now = cv2.pyrDown(before), cv2.pyrDown(now)
    there, found, _ = cv2.calcOpticalFlowPyrLK(   # type: ignore[call-overload]
        before, now, start / 2 ** halvings, None, winSize=(side, side), maxLevel=levels - 1 - halvings,
        criteria=_COARSE)
    there *= 2 ** halvings
    there[found.ravel() == 0] = np.nan
    return there


def _as_turned(image: np.ndarray, start: np.ndarray, there: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """The image moved as most points say, and that motion (2 x 3); the image itself and None where it hardly turns."""
    known = ~np.isnan(there[:, 0])
    if np.count_nonzero(known) < _FEWEST_FOR_MOTION:
        return image, None
    motion, _ = cv2.estimateAffinePartial2D(start[known], there[known])
    if motion is None or np.abs(motion[:, :2] - np.eye(2)).max() < _LEAST_TURN \
            or not 0.5 < np.hypot(*motion[:, 0]) < 2:
        return image, None
    height, width = image.shape
    return cv2.warpAffine(image, motion, (width, height), flags=cv2.INTER_LINEAR,
                          borderMode=cv2.BORDER_REPLICATE), motion


def _moved(points: np.ndarray, motion: np.ndarray) -> np.ndarray:
    return (points @ motion[:, :2].T + motion[:, 2]).astype(np.float32)


def _alike(first: np.ndarray, start: np.ndarray, second: np.ndarray, there: np.ndarray, side: int) -> np.ndarray:
    """Correlation of the windows at two positions in two images, from -1 to 1; NaN where one is flat."""
    steps = np.arange(-(side // 2), side // 2 + 1, 4)   # a sample of it is enough
    windows = []
    for image, points in ((first, start), (second, there)):
        column, row = np.rint(points).astype(np.intp).T
        rows = np.clip(row[:, None] + steps, 0, image.shape[0] - 1)
        columns = np.clip(column[:, None] + steps, 0, image.shape[1] - 1)
        window = image[rows[:, :, None], columns[:, None, :]].reshape(len(points), -1).astype(np.float32)
        windows.append(window - window.mean(axis=1, keepdims=True))
    one, other = windows
    with np.errstate(invalid='ignore', divide='ignore'):
        return np.einsum('ij,ij->i', one, other) / np.sqrt(np.einsum('ij,ij->i', one, one)
                                                           * np.einsum('ij,ij->i', other, other))
