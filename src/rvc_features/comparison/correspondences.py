"""Which points of two images are the same point: those both images can see, and of these each other's nearest.

Positions are arrays of shape (N, 2), x and y in pixels, strongest first.
"""

from __future__ import annotations

import numpy as np

from rvc_features.comparison.homographies import project


def inside(points: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Which positions lie in an image of shape (H, W): 0 <= x < W and 0 <= y < H. NaN does not."""
    x, y = points[:, 0], points[:, 1]
    return (x >= 0) & (x < shape[1]) & (y >= 0) & (y < shape[0])


class CommonRegion:
    """The points of each image that the other image sees too.

    Attributes
    ----------
    first, second : ndarray of int
        Indices of these points, in order.
    projected, own : ndarray, float64, shapes (N1, 2), (N2, 2)
        Both sets as positions in the second image.
    """

    def __init__(self, first: np.ndarray, second: np.ndarray, homography: np.ndarray,
                 first_shape: tuple[int, ...], second_shape: tuple[int, ...]) -> None:
        projected = project(homography, first)
        back_projected = project(np.linalg.inv(homography), second)
        self.first = np.flatnonzero(inside(projected, second_shape))
        self.second = np.flatnonzero(inside(back_projected, first_shape))
        self.projected = projected[self.first]
        self.own = np.asarray(second, np.float64)[self.second]


def mutual_nearest(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of points that are each other's nearest, one to one.

    Of equally near points the first counts. Points of one set at exactly the same place (two octaves can find one
    corner) are paired off in their order with the points at the nearest place of the other set.

    Returns
    -------
    i, j : ndarray of int, shape (M,)
        Indices into the two sets.
    distance : ndarray, float64, shape (M,)
        Between the points of each pair, in pixels.
    """
    nothing = np.empty(0, np.intp), np.empty(0, np.intp), np.empty(0)
    if len(first) == 0 or len(second) == 0:
        return nothing
    first_places, second_places = _places(first), _places(second)
    a = first[[indices[0] for indices in first_places]]
    b = second[[indices[0] for indices in second_places]]
    to_b, distance = nearest(a, b)
    to_a, _ = nearest(b, a)
    pairs = [(i, j, distance[place])
             for place in np.flatnonzero(to_a[to_b] == np.arange(len(a)))
             for i, j in zip(first_places[place], second_places[to_b[place]])]
    if not pairs:
        return nothing
    i, j, distances = map(np.array, zip(*pairs))
    return i, j, distances


def _places(points: np.ndarray) -> list[list[int]]:
    """Indices of the points at each distinct place, places in the order of their first point."""
    places: dict[tuple[float, ...], list[int]] = {}
    for i, point in enumerate(points):
        places.setdefault(tuple(point), []).append(i)
    return list(places.values())


def nearest(points: np.ndarray, others: np.ndarray, other: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Index of and distance to the nearest of `others`; with `other`, both are one set and a point is not its own."""
    index, squared_distance = np.empty(len(points), np.intp), np.empty(len(points))
    for start in range(0, len(points), _BLOCK):
        block = points[start:start + _BLOCK]
        squared = (block[:, 0, None] - others[:, 0]) ** 2
        squared += (block[:, 1, None] - others[:, 1]) ** 2
        rows = np.arange(len(block))
        if other:
            squared[rows, start + rows] = np.inf
        nearest = squared.argmin(axis=1)
        index[start:start + _BLOCK], squared_distance[start:start + _BLOCK] = nearest, squared[rows, nearest]
    return index, np.sqrt(squared_distance)


_BLOCK = 512   # rows of a distance matrix at a time, so that memory stays small for thousands of points
