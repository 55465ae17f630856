"""HarrisDetector: octaves, response, local maxima, filter, position, orientation (exercises 1 and 2, end to end)."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Callable, ClassVar, Iterator, NamedTuple

import cv2
import numpy as np

from rvc_features import filters, key_points, maxima, response
from rvc_features.brief import reporter
from rvc_features.feature_detector import FeatureDetector, as_grey
from rvc_features.orientation import direction, smoothed_gradient
from rvc_features.parameters import Flag, Integer, Real, parameter
from rvc_features.search import ResponseMaps, Search


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
        """Corners of every octave, one filter over all of them together, then position and direction of those left."""
        _, search = self._chosen_filter()
        octaves = list(self.pyramid(image, mask))
        corners = [self.harris_corners(of_octave.image, octave, of_octave.mask, search)
                   for octave, of_octave in enumerate(octaves)]
        points = self.filter(_at_most(MOST_CORNERS, _joined(corners)))
        self.refine(points, octaves)
        self.orient(points, octaves)
        return points

    def pyramid(self, image: np.ndarray, mask: np.ndarray | None = None) -> Iterator[Octave]:
        """The image, and smaller ones by `cv2.pyrDown`, as many as there are octaves and as the size allows."""
        yield Octave(image, mask)
        for _ in range(1, self.octaves):
            if min(image.shape) < 2 * SMALLEST_OCTAVE:
                return
            # Pixel (x, y) of the smaller image is centred on (2 x, 2 y) of the larger one.
            image = cv2.pyrDown(image)
            mask = None if mask is None else np.ascontiguousarray(mask[::2, ::2])
            yield Octave(image, mask)

    def harris_corners(self, image: np.ndarray, octave: int = 0, mask: np.ndarray | None = None,
                       search: Search | None = None) -> np.ndarray:
        """Corners of one octave: local maxima of the response above `minimum_response`, on whole pixels, no angle.

        Parameters
        ----------
        image : ndarray, uint8, shape (H, W)
            The octave's own image, 2**octave times smaller than the full one.
        octave : int
        mask : ndarray, uint8, shape (H, W), optional
        search : Search, optional
            What may be left out because it can't pass the filter; default: nothing.

        Returns
        -------
        ndarray of key_points.DTYPE, shape (N,)
            Positions and sizes in pixels of the full image, in reading order.
        """
        search = search or Search(self.minimum_response)
        h, largest = self._response(image, octave)
        for least in search.bounds(largest, is_a_corner=mask is None and self.border == 0):
            x, y = self._corners_above(least, h, mask)
            if search.are_enough(len(x)):
                break
        corners = key_points.empty(len(x))
        corners['x'], corners['y'] = x << octave, y << octave
        corners['size'] = self.window_size << octave
        corners['response'] = h.ravel().take(y * h.shape[1] + x)
        corners['octave'] = octave
        if octave + 1 < self.octaves:
            search.next_must_beat(corners['response'])
        return corners

    def filter(self, corners: np.ndarray) -> np.ndarray:
        """Those of the corners of all octaves that become key points, strongest or most widely spread first."""
        chosen, _ = self._chosen_filter()
        return chosen(corners)

    # `take` and not an index: NumPy picks whole records forty times as fast that way.

    def above_threshold(self, corners: np.ndarray) -> np.ndarray:
        """Corners above `threshold` times the largest response."""
        responses = corners['response']
        return corners.take(filters.above_threshold(responses, self.threshold, float(responses.max(initial=0))))

    def strongest(self, corners: np.ndarray) -> np.ndarray:
        """The `number_of_points` strongest corners."""
        return corners.take(filters.strongest(corners['response'], self.number_of_points))

    def adaptive_non_maximal_suppression(self, corners: np.ndarray) -> np.ndarray:
        """The `anms_points` corners with the largest suppression radius."""
        positions = np.column_stack((corners['x'], corners['y']))
        return corners.take(filters.adaptive_non_maximal_suppression(
            positions, corners['response'], self.anms_points, self.anms_robustness))

    def refine(self, points: np.ndarray, octaves: list[Octave]) -> None:
        """Move points to where the response of their octave is largest between the pixels, but not under the mask."""
        if not (self.local_maxima and self.subpixel):
            return
        mask = octaves[0].mask
        for octave, here in _by_octave(points, len(octaves)):
            h = _maps.of_octave(octave, octaves[octave].image.shape)
            x, y = (points[name][here].astype(np.int64) for name in 'xy')
            to_x, to_y = (moved * (1 << octave) for moved in maxima.refine(h, x >> octave, y >> octave))
            if mask is not None:
                allowed = mask[np.rint(to_y).astype(np.intp), np.rint(to_x).astype(np.intp)] != 0
                to_x, to_y = np.where(allowed, to_x, x), np.where(allowed, to_y, y)
            points['x'][here], points['y'][here] = to_x, to_y

    def orient(self, points: np.ndarray, octaves: list[Octave]) -> None:
        """Give each point the direction of the gradient in its octave, taken with the larger kernel."""
        for octave, here in _by_octave(points, len(octaves)):
            x, y = (points[name][here].astype(np.float64) / (1 << octave) for name in 'xy')
            points['angle'][here] = direction(*smoothed_gradient(octaves[octave].image, x, y, self.orientation_sigma))

    def response_map(self, image: np.ndarray) -> np.ndarray:
        """H of the full image."""
        return response.harris_response(as_grey(image), self.window_size, self.window, self.harris_k,
                                        self.derivative_sigma)

    def _response(self, image: np.ndarray, octave: int) -> tuple[np.ndarray, float]:
        """H of an octave's image, in a map that is valid until the thread's next image, and its largest value."""
        return response.response_and_maximum(image, self.window_size, self.window, self.harris_k,
                                             self.derivative_sigma, _maps.of_octave(octave, image.shape))

    def _corners_above(self, least: float, h: np.ndarray, mask: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """x and y in pixels of the octave, inside border and mask, in reading order."""
        x, y = (maxima.local_maxima if self.local_maxima else maxima.pixels_above)(h, least)
        if self.border > 0:
            inside = ((x >= self.border) & (x < h.shape[1] - self.border)
                      & (y >= self.border) & (y < h.shape[0] - self.border))
            x, y = x[inside], y[inside]
        if mask is not None:
            allowed = mask[y, x] != 0
            x, y = x[allowed], y[allowed]
        return x, y

    def _chosen_filter(self) -> tuple[Callable[[np.ndarray], np.ndarray], Search]:
        """The filter that the parameters choose, and a search that leaves out what it can't let pass."""
        if self.anms:
            return self.adaptive_non_maximal_suppression, Search(self.minimum_response)
        if self.fixed_number_of_points:
            return self.strongest, Search(self.minimum_response, number=self.number_of_points)
        return self.above_threshold, Search(self.minimum_response, threshold=self.threshold)


