"""Key points in the drawing: the difference between a picture and the image that came in."""

from __future__ import annotations

import cv2
import numpy as np

from rvc_features import key_points

_MOST_DRAWN = 0.5        # of the pixels: more is another picture
_TOLERANCE = 12          # grey values: what a lossy transport changes


def as_bgr(image: np.ndarray) -> np.ndarray:
    """A grey or BGR image as BGR."""
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image


def share_drawn(image: np.ndarray, picture: np.ndarray) -> float:
    """The share of the pixels in which the picture is not the image; 1 where they differ in shape."""
    if picture.shape[:2] != image.shape[:2]:
        return 1.0
    return float(_drawn(image, picture).mean())


def points_drawn(image: np.ndarray, picture: np.ndarray) -> np.ndarray | None:
    """The middle of each thing that was drawn, as key points without angle; None if it is another picture."""
    if share_drawn(image, picture) > _MOST_DRAWN:
        return None
    count, _, boxes, _ = cv2.connectedComponentsWithStats(_drawn(image, picture).astype(np.uint8), connectivity=8)
    found = key_points.empty(count - 1)
    found['x'] = boxes[1:, cv2.CC_STAT_LEFT] + (boxes[1:, cv2.CC_STAT_WIDTH] - 1) / 2
    found['y'] = boxes[1:, cv2.CC_STAT_TOP] + (boxes[1:, cv2.CC_STAT_HEIGHT] - 1) / 2
    return found


def widest_drawn(image: np.ndarray, picture: np.ndarray) -> int:
    """The longer side in pixels of the largest thing that was drawn, 0 if there is none."""
    _, _, boxes, _ = cv2.connectedComponentsWithStats(_drawn(image, picture).astype(np.uint8), connectivity=8)
    return int(boxes[1:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(initial=0))


def is_grey(picture: np.ndarray) -> bool:
    """Whether a BGR picture has no colour; what is drawn in colour doesn't count."""
    spread = picture.max(axis=2).astype(int) - picture.min(axis=2)
    return float((spread > _TOLERANCE).mean()) < 0.1


def _drawn(image: np.ndarray, picture: np.ndarray) -> np.ndarray:
    return np.abs(as_bgr(picture).astype(int) - as_bgr(image)).max(axis=2) > _TOLERANCE
