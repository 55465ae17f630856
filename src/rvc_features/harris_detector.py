"""HarrisDetector: response, local maxima, filter, orientation (exercises 1 and 2, end to end)."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import cv2
import numpy as np

from rvc_features import filters, key_points, maxima, response
from rvc_features.feature_detector import FeatureDetector, as_grey
from rvc_features.orientation import direction, smoothed_gradient
from rvc_features.parameters import Flag, Integer, Real, parameter


@dataclass(frozen=True)
class HarrisDetector(FeatureDetector):
    """Corners after Harris and Stephens, in several octaves, with a direction.

    A key point is a local maximum of the Harris response H above `minimum_response` that passes one of three filters,
    each applied to the candidates of all octaves together: `anms` if set, else the strongest `number_of_points` with
    `fixed_number_of_points`, else those above `threshold` times the largest H.

    `KeyPoint.pt` and `.size` are in pixels of the full image whatever the octave; `.size` is the side of the window,
    `.response` is H, `.octave` counts from 0.

    Parameters
    ----------
    See the fields below; ranges and meanings stand with each. `parameters.specifications(HarrisDetector)` lists them.

    Raises
    ------
    TypeError, ValueError
        For a value that is not accepted, with its name, what was given and what is accepted.

    Examples
    --------
    >>> image = np.zeros((60, 80), np.uint8)
    >>> image[20:40, 30:60] = 200
    >>> detector = HarrisDetector(window_size=3, threshold=0.1, subpixel=False)
    >>> sorted(point.pt for point in detector.detect(image))
    [(30.0, 20.0), (30.0, 39.0), (59.0, 20.0), (59.0, 39.0)]
    """

    name: ClassVar[str] = 'harris'

    window_size: int = parameter(5, response.WINDOW_SIZE)
    window: str = parameter('gaussian', response.WINDOW)
    threshold: float = parameter(0.01, Real(
        'Least response as a share of the largest one in the image.', 0, 1))
    harris_k: float = parameter(0.04, response.HARRIS_K)
    minimum_response: float = parameter(10.0, Real(
        'Least response whatever the image: keeps noise in flat images out.', 0))
    fixed_number_of_points: bool = parameter(False, Flag(
        'Take the strongest number_of_points instead of all above the threshold.'))
    number_of_points: int = parameter(500, Integer(
        'How many points fixed_number_of_points takes at the most.', 0))
    octaves: int = parameter(1, Integer(
        'Levels of the image pyramid; each has half the size of the one before.', 1, 10))
    anms: bool = parameter(False, Flag(
        'Adaptive non-maximal suppression: spread the points over the image. Wins over fixed_number_of_points.'))
    anms_points: int = parameter(500, Integer(
        'How many points adaptive non-maximal suppression takes at the most.', 0))
    anms_robustness: float = parameter(0.9, Real(
        'c_r: a point is suppressed only by one that is stronger by 1 / c_r.', 0, 1, above_low=True))
    local_maxima: bool = parameter(True, Flag(
        'Take only local maxima of the response; without, every pixel that passes is a point.'))
    subpixel: bool = parameter(True, Flag(
        'Refine the position of local maxima between the pixels.'))
    derivative_sigma: float = parameter(0.0, response.DERIVATIVE_SIGMA)
    border: int = parameter(0, Integer(
        'Width in pixels of a rim of each octave in which no point is taken.', 0))
    orientation_sigma: float = parameter(2.5, Real(
        'Size of the larger kernel for the orientation: standard deviation in pixels of the octave.', 0.1, 50))

    def detect_impl(self, image: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
        """Candidates of every octave, then one filter over all of them together."""
        candidates: list[_Candidates] = []
        to_beat = 0.0
        for octave in range(self.octaves):
            if octave > 0:
                if min(image.shape) < 2 * _SMALLEST_OCTAVE:
                    break
                # Pixel (x, y) of the smaller image is centred on (2 x, 2 y) of the larger one.
                image = cv2.pyrDown(image)
                mask = None if mask is None else np.ascontiguousarray(mask[::2, ::2])
            candidates.append(self._candidates(image, octave, mask, to_beat))
            if octave == 0 and self.octaves > 1:
                to_beat = self._least_of_strongest(candidates[0].strength)

        chosen = _only(self._filter(candidates), candidates)
        positions = [self._positions(of_octave) for of_octave in chosen]
        found = self._key_points(chosen, positions)
        gradients = [smoothed_gradient(of_octave.image, x, y, self.orientation_sigma)
                     for of_octave, (x, y) in zip(chosen, positions)]
        found['angle'] = direction(*(_joined(list(parts)) for parts in zip(*gradients)))
        return found

    def harris_corners(self, image: np.ndarray, octave: int = 0, mask: np.ndarray | None = None) -> np.ndarray:
        """Candidates of one octave: local maxima of the response above `minimum_response`, without angle.

        Parameters
        ----------
        image : ndarray, uint8, shape (H, W)
            The octave's own image, 2**octave times smaller than the full one.
        octave : int
        mask : ndarray, uint8, shape (H, W), optional

        Returns
        -------
        ndarray of key_points.DTYPE, shape (N,)
            Positions and sizes in pixels of the full image, in reading order.
        """
        candidates = self._candidates(image, octave, mask)
        return self._key_points([candidates], [self._positions(candidates)])

    def response_map(self, image: np.ndarray) -> np.ndarray:
        """H of the full image."""
        return response.harris_response(as_grey(image), self.window_size, self.window, self.harris_k,
                                        self.derivative_sigma)

    def _candidates(self, image: np.ndarray, octave: int, mask: np.ndarray | None,
                    to_beat: float | None = None) -> _Candidates:
        """Candidates of an octave; given what they must exceed, without some that the filter is sure to drop."""
        h, largest = response.response_and_maximum(image, self.window_size, self.window, self.harris_k,
                                                   self.derivative_sigma, _scratch.response_map(octave, image.shape))
        least = self.minimum_response
        if to_beat is not None and not self.anms:
            if not self.fixed_number_of_points:
                if mask is None and self.border == 0:   # otherwise the largest H need not be that of a candidate
                    # A little below the threshold, for the map is in single precision; the filter decides.
                    least = max(least, (1 - 1e-6) * self.threshold * largest)
            elif to_beat > 0:
                least = max(least, to_beat)
            else:
                # Mostly there are enough far above the least; then there is no need of the many weak ones.
                candidates = self._candidates_above(max(least, _MOSTLY_ENOUGH * largest), image, octave, mask, h)
                if len(candidates.x) >= self.number_of_points:
                    return candidates
        return self._candidates_above(least, image, octave, mask, h)

    def _candidates_above(self, least: float, image: np.ndarray, octave: int, mask: np.ndarray | None,
                          h: np.ndarray) -> _Candidates:
        find = maxima.local_maxima if self.local_maxima else maxima.pixels_above
        x, y = find(h, least)
        if self.border > 0:
            inside = _inside(x, y, h.shape, self.border)
            x, y = x[inside], y[inside]
        if mask is not None:
            allowed = mask[y, x] != 0
            x, y = x[allowed], y[allowed]
        return _Candidates(image, octave, h, x, y, h.ravel().take(y * h.shape[1] + x))

    def _least_of_strongest(self, strength: np.ndarray) -> float:
        """Response of the last of the strongest `number_of_points`, which a further one must exceed; 0 if none must."""
        if self.anms or not self.fixed_number_of_points or not 0 < self.number_of_points <= len(strength):
            return 0.0
        return float(np.partition(strength, -self.number_of_points)[-self.number_of_points])

    def _filter(self, candidates: list[_Candidates]) -> np.ndarray:
        strength = _joined([of_octave.strength for of_octave in candidates])
        if self.anms:
            found = self._key_points(candidates, [self._positions(of_octave) for of_octave in candidates])
            points = np.column_stack((found['x'], found['y']))
            return filters.adaptive_non_maximal_suppression(points, strength, self.anms_points, self.anms_robustness)
        if self.fixed_number_of_points:
            return filters.strongest(strength, self.number_of_points)
        return filters.above_threshold(strength, self.threshold, float(strength.max(initial=0)))

    def _positions(self, candidates: _Candidates) -> tuple[np.ndarray, np.ndarray]:
        """x and y in pixels of the octave."""
        if self.local_maxima and self.subpixel:
            return maxima.refine(candidates.response, candidates.x, candidates.y)
        return candidates.x, candidates.y

    def _key_points(self, candidates: list[_Candidates], positions: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Key points of all octaves in one array, without angle."""
        octave = np.repeat([of_octave.octave for of_octave in candidates], [len(x) for x, _ in positions])
        scale = 1 << octave
        found = key_points.empty(len(octave))
        found['x'] = _joined([x for x, _ in positions]) * scale
        found['y'] = _joined([y for _, y in positions]) * scale
        found['size'] = self.window_size * scale
        found['response'] = _joined([of_octave.strength for of_octave in candidates])
        found['octave'] = octave
        return found


