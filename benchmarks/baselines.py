"""Baselines for adaptive non-maximal suppression, written from the papers to compare with."""

from __future__ import annotations

import math

import numpy as np


def brute_force(points: np.ndarray, responses: np.ndarray, count: int, robustness: float = 0.9) -> np.ndarray:
    """ANMS as its definition reads: every point against all that are significantly stronger.

    M. Brown, R. Szeliski and S. Winder, "Multi-image matching using multi-scale oriented patches", CVPR 2005, sec. 3.
    """
    order = np.argsort(-responses, kind='stable')
    points, responses = points[order], responses[order]
    radii = np.full(len(points), np.inf)
    for i in range(len(points)):
        stronger = responses[i] < robustness * responses
        if stronger.any():
            offsets = points[stronger] - points[i]
            radii[i] = math.sqrt((offsets * offsets).sum(axis=1).min())
    return order[np.argsort(-radii, kind='stable')[:count]]


def square_covering(points: np.ndarray, responses: np.ndarray, count: int, width: float, height: float,
                    tolerance: float = 0.1) -> np.ndarray:
    """Suppression via square covering: an approximation of ANMS, with about `count` points.

    O. Bailo, F. Rameau, K. Joo, J. Park, O. Bogdan and I. S. Kweon, "Efficient adaptive non-maximal suppression
    algorithms for homogeneous spatial keypoint distribution", Pattern Recognition Letters 106, 2018, sec. 3.

    A binary search for the side of a square: points are taken strongest first, and each one covers the squares round
    it, in a grid of half the side; covered ones are left out. The search starts between the bounds of the paper and
    ends when the number of points is within `tolerance` of what is wanted.
    """
    order = np.argsort(-responses, kind='stable')
    xs, ys = points[order, 0].tolist(), points[order, 1].tolist()
    if count < 2 or len(xs) <= count:
        return order[:count]
    root = math.sqrt(4 * width + 4 * count + 4 * height * count + height * height + width * width
                     - 2 * width * height + 4 * width * height * count)
    high = max(-round((height + width + 2 * count + root) / (count - 1)),
               -round((height + width + 2 * count - root) / (count - 1)))
    low = math.floor(math.sqrt(len(xs) / count))
    chosen: list[int] = []
    previous = -1.0
    while low <= high:
        side = low + (high - low) / 2
        if side == previous:
            break
        previous = side
        cell = side / 2
        rows, columns = math.floor(height / cell) + 1, math.floor(width / cell) + 1
        reach = math.floor(side / cell)
        covered = np.zeros((rows, columns), bool)
        chosen = []
        for i in range(len(xs)):
            row, column = math.floor(ys[i] / cell), math.floor(xs[i] / cell)
            if not covered[row, column]:
                chosen.append(i)
                covered[max(row - reach, 0):row + reach + 1, max(column - reach, 0):column + reach + 1] = True
        if (1 - tolerance) * count <= len(chosen) <= (1 + tolerance) * count:
            break
        if len(chosen) < count:
            high = side - 1
        else:
            low = side + 1
    return order[chosen[:count]]
