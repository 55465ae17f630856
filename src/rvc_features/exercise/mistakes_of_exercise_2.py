"""More of the table of `mistakes`: octaves, adaptive non-maximal suppression, orientation, and unused parameters."""

from __future__ import annotations

import numpy as np

from rvc_features.exercise.mistakes import mistake, no_mistake
from rvc_features.exercise.reference import ROBUSTNESS, Reference

# ---- Octaves ----


@mistake('H_max taken per octave')
class MaximumPerOctave(Reference):
    """H_max is taken per octave instead of over all of them"""

    def cut(self, candidates):
        octaves = np.unique(candidates['octave'])
        cuts = {octave: super(MaximumPerOctave, self).cut(candidates[candidates['octave'] == octave])
                for octave in octaves}
        return np.array([cuts[octave] for octave in candidates['octave']])


@mistake('coordinates not scaled back')
class PositionNotScaled(Reference):
    """the octave's coordinates are not scaled back to the full image"""

    def position(self, x, y, octave):
        return super().position(x, y, 0)


@mistake('coordinates scaled wrongly')
class PositionScaledByOctave(Reference):
    """the octave's coordinates are scaled by the wrong factor: it is 2^octave"""

    def position(self, x, y, octave):
        return super().position(x, y, min(octave, 1))


@mistake('coordinates scaled wrongly')
class PositionScaledTooMuch(Reference):
    """the octave's coordinates are scaled by the wrong factor: 4^octave instead of 2^octave"""

    def position(self, x, y, octave):
        return super().position(x, y, 2 * octave)


@mistake('sizes not scaled back')
class SizeNotScaled(Reference):
    """the octave's sizes are not scaled back to the full image"""

    def size(self, octave):
        return super().size(0)


@mistake('coordinates and sizes not scaled back')
class NothingScaled(PositionNotScaled, SizeNotScaled):
    """the octave's coordinates and sizes are not scaled back to the full image"""


@mistake('octave not set')
class OctaveNotSet(Reference):
    """the key points don't tell their octave: it is the same for all"""

    def choose(self, candidates):
        chosen = super().choose(candidates)
        chosen['octave'] = 0
        return chosen


# ---- Adaptive non-maximal suppression ----

@mistake('ANMS on unsorted points')
class RadiiInReadingOrder(Reference):
    """ANMS works on unsorted points: each is compared with those before it, which are not the stronger ones"""

    def suppresses(self, strength):
        return np.tri(len(strength), k=-1, dtype=bool)


@mistake('ANMS on unsorted points')
class RadiiInReadingOrderOfStronger(Reference):
    """ANMS works on unsorted points: each is compared only with those before it, and stronger ones come after"""

    def suppresses(self, strength):
        return super().suppresses(strength) & np.tri(len(strength), k=-1, dtype=bool)


@mistake('ANMS on unsorted points')
class FirstInReadingOrderOfStronger(RadiiInReadingOrderOfStronger):
    """ANMS works on unsorted points: each is compared only with those before it, and stronger ones come after"""

    def spread(self, candidates):
        return candidates[np.argsort(-self.radii(candidates), kind='stable')[:self.anms_points]]


@mistake('ANMS on unsorted points')
class RadiiUnsorted(Reference):
    """ANMS returns the points unsorted by radius: the first ones of the list, not those of largest radius"""

    def spread(self, candidates):
        return candidates[:self.anms_points]


@mistake('c_r on the wrong side')
class RobustnessOnTheWrongSide(Reference):
    """c_r is on the wrong side: c_r f_i < f_j instead of f_i < c_r f_j, so that points of equal strength suppress"""

    def suppresses(self, strength):
        others = ~np.eye(len(strength), dtype=bool)
        return (ROBUSTNESS * strength[:, None] < strength) & others


@mistake('c_r on the wrong side or forgotten')
class AnyStrongerSuppresses(Reference):
    """c_r is on the wrong side, or forgotten: any stronger point suppresses, instead of those with f_i < c_r f_j"""

    def suppresses(self, strength):
        return strength[:, None] < strength


@mistake('ANMS: the weaker suppress')
class WeakerSuppress(Reference):
    """ANMS has the comparison the wrong way round: the weaker points suppress the stronger ones"""

    def suppresses(self, strength):
        return super().suppresses(strength).T


@mistake('the strongest lost')
class StrongestLostBySpreading(Reference):
    """the strongest point is lost: its suppression radius must be infinite"""

    def radii(self, candidates):
        radii = super().radii(candidates)
        radii[np.argmax(candidates['response'])] = 0
        return radii


@mistake('ANMS: smallest radii')
class SmallestRadii(Reference):
    """ANMS takes the points of smallest suppression radius, not of largest"""

    def radii(self, candidates):
        return -super().radii(candidates)