_MOSTLY_ENOUGH = 0.002   # of the largest H: where the strongest points are sought first
_SMALLEST_OCTAVE = 8   # pixels: no octave gets smaller than this to either side


class _Candidates(NamedTuple):
    """What one octave offers to the filter; `response` is valid until the thread's next frame."""

    image: np.ndarray
    octave: int
    response: np.ndarray    # the whole map
    x: np.ndarray           # pixels of the octave
    y: np.ndarray
    strength: np.ndarray    # response at each


def _only(chosen: np.ndarray, candidates: list[_Candidates]) -> list[_Candidates]:
    """The chosen ones of each octave; the indices count through all octaves."""
    kept, start = [], 0
    for of_octave in candidates:
        end = start + len(of_octave.x)
        here = chosen if len(candidates) == 1 else chosen[(chosen >= start) & (chosen < end)] - start
        kept.append(of_octave._replace(x=of_octave.x[here], y=of_octave.y[here], strength=of_octave.strength[here]))
        start = end
    return kept


class _Scratch(threading.local):
    """Response maps that serve frame after frame, for fresh memory costs more than the arithmetic; one set a thread."""

    def __init__(self) -> None:
        self._maps: dict[int, np.ndarray] = {}

    def response_map(self, octave: int, shape: tuple[int, ...]) -> np.ndarray:
        if octave not in self._maps or self._maps[octave].shape != shape:
            self._maps[octave] = np.empty(shape, np.float32)
        return self._maps[octave]


_scratch = _Scratch()


def _joined(arrays: list[np.ndarray]) -> np.ndarray:
    """One array of all; without a copy where there is but one."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def _inside(x: np.ndarray, y: np.ndarray, shape: tuple[int, ...], border: int) -> np.ndarray:
    height, width = shape
    return (x >= border) & (x < width - border) & (y >= border) & (y < height - border)
