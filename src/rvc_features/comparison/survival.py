"""What becomes of the points of one frame in the next, where no ground truth is known."""

from __future__ import annotations

from typing import Sequence

import cv2
import numpy as np

from rvc_features.comparison.correspondences import inside, mutual_nearest

TRACK_TOLERANCE = 1.0     # pixels between a point and its track forth and back


class Survival:
    """What becomes of the points of one frame in the next, where no ground truth is known.

    Each point is tracked to the second frame and back (Lucas and Kanade in a pyramid); it survives when it comes back
    to within TRACK_TOLERANCE of where it started.

    Attributes
    ----------
    tracked : float or None
        Share of the points that survive.
    found_again : list of float or None
        For each epsilon: share of the survivors inside the second frame that the detector found there too, one to
        one. None without survivors.
    motion : float or None
        Median length in pixels of the survivors' way: near zero, both shares are easy to get.

    References
    ----------
    J.-Y. Bouguet, "Pyramidal implementation of the Lucas Kanade feature tracker", 2000.
    Z. Kalal, K. Mikolajczyk and J. Matas, "Forward-backward error", ICPR 2010.
    """

    def __init__(self, first: np.ndarray, second: np.ndarray, first_image: np.ndarray, second_image: np.ndarray,
                 epsilons: Sequence[float]) -> None:
        self.tracked: float | None = None
        self.found_again: list[float | None] = [None] * len(epsilons)
        self.motion: float | None = None
        if len(first) == 0:
            return
        start = first.astype(np.float32)[:, None]
        there, forth = _track(first_image, second_image, start)
        back, home = _track(second_image, first_image, there)
        missed = np.hypot(*(back - start).reshape(-1, 2).T)
        survives = forth & home & (missed <= TRACK_TOLERANCE)
        self.tracked = float(survives.mean())
        arrived = there.reshape(-1, 2).astype(np.float64)
        visible = survives & inside(arrived, second_image.shape)
        if not visible.any():
            return
        self.motion = float(np.median(np.hypot(*(arrived - first)[visible].T)))
        _, _, distance = mutual_nearest(arrived[visible], second)
        self.found_again = [np.count_nonzero(distance <= epsilon) / int(visible.sum()) for epsilon in epsilons]


def _track(image: np.ndarray, other: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    there, status, _ = cv2.calcOpticalFlowPyrLK(image, other, start, None)   # type: ignore[call-overload]
    return there, status.ravel() != 0
