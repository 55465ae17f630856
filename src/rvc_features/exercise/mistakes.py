"""The table of mistakes: each is the reference with one step written wrongly, and says what it is in its docstring.

Several ways to make the same mistake share its name. To add one, write the step and put `@mistake` before it: the
examiner compares what a solution finds with what each of these finds, and names the one that agrees.
"""

from __future__ import annotations

from typing import Callable, Mapping, Sequence

import cv2
import numpy as np

from rvc_features import filters
from rvc_features.exercise.reference import K, Reference

TABLE: dict[str, list[type[Reference]]] = {}      # the ways to make each mistake, by its name
LEGAL: list[type[Reference]] = []                 # what differs from the reference without being a mistake

# Where H has a unit, what is found depends on it: on what grey values, gradients or H itself are multiplied by.
_WEIGHTS = [{'trace_weight': 2.0 ** (exponent / 2)} for exponent in range(48)]     # of the trace beside its square
_UNITS = [{'response_unit': 2.0 ** exponent} for exponent in range(-16, 52)]


def mistake(name: str, units: Sequence[Mapping[str, float]] = ({},)) -> Callable[[type[Reference]], type[Reference]]:
    """Class decorator: a way to make the mistake of that name; `units` where it depends on the unit of something."""
    def add(way: type[Reference]) -> type[Reference]:
        way.name, way.units = name, tuple(units)
        TABLE.setdefault(name, []).append(way)
        return way
    return add


def no_mistake(name: str) -> Callable[[type[Reference]], type[Reference]]:
    """Class decorator: something that the sheet allows."""
    def add(way: type[Reference]) -> type[Reference]:
        way.name, way.units = name, ({},)
        LEGAL.append(way)
        return way
    return add


# ---- Exercise 1: the response ----

@mistake('trace not squared', _WEIGHTS)
class TraceNotSquared(Reference):
    """the trace is not squared: H = AC - B^2 - k (A + C), with or without the k; it is positive along edges as well"""

    trace_weight = 1.0

    def response(self, a, b, c):
        return a * c - b * b - K * self.trace_weight * (a + c)


@mistake('k forgotten')
class TraceForgotten(Reference):
    """k is forgotten, and the trace with it: H = AC - B^2, which is positive along edges as well"""

    def response(self, a, b, c):
        return a * c - b * b


@mistake('k forgotten or nothing averaged')
class TraceNotWeighed(Reference):
    """H is positive nowhere: k is forgotten, H = AC - B^2 - (A + C)^2, or A, B and C are not averaged"""

    def response(self, a, b, c):
        return a * c - b * b - (a + c) ** 2


@mistake('k of wrong sign')
class MoreTraceAdded(Reference):
    """k has the wrong sign: H = AC - B^2 + k (A + C)^2, which is large along edges"""

    def response(self, a, b, c):
        return a * c - b * b + 0.06 * (a + c) ** 2


@mistake('k of wrong sign')
class TraceAdded(Reference):
    """k has the wrong sign: H = AC - B^2 + k (A + C)^2, which is large along edges"""

    def response(self, a, b, c):
        return a * c - b * b + K * (a + c) ** 2


@mistake('B not averaged')
class ProductNotAveraged(Reference):
    """B is not averaged over the window (A and C are), so that diagonal edges respond on both sides"""

    def averages(self, i_x, i_y):
        return self.average(i_x * i_x), i_x * i_y, self.average(i_y * i_y)


@mistake('B not averaged')
class GradientsAveraged(Reference):
    """B is not averaged: it is the product of the averaged gradients, not the average of their product"""

    def averages(self, i_x, i_y):
        return self.average(i_x * i_x), self.average(i_x) * self.average(i_y), self.average(i_y * i_y)


@mistake('B not averaged or forgotten')
class ProductForgotten(Reference):
    """B is not averaged (or summed) over the window as A and C are, or forgotten: H is large along diagonal edges"""

    def response(self, a, b, c):
        return a * c - K * (a + c) ** 2


@mistake('gradients of a colour image')
class GradientsOfColours(Reference):
    """the gradients are those of a colour image: it is not made grey first, so that edges between colours count"""

    def planes(self, image):
        return [image] if image.ndim == 2 else cv2.split(image)


@mistake('gradients of a colour image')
class GradientsOfOneColour(GradientsOfColours):
    """the gradients are those of a colour image: of its blue or red channel alone, instead of the grey image"""

    def planes(self, image):
        return super().planes(image)[:1]


@mistake('gradients of a colour image')
class GradientsOfRed(GradientsOfColours):
    """the gradients are those of a colour image: of its blue or red channel alone, instead of the grey image"""

    def planes(self, image):
        return super().planes(image)[-1:]


# ---- Exercise 1: the key points ----

@mistake('x and y swapped')
class Swapped(Reference):
    """x and y are swapped: pt is (row, column) instead of (column, row)"""

    def position(self, x, y, octave):
        return super().position(y, x, octave)


