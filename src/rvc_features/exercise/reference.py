"""The exercise sheet's detector in steps, for `mistakes` to replace one of them: slow and plain on purpose.

What it finds is what `HarrisDetector` finds with whole pixels; a test holds that. Every method below is one step of the
sheet, and a mistake is this class with one method written wrongly.
"""

from __future__ import annotations

from typing import ClassVar, Mapping, Sequence

import cv2
import numpy as np

from rvc_features import filters, key_points, maxima
from rvc_features.orientation import direction, reference_gradients
from rvc_features.response import BORDER, window_average

K = 0.04
ROBUSTNESS = 0.9              # c_r of adaptive non-maximal suppression
_ORIENTATION_SIGMA = 2.5


class Reference:
    """A Harris detector with the sheet's parameters.

    The class attributes are what the sheet leaves open: solutions take gradients, weigh the window and drop noise as
    they like. That changes no point that counts, unless a mistake is in.
    """

    name: ClassVar[str] = ''                                   # of the mistake that is in
    units: ClassVar[tuple[Mapping[str, float], ...]] = ({},)    # what it depends on, where that has a unit
    sobel = True                    # or central differences
    window = 'gaussian'             # or 'box', or 'narrow': a Gaussian of a sixth of the window
    neighbourhood = 3               # pixels in which a local maximum is the largest
    minimum_response = 10.0
    threshold_first = False         # whether the other two filters get only what is above the threshold
    response_unit = 1.0             # of the response, where a threshold is compared with it

    def __init__(self, window_size: int = 5, threshold: float = 0.01, fixed_number_of_points: bool = False,
                 number_of_points: int = 500, octaves: int = 1, anms: bool = False, anms_points: int = 500) -> None:
        self.window_size = window_size
        self.threshold = threshold
        self.fixed_number_of_points = fixed_number_of_points
        self.number_of_points = number_of_points
        self.octaves = octaves
        self.anms = anms
        self.anms_points = anms_points

    def detect(self, image: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
        """Key points of a grey or BGR image as an array of `key_points.DTYPE`, in the order the detector gives."""
        return self.choose(self.all_candidates(image, mask))

    def all_candidates(self, image: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
        """The candidates of every octave."""
        planes = self.planes(image)
        candidates = []
        for octave in range(self.octaves):
            if octave > 0:
                planes = [cv2.pyrDown(plane) for plane in planes]
                mask = None if mask is None else np.ascontiguousarray(mask[::2, ::2])
            candidates.append(self.harris_corners(planes, octave, mask))
        return np.concatenate(candidates)

    def planes(self, image: np.ndarray) -> Sequence[np.ndarray]:
        """What the gradients are taken of: the grey image."""
        return [image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)]

    def harris_corners(self, planes: Sequence[np.ndarray], octave: int, mask: np.ndarray | None) -> np.ndarray:
        """Candidates of one octave, in reading order."""
        h = np.sum([self.response(*self.averages(*self.gradients(plane))) for plane in planes], axis=0)
        x, y = self.candidates(h.astype(np.float32), self.minimum_response)
        allowed = self.allowed(mask, x, y)
        x, y = x[allowed], y[allowed]
        found = key_points.empty(len(x))
        found['angle'] = self.angle(*reference_gradients(planes[0], x, y, _ORIENTATION_SIGMA))
        found['x'], found['y'] = self.position(x, y, octave)
        found['size'] = self.size(octave)
        found['response'], found['octave'] = h[y, x], octave
        return found

    def gradients(self, plane: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """I_x and I_y."""
        values = plane.astype(np.float64)
        if not self.sobel:
            i_y, i_x = np.gradient(values)
            return i_x, i_y
        return (cv2.Sobel(values, cv2.CV_64F, 1, 0, ksize=3, borderType=BORDER),
                cv2.Sobel(values, cv2.CV_64F, 0, 1, ksize=3, borderType=BORDER))

    def averages(self, i_x: np.ndarray, i_y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A, B and C: I_x^2, I_x I_y and I_y^2 over the window."""
        return self.average(i_x * i_x), self.average(i_x * i_y), self.average(i_y * i_y)

    def average(self, values: np.ndarray) -> np.ndarray:
        """Over the window round each pixel."""
        if self.window == 'narrow':
            side = (self.window_size, self.window_size)
            return cv2.GaussianBlur(values, side, self.window_size / 6, borderType=BORDER)
        return window_average(values, self.window_size, self.window)

    def response(self, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        """H."""
        return a * c - b * b - K * (a + c) ** 2

    def candidates(self, h: np.ndarray, minimum: float) -> tuple[np.ndarray, np.ndarray]:
        """x and y of local maxima, pixels of the octave."""
        x, y = maxima.reference_local_maxima(h, minimum)
        largest = cv2.dilate(h, np.ones((self.neighbourhood, self.neighbourhood), np.uint8))[y, x] <= h[y, x]
        return x[largest], y[largest]

    def allowed(self, mask: np.ndarray | None, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Which of the pixels the mask lets through."""
        return np.ones(len(x), bool) if mask is None else mask[y, x] != 0

    def position(self, x: np.ndarray, y: np.ndarray, octave: int) -> tuple[np.ndarray, np.ndarray]:
        """Pixels of the octave as pixels of the full image."""
        return x * 2 ** octave, y * 2 ** octave

    def size(self, octave: int) -> float:
        """Side of the window in pixels of the full image."""
        return self.window_size * 2 ** octave

    def angle(self, gradient_x: np.ndarray, gradient_y: np.ndarray) -> np.ndarray:
        """OpenCV's: degrees, clockwise from +x as the image is seen."""
        return direction(gradient_x, gradient_y)

    def choose(self, candidates: np.ndarray) -> np.ndarray:
        """One of the three filters over the candidates of all octaves."""
        if self.threshold_first:
            candidates = candidates[candidates['response'].astype(np.float64) > self.cut(candidates)]
        if self.anms:
            return self.spread(candidates)
        if self.fixed_number_of_points:
            return self.strongest(candidates)
        return self.above_threshold(candidates)

    def above_threshold(self, candidates: np.ndarray) -> np.ndarray:
        """Those above the cut, strongest first."""
        passing = candidates[candidates['response'].astype(np.float64) > self.cut(candidates)]
        return passing[filters.reference_order(passing['response'])]

    def cut(self, candidates: np.ndarray) -> float | np.ndarray:
        """What a response must exceed."""
        return self.threshold * float(candidates['response'].max(initial=0))

    def strongest(self, candidates: np.ndarray) -> np.ndarray:
        """The strongest `number_of_points`, strongest first."""
        return candidates[filters.strongest(candidates['response'], self.number_of_points)]

    def spread(self, candidates: np.ndarray) -> np.ndarray:
        """Adaptive non-maximal suppression: those of largest radius."""
        radii = self.radii(candidates)
        return candidates[np.lexsort((-candidates['response'], -radii))[:self.anms_points]]

    def radii(self, candidates: np.ndarray) -> np.ndarray:
        """Distance to the nearest candidate that suppresses, infinite for the one that none suppresses."""
        distance = np.hypot(*(candidates[axis][:, None] - candidates[axis] for axis in 'xy'))
        distance[~self.suppresses(candidates['response'].astype(np.float64))] = np.inf
        return distance.min(axis=1, initial=np.inf)

    def suppresses(self, strength: np.ndarray) -> np.ndarray:
        """Whether candidate j (column) suppresses candidate i (row)."""
        return strength[:, None] < ROBUSTNESS * strength
