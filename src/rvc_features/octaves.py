"""The levels of the image pyramid: their images, and one list of corners out of those of all of them (exercise 2)."""

from __future__ import annotations

from typing import Iterator, NamedTuple, Sequence

import cv2
import numpy as np

from rvc_features import key_points

SMALLEST = 8           # pixels: no octave gets smaller than this to either side
MERGE_DISTANCE = 2.5   # pixels of the coarser octave: corners nearer than this are one
ONLY_COARSE = 0.05     # weight of corners that no finer octave shows: more of them cost on zoom what the others gain
# SIFT's calcSIFTDescriptor reserved (2 r + 1)^2 numbers for 128: too few unless it looks r = 6 pixels far, for which
# in pixels of its level the point needs this size, and the level such sides.
_LEAST_DESCRIBED, _LEAST_SIDE = 1.04, 5
_LEAST_COMMON = 5      # corners that two octaves must have in common to be compared by them


class Octave(NamedTuple):
    """A level of the pyramid."""

    image: np.ndarray
    mask: np.ndarray | None


def pyramid(image: np.ndarray, mask: np.ndarray | None, octaves: int, exact: bool = False) -> Iterator[Octave]:
    """The image, and smaller ones by `cv2.pyrDown`, as many as are wanted and as the size allows.

    Grey values of the smaller ones are rounded, as OpenCV and the exercise sheet have it, unless they are to be exact,
    in float32: then they have the image's gain and offset.
    """
    yield Octave(image, mask)
    if exact and octaves > 1:
        image = image.astype(np.float32)
    for _ in range(1, octaves):
        if min(image.shape) < 2 * SMALLEST:
            return
        # Pixel (x, y) of the smaller image is centred on (2 x, 2 y) of the larger one.
        image = cv2.pyrDown(image)
        mask = None if mask is None else np.ascontiguousarray(mask[::2, ::2])
        yield Octave(image, mask)


def rounded(image: np.ndarray) -> np.ndarray:
    """An octave's image with whole grey values, uint8."""
    return image if image.dtype == np.uint8 else cv2.convertScaleAbs(image)


def joined(corners: Sequence[np.ndarray]) -> np.ndarray:
    """The corners of all octaves in one array; as bytes, for NumPy joins records field by field."""
    if len(corners) == 1:
        return corners[0]
    return np.concatenate([of_octave.view(np.uint8) for of_octave in corners]).view(key_points.DTYPE)


def in_layers(corners: np.ndarray, layers: int) -> np.ndarray:
    """Each corner `layers` times, at sizes evenly between its octave and the next: 1, sqrt(2) times its own for two.

    A corner looks like one at many scales, and what is drawn round it is not the same at all of them: two images whose
    scales differ by less than an octave then have points that are to be described at the same scale.
    """
    repeated = corners.repeat(layers)
    repeated['size'] *= np.tile(2 ** (np.arange(layers) / layers), len(corners)).astype(np.float32)
    return repeated


def number_for_extractors(points: np.ndarray, size: int, shape: tuple[int, ...]) -> None:
    """Number octaves and layers so that what reads the number as a scale describes points near their own.

    OpenCV's ORB describes a point of octave o in a level 1.2^o times smaller, whatever its size, and SIFT what the size
    says, in a level 2^o times smaller. A layer has the number of ORB's step nearest to it, and octaves are two apart:
    further apart is nearer to ORB's steps, and too coarse for SIFT. What SIFT of OpenCV before 4.6 could not describe
    without writing beyond its memory gets a lower number.

    Parameters
    ----------
    points : ndarray of key_points.DTYPE
        With the octaves of the pyramid, which are changed.
    size : int
        That of the points of octave 0 and layer 0.
    shape : tuple of int
        Of the image.
    """
    layer = np.log2(points['size'] / size) - points['octave']
    number = 2 * points['octave'] + np.rint(layer / np.log2(1.2))
    most = np.minimum(np.log2(points['size'] / _LEAST_DESCRIBED), np.log2(min(shape[:2]) / _LEAST_SIDE))
    points['octave'] = np.minimum(number, np.floor(most)).clip(0)