@mistake('x and y swapped')
class SwappedBeforeMasking(Swapped):
    """x and y are swapped: pt is (row, column) instead of (column, row)"""

    def allowed(self, mask, x, y):
        if mask is None:
            return super().allowed(mask, x, y)
        return mask[np.minimum(x, mask.shape[0] - 1), np.minimum(y, mask.shape[1] - 1)] != 0


@mistake('no local maxima')
class EveryPixel(Reference):
    """no local maxima are taken: every pixel above the threshold is a key point, so that they come in clumps"""

    def candidates(self, h, minimum):
        y, x = np.nonzero(h > minimum)
        return x, y


@mistake('threshold absolute', _UNITS)
class ThresholdAbsolute(Reference):
    """the threshold is absolute instead of relative to H_max: H > threshold"""

    def cut(self, candidates):
        return self.threshold * self.response_unit


@mistake('threshold absolute', _UNITS)
class ThresholdAbsoluteAlone(ThresholdAbsolute):
    """the threshold is absolute instead of relative to H_max: H > threshold"""

    minimum_response = 0.0


@mistake('threshold absolute', _UNITS)
class ThresholdAbsoluteBesideMinimum(ThresholdAbsoluteAlone):
    """the threshold is absolute instead of relative to H_max: H > threshold"""

    def cut(self, candidates):
        return max(10.0, self.threshold) * self.response_unit


@mistake('threshold ignored', ({'response_unit': 0.0}, *_UNITS))
class ThresholdIgnored(Reference):
    """the threshold has no effect"""

    minimum_response = 0.0

    def cut(self, candidates):
        return 10.0 * self.response_unit


@mistake('mask ignored')
class MaskIgnored(Reference):
    """the mask is ignored"""

    def allowed(self, mask, x, y):
        return np.ones(len(x), bool)


@mistake('mask inverted')
class MaskInverted(Reference):
    """the mask is taken the other way round: key points lie where it is 0"""

    def allowed(self, mask, x, y):
        return np.ones(len(x), bool) if mask is None else mask[y, x] == 0


# ---- Exercise 2: a fixed number of points ----

@mistake('one fewer than asked')
class OneFewer(Reference):
    """one point fewer than asked for is returned"""

    def strongest(self, candidates):
        return super().strongest(candidates)[:self.number_of_points - 1]


@mistake('one fewer than asked')
class OneFewerSpread(Reference):
    """adaptive non-maximal suppression returns one point fewer than asked for"""

    def spread(self, candidates):
        return super().spread(candidates)[:self.anms_points - 1]


@mistake('one more than asked')
class OneMore(Reference):
    """one point more than asked for is returned"""

    def strongest(self, candidates):
        return candidates[filters.strongest(candidates['response'], self.number_of_points + 1)]


@mistake('unsorted')
class FirstInsteadOfStrongest(Reference):
    """the points are unsorted: the first ones in reading order are taken, not the strongest"""

    def strongest(self, candidates):
        return candidates[:self.number_of_points]


@mistake('unsorted')
class FirstInColumns(Reference):
    """the points are unsorted: the first ones, column by column, are taken, not the strongest"""

    def strongest(self, candidates):
        return candidates[np.lexsort((candidates['y'], candidates['x']))][:self.number_of_points]


@mistake('unsorted')
class StrongestUnsorted(Reference):
    """the points are unsorted: the right ones, but in reading order instead of strongest first"""

    def strongest(self, candidates):
        return candidates[np.sort(filters.strongest(candidates['response'], self.number_of_points))]


@mistake('sorted the wrong way round')
class WeakestFirst(Reference):
    """the points are sorted the wrong way round: the weakest are taken, not the strongest"""

    def strongest(self, candidates):
        return candidates[filters.strongest(-candidates['response'], self.number_of_points)]


@mistake('sorted the wrong way round')
class StrongestLast(Reference):
    """the points are sorted the wrong way round: the right ones, but weakest first"""

    def strongest(self, candidates):
        return super().strongest(candidates)[::-1]


@mistake('sorted the wrong way round')
class EverythingWeakestFirst(WeakestFirst):
    """the points are sorted the wrong way round, weakest first, and all that builds on their order goes wrong"""

    def cut(self, candidates):
        return self.threshold * float(candidates['response'].min(initial=np.inf))

    def spread(self, candidates):
        return candidates[filters.strongest(-candidates['response'], self.anms_points)]


@mistake('the strongest lost')
class StrongestLost(Reference):
    """the strongest point is lost: the fixed number begins with the second"""

    def strongest(self, candidates):
        return candidates[filters.strongest(candidates['response'], self.number_of_points + 1)][1:]


@mistake('the strongest lost')
class FirstLost(Reference):
    """the strongest point is lost: the first of the sorted points is left out"""

    def strongest(self, candidates):
        return super().strongest(candidates)[1:]
