"""HarrisDetector: octaves, strength, local maxima, filter, position, orientation (exercises 1 and 2, end to end)."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Callable, ClassVar

import numpy as np

from rvc_features import filters, key_points, maxima, ranked_corners, response, two_scales
from rvc_features.brief import reporter
from rvc_features.feature_detector import FeatureDetector, as_grey
from rvc_features.octaves import Octave, compete, in_layers, joined, merged, number_for_extractors, pyramid, rounded
from rvc_features.orientation import direction_of_scales, orient_along_gradient
from rvc_features.oriented_corners import strongest_oriented
from rvc_features.parameters import Choice, Flag, Integer, Real, parameter
from rvc_features.search import ResponseMaps, Search


@dataclass(frozen=True)
class HarrisDetector(FeatureDetector):
    """Corners after Harris and Stephens, in several octaves, with a direction.

    The defaults are those of the preset `repeatable`: strong is a corner that two scales agree on (two_scales.py), and
    it is ranked by its strength's rise above what lies round it (`maxima.rise`), beside the contrast there. With
    `strength='harris'`, `evenness=0`, as in the preset `course`, it is the exercise sheet's detector: strength and rank
    are the Harris response H.

    A key point is a local maximum of the strength that passes one of three filters, each applied to the corners of all
    octaves together: `anms` if set, else the strongest `number_of_points` with `fixed_number_of_points`, else those
    above `threshold` times the largest one.

    `KeyPoint.pt` and `.size` are in pixels of the full image whatever the octave; `.size` is the side of the window,
    `.response` is what points are ranked by, `.octave` counts from 0; with `octave_layers` it tells octave and layer as
    ORB and SIFT read it (`octaves.number_for_extractors`).

    Its parameters are the fields below; range and meaning stand with each, and `parameters.specifications` lists them.

    Raises
    ------
    TypeError, ValueError
        For a value that is not accepted, with its name, what was given and what is accepted.

    Examples
    --------
    >>> image = np.zeros((60, 80), np.uint8)
    >>> image[20:40, 30:60] = 200
    >>> detector = HarrisDetector(strength='harris', evenness=0.0, window_size=3, threshold=0.1, subpixel=False)
    >>> sorted(point.pt for point in detector.detect(image))
    [(30.0, 20.0), (30.0, 39.0), (59.0, 20.0), (59.0, 39.0)]
    """

    name: ClassVar[str] = 'harris'

    window_size: int = parameter(5, response.WINDOW_SIZE)
    window: str = parameter('gaussian', response.WINDOW)
    threshold: float = parameter(0.05, Real(
        'Least rank of a point as a share of the largest one in the image.', 0, 1))
    fixed_number_of_points: bool = parameter(False, Flag(
        'Take the strongest number_of_points instead of all above the threshold.'))
    number_of_points: int = parameter(500, Integer(
        'How many points fixed_number_of_points takes at the most.', 0))
    octaves: int = parameter(1, Integer(
        'Levels of the image pyramid; each has half the size of the one before.', 1, 10))
    anms: bool = parameter(False, filters.ANMS)
    anms_points: int = parameter(500, filters.ANMS_POINTS)
    anms_robustness: float = parameter(0.9, filters.ANMS_ROBUSTNESS)
    anms_pool: float = parameter(4.0, filters.ANMS_POOL)
    strength: str = parameter('two_scales', Choice(
        'What a corner is strong by: two_scales, agreement of two scales, or harris, the response H of the sheet.',
        ('two_scales', 'harris')))
    evenness: float = parameter(0.35, Real(
        'Rank by strength over local contrast to the power of twice this: 0 takes the strongest, 1 spreads most.',
        0, 1))
    minimum_contrast: float = parameter(0.0, Real(
        'Least step at a corner in grey values, with two_scales; the noise of the image is kept out in any case.',
        0, 255))
    minimum_response: float = parameter(10.0, Real(
        'Least response H whatever the image, with harris: keeps noise in flat images out.', 0))
    harris_k: float = parameter(0.04, response.HARRIS_K)
    derivative_sigma: float = parameter(0.0, response.DERIVATIVE_SIGMA)
    merge_octaves: bool = parameter(True, Flag(
        'One point for each corner, however many octaves show it; with two_scales.'))
    octave_layers: int = parameter(1, Integer(
        'Key points of each corner and octave, at sizes evenly up to the next octave, for descriptors.', 1, 8))
    local_maxima: bool = parameter(True, Flag(
        'Take only local maxima of the strength; without, every pixel that passes is a point.'))
    subpixel: bool = parameter(True, Flag(
        'Refine the position of local maxima between the pixels.'))
    border: int = parameter(4, Integer(
        'Width in pixels of a rim of each octave in which no point is taken.', 0))
    orientation_sigma: float = parameter(1.6, Real(
        'Size of the larger kernel for the orientation: standard deviation in pixels of the octave; with two_scales, '
        'also kernels of two, four and eight times that size.', 0.1, 50))
    shape_adaptation: bool = parameter(True, Flag(
        'Let directions stay on the surface when it tilts, by the structure tensor round the point; without, they are '
        'the gradients\', which turn descriptors better. With two_scales.'))

    def detect_impl(self, image: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
        """Corners of every octave, one filter over all of them together, then the direction of those left."""
        _, search = self._chosen_filter()
        if self._takes_one_call(image, search):
            return strongest_oriented(image, self.window_size, self.harris_k, self.minimum_response, self.border, mask,
                                      self.number_of_points, self.orientation_sigma)
        octaves = list(pyramid(image, mask, self.octaves, exact=self.strength == 'two_scales'))
        filtered_first = not (self.anms or self._octaves_compete())   # by responses: what doesn't pass is not refined
        corners = []
        for octave, (of_octave, its_mask) in enumerate(octaves):
            found = self.harris_corners(of_octave, octave, its_mask, search)
            if filtered_first:
                found = self.filter(found)
            self.refine(found, octave, of_octave.shape, mask)
            corners.append(found)
        points = self.join(corners)
        if not (filtered_first and points is corners[0]):
            points = self.filter(points)
        self.orient(points, octaves)
        if self.octave_layers > 1:
            number_for_extractors(points, self._size(), image.shape)
        return points

    def harris_corners(self, image: np.ndarray, octave: int = 0, mask: np.ndarray | None = None,
                       search: Search | None = None) -> np.ndarray:
        """Corners of one octave: local maxima of the strength, ranked, on whole pixels, without angle.

        Parameters
        ----------
        image : ndarray, uint8 or float32, shape (H, W)
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
        search = search or Search()
        if self.evenness > 0 and self.local_maxima:
            x, y, ranks = self._ranked_of_map(image, octave, mask, search)
        elif self._needs_no_map(image, search):
            x, y, ranks = response.corners(image, self.harris_k, self.border, mask,
                                           *search.wanted(self.minimum_response))
        else:
            x, y, ranks = self._corners_of_map(image, octave, mask, search)
            if self.evenness > 0:
                x, y, ranks = ranked_corners.ranked(image, x, y, ranks, ranks, self.evenness, self._least_of_energy())
        if self._octaves_compete():
            ranks = compete(ranks, image.size)
        corners = key_points.of_corners(x, y, ranks, self._size(), octave)
        if octave + 1 < self.octaves:
            search.next_must_beat(corners['response'])
        return corners

    def refine(self, corners: np.ndarray, octave: int, shape: tuple[int, ...], mask: np.ndarray | None) -> None:
        """Move an octave's corners to where its strength is largest between the pixels, but not under the full mask."""
        if not (self.local_maxima and self.subpixel):
            return
        x, y = (corners[name].astype(np.int64) for name in 'xy')
        to_x, to_y = (moved * (1 << octave) for moved in
                      maxima.refine(_maps.of_octave(octave, shape), x >> octave, y >> octave))
        if mask is not None:
            allowed = mask[np.rint(to_y).astype(np.intp), np.rint(to_x).astype(np.intp)] != 0
            to_x, to_y = np.where(allowed, to_x, x), np.where(allowed, to_y, y)
        corners['x'], corners['y'] = to_x, to_y

    def join(self, corners: list[np.ndarray]) -> np.ndarray:
        """The corners of all octaves, or the strongest MOST_CORNERS of them; each but once if they are to be merged."""
        if self._octaves_compete() and self.merge_octaves:
            together = merged(corners, self.anms_points if self.anms else self.number_of_points)
        else:
            together = joined(corners)
        if self.octave_layers > 1:
            together = in_layers(together, self.octave_layers)
        if len(together) <= MOST_CORNERS:
            return together
        reporter().say(_logger.warning, 'too many corners',
                       f'only the strongest {MOST_CORNERS:,} of {len(together):,} or more corners are looked at; raise '
                       'minimum_response or minimum_contrast, or set local_maxima')
        return together.take(np.sort(filters.strongest(together['response'], MOST_CORNERS)))

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
        return key_points.strongest(corners, self.number_of_points)

    def adaptive_non_maximal_suppression(self, corners: np.ndarray) -> np.ndarray:
        """The `anms_points` corners of largest suppression radius, out of the strongest `anms_pool` times that."""
        return filters.most_spread(corners, self.anms_points, self.anms_robustness, self.anms_pool)

    def orient(self, points: np.ndarray, octaves: list[Octave]) -> None:
        """Give each point the direction of the gradient in its octave, taken with the larger kernel."""
        for octave, (image, _) in enumerate(octaves):
            if self.strength == 'harris':
                orient_along_gradient(points, image, octave, self.orientation_sigma)
            else:
                here = slice(None) if len(octaves) == 1 else np.flatnonzero(points['octave'] == octave)
                x, y = (points[name][here] / (1 << octave) for name in 'xy')
                points['angle'][here] = direction_of_scales(rounded(image), x, y, self.orientation_sigma,
                                                            self.shape_adaptation)

    def pyramid_levels(self, points: np.ndarray) -> np.ndarray:
        """The octave of each point, from its size where `octave` tells the layer, too."""
        if self.octave_layers == 1:
            return points['octave']
        return np.floor(np.log2(points['size'] / self._size()) + _LEAST_LAYER / 2).astype(np.int32)

    def response_map(self, image: np.ndarray) -> np.ndarray:
        """Strength of every pixel of the full image."""
        grey = as_grey(image)
        if self.strength == 'two_scales':
            return two_scales.two_scale_strength(grey, self.window_size, self.window)
        return response.harris_response(grey, self.window_size, self.window, self.harris_k, self.derivative_sigma)

    def _strength(self, image: np.ndarray, octave: int) -> tuple[np.ndarray, float]:
        """Strength of an octave's pixels, in a map that is valid until the thread's next image; its largest value."""
        out = _maps.of_octave(octave, image.shape)
        if self.strength == 'two_scales':
            return two_scales.strength_and_maximum(image, self.window_size, self.window, out)
        return response.response_and_maximum(image, self.window_size, self.window, self.harris_k,
                                             self.derivative_sigma, out)

    def _takes_one_call(self, image: np.ndarray, search: Search) -> bool:
        """Whether one compiled call does it all: the strongest corners of one octave, without a map."""
        return (self.fixed_number_of_points and max(self.octaves, self.octave_layers) == 1
                and self.number_of_points <= MOST_CORNERS and self._needs_no_map(image, search))

    def _needs_no_map(self, image: np.ndarray, search: Search) -> bool:
        """Whether an octave's corners, on whole pixels, are found without a map of the strength."""
        return (search.leaves_out and self.strength == 'harris' and self.local_maxima and not self.subpixel
                and response.needs_no_map(image, self.window_size, self.window, self.harris_k, self.derivative_sigma))

    def _corners_of_map(self, image: np.ndarray, octave: int, mask: np.ndarray | None,
                        search: Search) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x and y of the corners in pixels of the octave, and their strength, by a map of it."""
        strength, largest = self._strength(image, octave)
        minimum = self._minimum(strength, largest, search, image, octave)
        for least in search.bounds(minimum, largest, is_a_corner=mask is None and self.border == 0):
            x, y = self._corners_above(least, strength, mask)
            if search.are_enough(len(x)):
                break
        return x, y, strength.ravel().take(y * strength.shape[1] + x)

    def _ranked_of_map(self, image: np.ndarray, octave: int, mask: np.ndarray | None,
                       search: Search) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x and y of local maxima in pixels of the octave, and their rank."""
        strength, largest = self._strength(image, octave)
        minimum = self._minimum(strength, largest, search, image, octave)
        return ranked_corners.ranked_corners(image, strength, minimum, self.border, mask, self.evenness,
                                             self._least_of_energy(), search.share_of_ranks)

    def _least_of_energy(self) -> float:
        """What is weaker beside the energy round it is no corner, as are the steps of a slanted edge in a drawing."""
        if self.strength == 'harris':
            return 0.0
        return two_scales.LEAST_OF_ENERGY_SPREAD if self.anms else two_scales.LEAST_OF_ENERGY

    def _minimum(self, strength: np.ndarray, largest: float, search: Search, image: np.ndarray, octave: int) -> float:
        """What the strength of a corner must exceed in any case."""
        if self.strength == 'harris':
            return self.minimum_response
        if search.is_noise(strength, largest):
            return largest   # which nothing exceeds
        return two_scales.least_strength(self.minimum_contrast, search.noise(image, octave), largest)

    def _size(self) -> int:
        """Side in pixels of what is looked at for one point."""
        return self.window_size if self.strength == 'harris' else 2 * self.window_size - 1

    def _corners_above(self, least: float, strength: np.ndarray,
                       mask: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """x and y in pixels of the octave, inside border and mask, in reading order."""
        x, y = (maxima.local_maxima(strength, least) if self.local_maxima
                else maxima.pixels_above(strength, least, 4 * MOST_CORNERS))   # as they may rank otherwise
        return ranked_corners.inside(x, y, strength.shape, self.border, mask)

    def _octaves_compete(self) -> bool:
        """Whether responses of several octaves are made comparable; the sheet takes H as it is."""
        return self.octaves > 1 and self.strength == 'two_scales'

    def _chosen_filter(self) -> tuple[Callable[[np.ndarray], np.ndarray], Search]:
        """The filter that the parameters choose, and a search that leaves out what it can't let pass."""
        is_rank = self.evenness == 0 and not self._octaves_compete()   # strength: then it tells who passes
        if self.anms:
            return self.adaptive_non_maximal_suppression, Search()
        if self.fixed_number_of_points:
            return self.strongest, Search(number=self.number_of_points) if is_rank else Search()
        if is_rank:
            return self.above_threshold, Search(threshold=self.threshold)
        return self.above_threshold, Search(share_of_ranks=0.0 if self._octaves_compete() else self.threshold)


MOST_CORNERS = 250_000   # more than any use needs, and what takes half a second: the filter gets the strongest of more
_LEAST_LAYER = 1 / 8     # octaves between two layers

_maps = ResponseMaps()
_logger = logging.getLogger('rvc_features')
