"""From a flat table of dynamic parameters to a detector (no ROS here: a configuration is a dict).

The names in the table are those of cfg/FeatureDetectorConfig.cfg. HarrisDetector's parameters have the exercise
sheet's names; those of any other detector have its name as prefix, save those that all share: the number of points,
and adaptive non-maximal suppression.
"""

from __future__ import annotations

from typing import Any

from rvc_features import detectors, parameters
from rvc_features.brief import shown
from rvc_features.feature_detector import FeatureDetector

_SHARED = ('number_of_points', 'anms', 'anms_points', 'anms_robustness', 'anms_pool')


def key(detector: str, field: str) -> str:
    """Name in the table of a detector's parameter."""
    if detector == 'harris' or field in _SHARED:
        return field.replace('anms', 'ANMS')   # the sheet's spelling
    return f'{detector}_{field}'


def settle(config: dict[str, Any], previous: dict[str, Any]) -> list[str]:
    """Turn every value of `config` into the nearest one that its detector accepts, in place.

    Parameters
    ----------
    config : dict
        The values asked for; names that no detector has are left alone.
    previous : dict
        The values in force: kept where what is asked for means nothing, and the start of a slider's movement.

    Returns
    -------
    list of str
        A sentence for each value that was refused.
    """
    problems = []
    if config['detector'] not in detectors.names():
        problems.append(f'detector must be one of {", ".join(detectors.names())}; '
                        f'got {shown(config["detector"])}, {previous["detector"]!r} stays')
        config['detector'] = previous['detector']
    for name in detectors.names():
        for field, specification in parameters.specifications(detectors.get(name)).items():
            entry = key(name, field)
            if entry in config:
                problems += settle_one(config, previous, entry, specification)
    return problems


def settle_one(config: dict[str, Any], previous: dict[str, Any], entry: str,
               specification: parameters.Specification) -> list[str]:
    """The same for one value: nothing, or the sentence that says why it was refused."""
    try:
        config[entry] = specification.nearest(config[entry], previous[entry])
    except ValueError as error:
        problem = f'{entry} must be {error}; got {shown(config[entry])}, {previous[entry]!r} stays'
        config[entry] = previous[entry]
        return [problem]
    return []


def create(config: dict[str, Any]) -> FeatureDetector:
    """The detector that a settled configuration describes; what it doesn't name stays at its default."""
    name = config['detector']
    fields = parameters.specifications(detectors.get(name))
    return detectors.create(name, **{field: config[key(name, field)] for field in fields if key(name, field) in config})
