"""Detectors side by side on images as they come. (No ROS here; the node is rvc_features.nodes.compare_node.)"""

from __future__ import annotations

import dataclasses
import logging
import math
import statistics
import time
from collections import deque
from typing import Sequence

import cv2
import numpy as np

from rvc_features import key_points
from rvc_features.brief import cut, reporter
from rvc_features.comparison import measures, pictures
from rvc_features.comparison.contestants import Contestant, parse, with_distinct_labels
from rvc_features.drawing import draw_key_points
from rvc_features.feature_detector import as_grey
from rvc_features.odometry.masks import Masks, shaded

DEFAULT = ('harris:fixed_number_of_points=true', 'good_features_to_track', 'fast', 'orb')


def contestants(texts: Sequence[str] = DEFAULT) -> list[Contestant]:
    """Detectors in the form of the command line; ContestantError for what is none."""
    return with_distinct_labels([parse(text, 0) for text in texts])


class SideBySide:
    """Runs detectors on one image after the other and draws what they find into one picture.

    Parameters
    ----------
    contestants : sequence of Contestant
        At least one.
    tile_width : int
        Pixels to which wider images are shrunk for the picture (not for the detectors).
    masks : Masks, optional
        Where no points are wanted.
    """

    def __init__(self, contestants: Sequence[Contestant], tile_width: int = 640, masks: Masks | None = None) -> None:
        self.masks = masks or Masks()
        self.contestants = [dataclasses.replace(contestant, masks=self.masks) for contestant in contestants]
        self.tile_width = tile_width
        for contestant in self.contestants:
            _found(contestant, _WARM_UP)
        self._milliseconds: list[deque[float]] = [deque(maxlen=_REMEMBERED) for _ in self.contestants]

    def mosaic(self, image: np.ndarray) -> np.ndarray:
        """All detectors on one image: for each its points, their number, milliseconds, and points per cell.

        Parameters
        ----------
        image : ndarray, uint8, shape (H, W) or (H, W, 3)

        Returns
        -------
        ndarray, uint8, shape (H', W', 3)
        """
        grey = as_grey(image)
        scale = min(1.0, self.tile_width / grey.shape[1])
        small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else image
        mask = self.masks.of(grey.shape)
        if mask is not None and scale < 1:
            mask = cv2.resize(mask, (small.shape[1], small.shape[0]), interpolation=cv2.INTER_NEAREST)
        tiles = []
        for contestant, milliseconds in zip(self.contestants, self._milliseconds):
            start = time.perf_counter()
            points, problem = _found(contestant, grey)
            milliseconds.append((time.perf_counter() - start) * 1000)
            tiles.append(pictures.Picture(
                f'{contestant.label}: {len(points)} points, {statistics.median(milliseconds):.1f} ms',
                problem or _cells_in_words(measures.positions(points), grey.shape),
                shaded(draw_key_points(small, _scaled(points, scale)), mask)))
        return pictures.mosaic(tiles, math.ceil(math.sqrt(len(tiles))))


_WARM_UP = np.kron(np.eye(4, dtype=np.uint8) * 200, np.ones((16, 16), np.uint8))   # compiles what is to be compiled
_LONGEST_PROBLEM = 60   # characters, of which some forty have room under a tile
_logger = logging.getLogger(__name__)
_REMEMBERED = 15   # images: the time shown is the median over them, or it couldn't be read


def _found(contestant: Contestant, grey: np.ndarray) -> tuple[np.ndarray, str]:
    """Key points and nothing, or none and what went wrong: one detector that fails must not take the others along."""
    try:
        return contestant.detect(grey), ''
    except (Exception, SystemExit) as error:
        problem = cut(f'{type(error).__name__}: {error}', _LONGEST_PROBLEM)
        reporter().say(_logger.error, f'detector {contestant.label}', f'{contestant.label} fails: {problem}')
        return key_points.empty(), problem


def _cells_in_words(points: np.ndarray, shape: tuple[int, ...]) -> str:
    cells = measures.CELLS ** 2
    hit = round(measures.covered_cells(points, shape) * cells)
    return f'{len(points) / cells:.1f} points per cell, {hit} of {cells} cells hit'


def _scaled(points: np.ndarray, scale: float) -> np.ndarray:
    scaled = points.copy()
    # Positions count from the centre of the first pixel, which is half a pixel from the edge.
    scaled['x'], scaled['y'] = (points['x'] + 0.5) * scale - 0.5, (points['y'] + 0.5) * scale - 0.5
    scaled['size'] *= scale
    return scaled
