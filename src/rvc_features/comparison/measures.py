"""What is measured about points: pure functions of positions, images and a homography.

Points are arrays of shape (N, 2), x and y in pixels, strongest first. docs/comparison.md says it all in prose.
"""

from __future__ import annotations

from typing import Sequence

import cv2
import numpy as np

from rvc_features import key_points as kp
from rvc_features.comparison.homographies import local_rotation, project

CELLS = 8                 # coverage: the image is cut into CELLS x CELLS
MATCH_TOLERANCE = 3.0     # pixels within which a descriptor match is right
TRACK_TOLERANCE = 1.0     # pixels between a point and its track forth and back
CHANCE_ROUNDS = 20        # simulations behind one chance level


def positions(points: np.ndarray) -> np.ndarray:
    """x and y of key points (structured array) as float64, shape (N, 2)."""
    return np.column_stack((points['x'], points['y'])).astype(np.float64)


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
    to_b, distance = _nearest(a, b)
    to_a, _ = _nearest(b, a)
    pairs = [(i, j, distance[place])
             for place in np.flatnonzero(to_a[to_b] == np.arange(len(a)))
             for i, j in zip(first_places[place], second_places[to_b[place]])]
    if not pairs:
        return nothing
    i, j, distances = map(np.array, zip(*pairs))
    return i, j, distances


def repeatability(region: CommonRegion, epsilons: Sequence[float]) -> list[float | None]:
    """Share of points found again within each epsilon: mutual nearest neighbours / min(N1, N2).

    None where one image has no point in the region.

    References
    ----------
    C. Schmid, R. Mohr and C. Bauckhage, "Evaluation of interest point detectors", IJCV 37(2), 2000, sec. 3.1.
    K. Mikolajczyk et al., "A comparison of affine region detectors", IJCV 65, 2005, sec. 4 (one-to-one, min(N1, N2)).
    """
    least = min(len(region.own), len(region.projected))
    if least == 0:
        return [None] * len(epsilons)
    _, _, distance = mutual_nearest(region.projected, region.own)
    return [float(np.count_nonzero(distance <= epsilon)) / least for epsilon in epsilons]


def chance_level(counts: tuple[int, int], homography: np.ndarray, first_shape: tuple[int, ...],
                 second_shape: tuple[int, ...], epsilons: Sequence[float], seed: int) -> list[float | None]:
    """Repeatability of points strewn evenly at random: as many in the common region as `counts` says.

    The mean over CHANCE_ROUNDS simulations.
    """
    if min(counts) == 0:
        return [None] * len(epsilons)
    generator = np.random.default_rng(seed)
    inverse = np.linalg.inv(homography)
    shares = []
    for _ in range(CHANCE_ROUNDS):
        first = _strewn(generator, counts[0], first_shape, homography, second_shape)
        second = _strewn(generator, counts[1], second_shape, inverse, first_shape)
        _, _, distance = mutual_nearest(project(homography, first), second)
        shares.append([np.count_nonzero(distance <= epsilon) / min(counts) for epsilon in epsilons])
    return [float(share) for share in np.mean(shares, axis=0)]