@mistake('ANMS has no effect')
class StrongestInsteadOfSpread(Reference):
    """ANMS has no effect: the strongest points come, not those spread over the image"""

    def spread(self, candidates):
        return candidates[np.argsort(-candidates['response'], kind='stable')[:self.anms_points]]


# ---- Orientation ----

@no_mistake('the sheet\'s own formula')
class SheetAngle(Reference):
    """theta = arctan(I_x / I_y), the sheet's own formula: 90 degrees minus OpenCV's angle, which is no mistake"""

    def angle(self, gradient_x, gradient_y):
        return super().angle(gradient_y, gradient_x)


@no_mistake('no angle')
class NoAngle(Reference):
    """no angle is given"""

    def angle(self, gradient_x, gradient_y):
        return np.full(len(gradient_x), -1.0)


@mistake('angle mirrored')
class AngleMirrored(Reference):
    """the angle is mirrored: it counts against the clock as the image is seen, for y points down"""

    def angle(self, gradient_x, gradient_y):
        return super().angle(gradient_x, -gradient_y)


@mistake('angle mirrored')
class AngleMirroredSideways(Reference):
    """the angle is mirrored: I_x has the wrong sign"""

    def angle(self, gradient_x, gradient_y):
        return super().angle(-gradient_x, gradient_y)


@mistake('angle by atan instead of atan2')
class AngleByAtan(Reference):
    """the angle comes from atan instead of atan2: opposite directions can't be told apart"""

    def angle(self, gradient_x, gradient_y):
        return np.degrees(np.arctan(gradient_y / np.where(gradient_x == 0, 1e-12, gradient_x)))


@mistake('angle by atan instead of atan2')
class SheetAngleByAtan(AngleByAtan):
    """the angle comes from atan instead of atan2, in the sheet's formula: opposite directions can't be told apart"""

    def angle(self, gradient_x, gradient_y):
        return super().angle(gradient_y, gradient_x)


@mistake('angle by atan instead of atan2')
class AngleByFoldedAtan(AngleByAtan):
    """the angle comes from atan instead of atan2: opposite directions can't be told apart"""

    def angle(self, gradient_x, gradient_y):
        return super().angle(gradient_x, gradient_y) % 180


@mistake('angle in radians')
class AngleInRadians(Reference):
    """the angle is in radians instead of degrees"""

    def angle(self, gradient_x, gradient_y):
        return np.arctan2(gradient_y, gradient_x)


@mistake('angle in radians')
class SheetAngleInRadians(AngleInRadians):
    """the angle is in radians instead of degrees, by the sheet's formula"""

    def angle(self, gradient_x, gradient_y):
        return super().angle(gradient_y, gradient_x)


@mistake('angle 90 degrees off')
class AngleAcross(Reference):
    """the angle is 90 degrees off: it lies along the edge (the sheet's own formula, 90 degrees minus the angle, would
    be no mistake)"""

    def angle(self, gradient_x, gradient_y):
        return super().angle(-gradient_y, gradient_x)


@mistake('angle 90 degrees off')
class AngleAcrossBackwards(Reference):
    """the angle is 90 degrees off: it lies along the edge, backwards (the sheet's own formula, 90 degrees minus the
    angle, would be no mistake)"""

    def angle(self, gradient_x, gradient_y):
        return super().angle(gradient_y, -gradient_x)


@mistake('angle 180 degrees off')
class AngleBackwards(Reference):
    """the angle is 180 degrees off: the gradient points from light to dark"""

    def angle(self, gradient_x, gradient_y):
        return super().angle(-gradient_x, -gradient_y)


@mistake('angle 180 degrees off')
class SheetAngleBackwards(AngleBackwards):
    """the angle, by the sheet's formula, is 180 degrees off: the gradient points from light to dark"""

    def angle(self, gradient_x, gradient_y):
        return super().angle(gradient_y, gradient_x)


@mistake('same angle everywhere')
class AngleConstant(Reference):
    """the angle is the same at every point"""

    def angle(self, gradient_x, gradient_y):
        return np.full(len(gradient_x), super().angle(np.ones(1), np.ones(1))[0])


# ---- Parameters that are taken, and do nothing ----

def _ignoring(parameter: str, value: object) -> type[Reference]:
    def construct(self, **given):
        Reference.__init__(self, **{**given, parameter: value})

    text = f'{parameter} has no effect'
    return mistake(text)(type(f'{parameter}_ignored', (Reference,), {'__init__': construct, '__doc__': text}))


for _parameter, _value in (('window_size', 5), ('octaves', 1), ('fixed_number_of_points', False), ('anms', False)):
    _ignoring(_parameter, _value)