MOST_CORNERS = 250_000   # more than any use needs, and what takes half a second: the filter gets the strongest of more
SMALLEST_OCTAVE = 8   # pixels: no octave gets smaller than this to either side


class Octave(NamedTuple):
    """A level of the pyramid."""

    image: np.ndarray
    mask: np.ndarray | None


_maps = ResponseMaps()
_logger = logging.getLogger('rvc_features')


def _joined(corners: list[np.ndarray]) -> np.ndarray:
    """The corners of all octaves; as bytes, for NumPy joins records field by field."""
    if len(corners) == 1:
        return corners[0]
    return np.concatenate([of_octave.view(np.uint8) for of_octave in corners]).view(key_points.DTYPE)


def _at_most(count: int, corners: np.ndarray) -> np.ndarray:
    """The strongest `count` corners in the order in which they come; says so if there are more."""
    if len(corners) <= count:
        return corners
    reporter().say(_logger.warning, 'too many corners',
                   f'only the strongest {count:,} of {len(corners):,} corners are looked at; raise minimum_response '
                   'or set local_maxima')
    return corners.take(np.sort(filters.strongest(corners['response'], count)))


def _by_octave(points: np.ndarray, octaves: int) -> Iterator[tuple[int, np.ndarray | slice]]:
    """Each octave that has points, and where they are."""
    if octaves == 1:
        yield 0, slice(None)
        return
    for octave in range(octaves):
        here = np.flatnonzero(points['octave'] == octave)
        if len(here) > 0:
            yield octave, here