def found_again(region: CommonRegion, epsilon: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices in the first and in the second image of the points found again within epsilon, and their distances."""
    i, j, distance = mutual_nearest(region.projected, region.own)
    near = distance <= epsilon
    return region.first[i[near]], region.second[j[near]], distance[near]


def covered_cells(points: np.ndarray, shape: tuple[int, ...]) -> float:
    """Share of the CELLS x CELLS cells of an image of shape (H, W) that hold a point."""
    cells = np.floor(points * CELLS / (shape[1], shape[0])).astype(int).clip(0, CELLS - 1)
    return len(np.unique(cells, axis=0)) / CELLS ** 2


def spacing(points: np.ndarray) -> float | None:
    """Mean distance in pixels from each point to its nearest neighbour; None for fewer than two points."""
    if len(points) < 2:
        return None
    return float(_nearest(points, points, other=True)[1].mean())


def orientation_errors(first_angles: np.ndarray, second_angles: np.ndarray, homography: np.ndarray,
                       first_points: np.ndarray) -> np.ndarray:
    """Degrees, in [0, 180], by which each angle in the second image misses the first one turned by the homography.

    Only of pairs where both angles are there (not negative).
    """
    known = (first_angles >= 0) & (second_angles >= 0)
    turned = first_angles[known] + local_rotation(homography, first_points[known])
    return np.abs((second_angles[known] - turned + 180) % 360 - 180)


def matching_accuracy(first: np.ndarray, second: np.ndarray, first_image: np.ndarray, second_image: np.ndarray,
                      homography: np.ndarray) -> tuple[int, int]:
    """How many mutual matches of ORB descriptors at the key points there are, and how many of them are right.

    Parameters
    ----------
    first, second : ndarray of key_points.DTYPE
        Those in the common region. A point without angle is described upright; its size, relative to the smallest
        size of its detector, picks the level of the pyramid it is described in.

    References
    ----------
    E. Rublee et al., "ORB: an efficient alternative to SIFT or SURF", ICCV 2011.
    K. Mikolajczyk and C. Schmid, "A performance evaluation of local descriptors", PAMI 27(10), 2005 (1 - precision).
    """
    if len(first) == 0 or len(second) == 0:
        return 0, 0
    smallest = min(float(first['size'].min()), float(second['size'].min()))
    first_positions, first_descriptors = _orb_descriptors(first, first_image, smallest)
    second_positions, second_descriptors = _orb_descriptors(second, second_image, smallest)
    if len(first_positions) == 0 or len(second_positions) == 0:
        return 0, 0
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(first_descriptors, second_descriptors)
    i, j = [match.queryIdx for match in matches], [match.trainIdx for match in matches]
    offsets = project(homography, first_positions[i]) - second_positions[j]
    return len(matches), int(np.count_nonzero(np.hypot(*offsets.T) <= MATCH_TOLERANCE))


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


def bootstrap_means(values: np.ndarray, seed: int, rounds: int = 2000) -> np.ndarray:
    """Means of resampled rows: `rounds` times, as many rows as there are are drawn with replacement.

    Parameters
    ----------
    values : ndarray, shape (pairs, detectors)
        NaN is left out of a mean. Drawing whole rows keeps detectors paired, so that differences can be judged.

    Returns
    -------
    ndarray, shape (rounds, detectors)

    References
    ----------
    B. Efron and R. J. Tibshirani, "An introduction to the bootstrap", 1993, ch. 13 (percentile interval).
    """
    generator = np.random.default_rng(seed)
    rows = len(values)
    weights = generator.multinomial(rows, [1 / rows] * rows, size=rounds).astype(np.float64)
    known = ~np.isnan(values)
    totals = weights @ np.where(known, values, 0)
    counts = weights @ known
    return np.divide(totals, counts, out=np.full_like(totals, np.nan), where=counts > 0)


def interval(means: np.ndarray) -> tuple[float, float]:
    """The middle 95 per cent of bootstrap means (a vector)."""
    low, high = np.nanpercentile(means, [2.5, 97.5])
    return float(low), float(high)


def thinned(points: np.ndarray, distance: float) -> np.ndarray:
    """Key points, strongest first, without those nearer than `distance` pixels to a stronger one that is kept."""
    kept: list[int] = []
    where = positions(points)
    free = np.ones(len(points), bool)
    for i in range(len(points)):
        if free[i]:
            kept.append(i)
            free[i + 1:] &= np.hypot(*(where[i + 1:] - where[i]).T) >= distance
    return points[kept]


def _places(points: np.ndarray) -> list[list[int]]:
    """Indices of the points at each distinct place, places in the order of their first point."""
    places: dict[tuple[float, float], list[int]] = {}
    for i, point in enumerate(points.tolist()):
        places.setdefault((point[0], point[1]), []).append(i)
    return list(places.values())


def _nearest(points: np.ndarray, others: np.ndarray, other: bool = False) -> tuple[np.ndarray, np.ndarray]:
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


def _strewn(generator: np.random.Generator, count: int, shape: tuple[int, ...], homography: np.ndarray,
            other_shape: tuple[int, ...]) -> np.ndarray:
    """`count` even random positions in an image, of those that `homography` takes into the other image."""
    found = np.empty((0, 2))
    for _ in range(_MOST_DRAWS):
        drawn = generator.random((max(4 * count, 64), 2)) * (shape[1], shape[0])
        found = np.concatenate((found, drawn[inside(project(homography, drawn), other_shape)]))
        if len(found) >= count:
            break
    return found[:count]


_MOST_DRAWS = 2000   # gives up on a common region of a few pixels, whose chance level nobody can use


def _track(image: np.ndarray, other: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    there, status, _ = cv2.calcOpticalFlowPyrLK(image, other, start, None)   # type: ignore[call-overload]
    return there, status.ravel() != 0


def _orb_descriptors(points: np.ndarray, image: np.ndarray, smallest: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and descriptors of the points far enough from the image's rim to be described."""
    described = points.copy()
    if smallest > 0:
        described['octave'] = np.rint(np.log(points['size'] / smallest) / np.log(_ORB_SCALE)).astype(np.int32)
    found, descriptors = cv2.ORB_create(scaleFactor=_ORB_SCALE).compute(   # type: ignore[attr-defined]
        image, kp.to_objects(described))
    if descriptors is None:
        return np.empty((0, 2)), np.empty((0, 32), np.uint8)
    return np.array([point.pt for point in found], np.float64), descriptors


_ORB_SCALE = 1.2
