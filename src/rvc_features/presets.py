"""HarrisDetector set up for a purpose, by name.

    presets.create('even', number_of_points=300)      # a detector
    presets.values('even')                            # its parameters, as a launch file or a slider would have them

docs/repeatability.md has what each gives and costs, measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Mapping

from rvc_features import parameters
from rvc_features.brief import shown
from rvc_features.harris_detector import HarrisDetector
from rvc_features.parameters import Integer, check


@dataclass(frozen=True)
class Preset:
    """What a preset is for, what it costs, and which parameters differ from HarrisDetector's defaults."""

    purpose: str
    cost: str
    values: Mapping[str, Any]


_PRESETS = {
    'repeatable': Preset(
        'Points that come back in other pictures of the same scene, in every light and through blur. The default.',
        'Two to three times the time of course; points gather where the image has most corners.', {}),
    'course': Preset(
        'The exercise sheet to the letter: the Harris response H, ranked by itself, on whole pixels.',
        'A sixth of the repeatability of repeatable; strong contrast takes all points.',
        {'strength': 'harris', 'evenness': 0.0, 'threshold': 0.01, 'border': 0, 'subpixel': False, 'window': 'box',
         'merge_octaves': False, 'anms_pool': 0.0, 'orientation_sigma': 2.5}),
    'even': Preset(
        'Points spread over the whole image, for odometry and registration.',
        'Hardly any repeatability on textured images; weak corners where there are no others.',
        {'evenness': 1.0, 'anms': True, 'anms_pool': 1.3}),
    'matching': Preset(
        'Points of several scales with size and direction, to be described and matched through a change of scale.',
        'A corner is two points of different sizes in each octave that shows it; the places are half as many.',
        {'octaves': 3, 'merge_octaves': False, 'octave_layers': 2, 'evenness': 1.0, 'shape_adaptation': False,
         'fixed_number_of_points': True}),
}


def names() -> list[str]:
    """Names of all presets, in alphabetical order."""
    return sorted(_PRESETS)


def get(name: str) -> Preset:
    """The preset of that name; ValueError with the known names otherwise."""
    if name not in _PRESETS:
        raise ValueError(f'unknown preset {shown(name)}; there are {", ".join(names())}')
    return _PRESETS[name]


def values(name: str, number_of_points: int | None = None) -> dict[str, Any]:
    """Every parameter of a preset's HarrisDetector.

    Parameters
    ----------
    name : str
    number_of_points : int, optional
        How many points at the most, whatever filter the preset uses; default: the preset's own filter and number.

    Raises
    ------
    ValueError, TypeError
        For an unknown name or a number that is none.
    """
    result = {**parameters.defaults(HarrisDetector), **get(name).values}
    if number_of_points is not None:
        count = check('number_of_points', number_of_points, Integer('', 0))
        if not result['anms']:
            result['fixed_number_of_points'] = True
        result.update(number_of_points=count, anms_points=count)
    return result


def create(name: str, number_of_points: int | None = None, **overrides: Any) -> HarrisDetector:
    """A preset's detector.

    Parameters
    ----------
    name : str
    number_of_points : int, optional
        As for `values`.
    **overrides
        Parameters of HarrisDetector that are to be otherwise than in the preset.

    Raises
    ------
    ValueError, TypeError
        For an unknown name, an unknown parameter, or a value that is not accepted.

    Examples
    --------
    >>> create('even', number_of_points=300).anms_points
    300
    >>> create('course', window_size=7).strength
    'harris'
    """
    unknown = sorted(set(overrides) - set(parameters.specifications(HarrisDetector)))
    if unknown:
        raise TypeError(f'HarrisDetector has no parameter {", ".join(map(repr, unknown))}; '
                        f'it has {", ".join(parameters.specifications(HarrisDetector))}')
    return HarrisDetector(**{**values(name, number_of_points), **overrides})