def compete(responses: np.ndarray, pixels: int) -> np.ndarray:
    """Responses of an octave as multiples of the one that one pixel in a thousand exceeds.

    Smoothing and shrinking make responses smaller, so that otherwise the finest octave would have all strong points.
    """
    ranked = responses[responses > 0]
    if len(ranked) == 0:
        return responses
    rank = min(max(pixels // 1000, 1), len(ranked))
    return responses / np.partition(ranked, -rank)[-rank]


def merged(corners: Sequence[np.ndarray], count: int) -> np.ndarray:
    """One point for each corner, however many octaves show it.

    Place and response are those of the finest octave that shows it, octave and size those of the one in which it is
    strongest; octaves thus say at what scale a corner is to be described, and cost no repeatability. A coarser octave's
    responses are weighed so that half of the corners which both show, out of the `count` strongest, are stronger in it.

    Parameters
    ----------
    corners : sequence of ndarray of key_points.DTYPE
        Those of each octave, from the finest on.
    count : int
        About how many points are wanted.
    """
    everything = corners[0].copy()
    for octave, coarse in enumerate(corners[1:], start=1):
        if len(coarse) == 0 or len(everything) == 0:
            everything = joined([everything, coarse])
            continue
        falling = np.sort(everything['response'])[::-1]
        strong = falling[min(count, len(falling)) - 1] if count > 0 else np.inf
        candidates = np.flatnonzero(everything['response'] >= falling[min(2 * max(count, 1), len(falling)) - 1])
        near = _nearest(coarse, everything.take(candidates), octave)
        common, fine = near >= 0, candidates[near]
        responses = coarse['response'].astype(np.float64)
        both = common & (everything['response'][fine] >= strong)
        if np.count_nonzero(both) >= _LEAST_COMMON:
            responses /= np.median(responses[both] / everything['response'][fine[both]])
        stronger = common & (responses > everything['response'][fine])
        everything['octave'][fine[stronger]] = octave
        everything['size'][fine[stronger]] = coarse['size'][stronger]
        rest = coarse.take(np.flatnonzero(~common))
        rest['response'] = ONLY_COARSE * responses[~common]
        everything = joined([everything, rest])
    return everything


def _nearest(points: np.ndarray, others: np.ndarray, octave: int) -> np.ndarray:
    """Index of the nearest of the others within MERGE_DISTANCE of each point, or -1; by a grid of the octave's pixels.

    Of others in the same pixel of the octave the strongest counts.
    """
    reach = int(np.ceil(MERGE_DISTANCE)) + 1
    x, y = (np.rint(others[name] / (1 << octave)).astype(np.intp) + reach for name in 'xy')
    column, row = (np.rint(points[name] / (1 << octave)).astype(np.intp) + reach for name in 'xy')
    width, height = (max(int(a.max()), int(b.max())) + reach + 1 for a, b in ((x, column), (y, row)))
    grid = np.full(height * width, -1, np.intp)
    rising = np.argsort(others['response'], kind='stable')
    grid[(y * width + x)[rising]] = rising
    down, right = np.mgrid[-reach:reach + 1, -reach:reach + 1]
    offsets = (down * width + right)[np.hypot(down, right) < MERGE_DISTANCE + 2 ** 0.5]   # either was rounded
    found = grid[(row * width + column)[:, None] + offsets]
    point, where = np.nonzero(found >= 0)
    other = found[point, where]
    distance = np.full(found.shape, np.inf)
    distance[point, where] = np.hypot(points['x'].astype(np.float64)[point] - others['x'][other],
                                      points['y'].astype(np.float64)[point] - others['y'][other])
    closest = distance.argmin(axis=1)
    every = np.arange(len(points))
    return np.where(distance[every, closest] < MERGE_DISTANCE * (1 << octave), found[every, closest], -1)
