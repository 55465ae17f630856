"""Pictures of what detectors found: which points come again in the other image, and which don't."""

from __future__ import annotations

import dataclasses
import math
from typing import Sequence

import cv2
import numpy as np

from rvc_features.comparison import measures
from rvc_features.comparison.contestants import Contestant
from rvc_features.comparison.correspondences import CommonRegion
from rvc_features.comparison.datasets import Pair
from rvc_features.comparison.survival import Survival

# BGR. Blue and orange are told apart by colour-blind readers too.
AGAIN, NOT_AGAIN, NOT_SEEN = (235, 140, 30), (0, 120, 255), (150, 150, 150)


@dataclasses.dataclass(frozen=True)
class Picture:
    """The second image of a pair (the first, where there is no second) with the points of one detector."""

    label: str
    caption: str
    image: np.ndarray   # uint8, (H, W, 3)


def of_pair(pair: Pair, contestants: Sequence[Contestant], points: int, epsilon: float, width: int) -> list[Picture]:
    """A picture for each contestant, `width` pixels wide at the most."""
    return [_picture(pair, contestant, points, epsilon, width) for contestant in contestants]


def mosaic(pictures: Sequence[Picture], columns: int) -> np.ndarray:
    """The pictures side by side, each with its label and caption above it; uint8 (H, W, 3)."""
    height = max(picture.image.shape[0] for picture in pictures)
    width = max(picture.image.shape[1] for picture in pictures)
    size = max(1.0, width / _PLAIN_WIDTH)   # of the letters, which must be readable on a large mosaic shown small
    strip = round(_STRIP * size)
    rows = math.ceil(len(pictures) / columns)
    canvas = np.full((rows * (height + strip + _GAP) - _GAP, columns * (width + _GAP) - _GAP, 3), 255, np.uint8)
    for number, picture in enumerate(pictures):
        y, x = number // columns * (height + strip + _GAP), number % columns * (width + _GAP)
        _write(canvas, picture.label, (x + 2, y + round(15 * size)), width - 4, 0.5 * size, (0, 0, 0))
        _write(canvas, picture.caption, (x + 2, y + round(32 * size)), width - 4, 0.4 * size, (90, 90, 90))
        image = picture.image
        canvas[y + strip:y + strip + image.shape[0], x:x + image.shape[1]] = image
    return canvas


_STRIP, _GAP = 40, 10   # pixels: the text above a picture, and between pictures
_PLAIN_WIDTH = 400      # pixels: of wider pictures the letters grow with the width


def with_legend(mosaic: np.ndarray, pair: Pair, epsilon: float) -> np.ndarray:
    """The mosaic of a pair with a line below it that says which image it is, and what the colours mean."""
    name = f'{pair.group}, {pair.name}'
    entries = [(AGAIN, f'found again within {epsilon:g} px'), (NOT_AGAIN, 'not found again'),
               (NOT_SEEN, 'outside the first image')] if pair.homography is not None else [(AGAIN, 'a point')]
    size = max(1.0, mosaic.shape[1] / (2 * _PLAIN_WIDTH))
    line = round(18 * size)
    strip = np.full((line * (1 + len(entries)) + line // 2, mosaic.shape[1], 3), 255, np.uint8)
    _write(strip, f'the second image of {name}' if pair.second is not None else name, (2, line), mosaic.shape[1] - 4,
           0.45 * size, (0, 0, 0))
    for number, (colour, text) in enumerate(entries, 2):
        cv2.circle(strip, (line // 2, number * line - line // 4), max(line // 5, 2), colour, -1, cv2.LINE_AA)
        _write(strip, text, (line + 4, number * line), mosaic.shape[1] - line - 8, 0.45 * size, (0, 0, 0))
    return np.vstack((mosaic, strip))


def _picture(pair: Pair, contestant: Contestant, points: int, epsilon: float, width: int) -> Picture:
    second_image = pair.first if pair.second is None else pair.second
    first = measures.positions(contestant.detect(pair.first)[:points])
    second = measures.positions(contestant.detect(second_image)[:points])
    colours = np.tile(np.array(AGAIN), (len(second), 1))
    caption = f'{len(second)} points'
    if pair.second is not None and pair.homography is not None:
        region = CommonRegion(first, second, pair.homography, pair.first.shape, second_image.shape)
        _, again, _ = measures.found_again(region, epsilon)
        colours[:] = NOT_SEEN
        colours[region.second] = NOT_AGAIN
        colours[again] = AGAIN
        caption = f'{len(again)} of {min(len(region.first), len(region.second))} found again, {epsilon:g} px'
    elif pair.second is not None:
        survival = Survival(first, second, pair.first, second_image, [epsilon])
        if survival.tracked is not None:
            caption += f', {survival.tracked:.0%} of those before survive'
    return Picture(contestant.label, caption, _drawn(second_image, second, colours, width))


def _drawn(image: np.ndarray, points: np.ndarray, colours: np.ndarray, width: int) -> np.ndarray:
    """The image, paler than it is, with a ring at each point; scaled first, so that rings stay round and thin."""
    scale = min(1.0, width / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else image
    pale = cv2.cvtColor(np.rint(small * 0.72 + 60).astype(np.uint8), cv2.COLOR_GRAY2BGR)
    radius, thickness = (3, 2) if pale.shape[1] >= 400 else (2, -1)
    # The strongest last, on top; of the kinds, those found again.
    for (x, y), ring in zip(points[::-1], colours[::-1]):
        centre = round((float(x) + 0.5) * scale * 16 - 8), round((float(y) + 0.5) * scale * 16 - 8)
        cv2.circle(pale, centre, radius * 16, tuple(map(int, ring)), thickness, cv2.LINE_AA, 4)
    return pale


def _write(canvas: np.ndarray, text: str, place: tuple[int, int], width: int, size: float,
           ink: tuple[int, int, int]) -> None:
    plain = text.encode('ascii', 'replace').decode()   # OpenCV's font has no other letters
    (needed, _), _ = cv2.getTextSize(plain, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    size *= min(1.0, width / max(needed, 1))
    cv2.putText(canvas, plain, place, cv2.FONT_HERSHEY_SIMPLEX, size, ink, 1, cv2.LINE_AA)
