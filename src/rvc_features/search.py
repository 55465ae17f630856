"""What makes the search for corners fast: what can't pass the filter isn't looked for, and maps serve again.

Nothing here changes what a detector finds. Without it every local maximum above the least response would be listed,
tens of thousands in a large image, for the filter to drop.
"""

from __future__ import annotations

import threading
from typing import Iterator

import numpy as np

from rvc_features import contrast, two_scales

MOSTLY_ENOUGH = 0.002   # of the largest response: where the strongest points are sought first


class Search:
    """Bounds for the corners of one image, octave after octave; by default nothing is left out.

    Parameters
    ----------
    threshold : float, optional
        Only those above this share of the largest response of all octaves will pass.
    number : int, optional
        Only so many of the strongest will pass.
    share_of_ranks : float
        Only those will pass that rank above this share of what the best one does, where that is not their response.
    """

    def __init__(self, threshold: float | None = None, number: int | None = None, share_of_ranks: float = 0.0) -> None:
        self._threshold, self._number, self.share_of_ranks = threshold, number, share_of_ranks
        self._to_beat = 0.0
        self._noise: float | None = None
        self._is_noise: bool | None = None

    def noise(self, image: np.ndarray, octave: int) -> float:
        """Noise of an octave, in grey values: measured in the first one, and half of it in each that follows."""
        if self._noise is None:
            self._noise = contrast.noise(image) * 2 ** octave
        return self._noise / 2 ** octave

    def is_noise(self, strength: np.ndarray, largest: float) -> bool:
        """Whether there is nothing but noise, as the first octave tells: in coarse ones fine texture is noise, too."""
        if self._is_noise is None:
            self._is_noise = two_scales.is_noise(strength, largest)
        return self._is_noise

    def bounds(self, minimum: float, largest: float, is_a_corner: bool) -> Iterator[float]:
        """What a response must exceed: to be tried one after the other until there are enough corners.

        Parameters
        ----------
        minimum : float
            What corners must exceed in any case.
        largest : float
            Largest response of the octave.
        is_a_corner : bool
            Whether that one is sure to be listed; a mask might leave it out.
        """
        if self._threshold is not None and is_a_corner:
            # A little below the threshold, for the map is in single precision; the filter decides.
            yield max(minimum, (1 - 1e-6) * self._threshold * largest)
        elif self._number is not None and self._to_beat == 0:
            # Mostly there are enough far above the least; then there is no need of the many weak ones.
            yield max(minimum, MOSTLY_ENOUGH * largest)
            yield minimum
        else:
            yield max(minimum, self._to_beat)

    @property
    def leaves_out(self) -> bool:
        """Whether not all corners are wanted."""
        return self._threshold is not None or self._number is not None

    def wanted(self, minimum: float) -> tuple[float, int | None, float]:
        """The same as a response to exceed, a number of strongest and a share of the largest."""
        # A little below the threshold, for responses are in single precision; the filter decides.
        share = 0.0 if self._threshold is None else (1 - 1e-6) * self._threshold
        return max(minimum, self._to_beat), self._number, share

    def are_enough(self, corners: int) -> bool:
        """Whether that many corners make it needless to look for weaker ones."""
        return self._number is not None and corners >= self._number

    def next_must_beat(self, responses: np.ndarray) -> None:
        """Note the corners of an octave: those to come must exceed the last of the strongest `number` of them."""
        if self._number is not None and 0 < self._number <= len(responses):
            self._to_beat = float(np.partition(responses, -self._number)[-self._number])


class ResponseMaps(threading.local):
    """Response maps that serve image after image, for fresh memory costs more than the arithmetic; one set a thread."""

    def __init__(self) -> None:
        self._maps: dict[int, np.ndarray] = {}

    def of_octave(self, octave: int, shape: tuple[int, ...]) -> np.ndarray:
        """A map of that shape, float32; what it holds is overwritten with the thread's next image."""
        if octave not in self._maps or self._maps[octave].shape != shape:
            self._maps[octave] = np.empty(shape, np.float32)
        return self._maps[octave]
