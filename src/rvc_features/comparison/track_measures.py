"""What is measured about tracks: how long they last, how far they drift, how many fit a rigid scene.

A history is what a tracker returned for each frame in turn, arrays of tracks.DTYPE.
"""

from __future__ import annotations

from typing import Sequence

import cv2
import numpy as np

from rvc_features.comparison.homographies import project

FRAMES = 30            # after which survival and drift are measured
EPIPOLAR_DISTANCE = 1.0   # pixels from the epipolar line within which a track fits the scene's motion
_FEWEST = 15           # tracks between two frames, for a fundamental matrix to mean anything


def lengths(history: Sequence[np.ndarray]) -> np.ndarray:
    """In how many frames each track was seen, by rising id."""
    if not history:
        return np.zeros(0, int)
    return np.unique(np.concatenate([tracks['id'] for tracks in history]), return_counts=True)[1]


def survival(history: Sequence[np.ndarray], frames: int = FRAMES) -> float | None:
    """Share of the tracks that are still there that many frames after their first; None where none could be.

    Of those only that began early enough for it.
    """
    early = [tracks['id'][tracks['age'] == 0] for tracks in history[:-frames]]
    if sum(map(len, early)) == 0:
        return None
    alive = sum(int(np.isin(begun, history[number + frames]['id']).sum()) for number, begun in enumerate(early))
    return alive / sum(map(len, early))


def drift(tracks: np.ndarray, homography: np.ndarray, age: int = FRAMES) -> np.ndarray:
    """Pixels by which each track of that age misses where the homography takes its start.

    Parameters
    ----------
    tracks : ndarray of tracks.DTYPE
        Of one frame.
    homography : ndarray, shape (3, 3)
        From the frame that many before to this one.
    """
    old = tracks[tracks['age'] == age]
    expected = project(homography, np.column_stack((old['start_x'], old['start_y'])).astype(np.float64))
    return np.hypot(old['x'] - expected[:, 0], old['y'] - expected[:, 1])


def rigid_share(history: Sequence[np.ndarray], step: int = 5) -> float | None:
    """Median share of the tracks that fit one fundamental matrix over `step` frames; None where tracks are too few.

    What fits no matrix moves by itself or is tracked wrongly; what fits may be wrong along its epipolar line.
    """
    shares = []
    for before, now in zip(history[:-step:step], history[step::step]):
        _, first, second = np.intersect1d(before['id'], now['id'], return_indices=True)
        if len(first) < _FEWEST:
            continue
        start, there = (np.column_stack((tracks['x'][which], tracks['y'][which])).astype(np.float64)
                        for tracks, which in ((before, first), (now, second)))
        _, inliers = cv2.findFundamentalMat(start, there, cv2.FM_RANSAC, EPIPOLAR_DISTANCE, 0.99)
        shares.append(0.0 if inliers is None else float(np.mean(np.asarray(inliers))))
    return float(np.median(shares)) if shares else None
