"""What is measured about points where the homography is known, and about points alone: pure functions.

Positions are arrays of shape (N, 2), x and y in pixels, strongest first. docs/comparison.md says it all in prose.
"""

from __future__ import annotations

from typing import Sequence

import cv2
import numpy as np

from rvc_features import key_points as kp
from rvc_features.comparison.correspondences import CommonRegion, inside, mutual_nearest, nearest
from rvc_features.comparison.homographies import project, turned

CELLS = 8                 # coverage: the image is cut into CELLS x CELLS
MATCH_TOLERANCE = 3.0     # pixels within which a descriptor match is right
CHANCE_ROUNDS = 20        # simulations behind one chance level


def positions(points: np.ndarray) -> np.ndarray:
    """x and y of key points (structured array) as float64, shape (N, 2)."""
    return np.column_stack((points['x'], points['y'])).astype(np.float64)


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
    return len(np.unique(cells @ (CELLS, 1))) / CELLS ** 2   # not by axis=0, which NumPy 1.17 can not without any


def spacing(points: np.ndarray) -> float | None:
    """Mean distance in pixels from each point to its nearest neighbour; None for fewer than two points."""
    if len(points) < 2:
        return None
    return float(nearest(points, points, other=True)[1].mean())


def orientation_errors(first_angles: np.ndarray, second_angles: np.ndarray, homography: np.ndarray,
                       first_points: np.ndarray) -> np.ndarray:
    """Degrees, in [0, 180], by which each angle in the second image misses the first one under the homography.

    Its derivative takes arrows of the first image into the second one. Only of pairs where both angles are there (not
    negative).
    """
    known = (first_angles >= 0) & (second_angles >= 0)
    expected = turned(homography, first_points[known], first_angles[known])
    return np.abs((second_angles[known] - expected + 180) % 360 - 180)


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
