"""The registry: every detector by its name."""

from __future__ import annotations

from typing import Any, Type, TypeVar

from rvc_features import parameters
from rvc_features.feature_detector import FeatureDetector
from rvc_features.harris_detector import HarrisDetector
from rvc_features.opencv_detectors import FastDetector, GoodFeaturesToTrackDetector, OrbDetector

_DetectorType = TypeVar('_DetectorType', bound=Type[FeatureDetector])
_registered: dict[str, type[FeatureDetector]] = {}


def register(detector: _DetectorType) -> _DetectorType:
    """Class decorator that makes a detector known under its `name`.

    Raises
    ------
    TypeError
        When the class is not a `FeatureDetector` with a name of lower-case letters, digits and underscores.
    ValueError
        When another class has that name already.
    """
    if not (isinstance(detector, type) and issubclass(detector, FeatureDetector)):
        raise TypeError(f'a detector must be a class derived from FeatureDetector; got {detector!r}')
    name = getattr(detector, 'name', None)
    if not (isinstance(name, str) and name.isidentifier() and name == name.lower()):
        raise TypeError(f'{detector.__name__}.name must be lower-case letters, digits and underscores; got {name!r}')
    if _registered.setdefault(name, detector) is not detector:
        raise ValueError(f'detector {name!r} is registered already, by {_registered[name].__module__}')
    return detector


def names() -> list[str]:
    """Names of all detectors, in alphabetical order."""
    return sorted(_registered)


def get(name: str) -> type[FeatureDetector]:
    """The class registered under `name`; ValueError with the known names otherwise."""
    if name not in _registered:
        raise ValueError(f'unknown detector {name!r}; there are {", ".join(names())}')
    return _registered[name]


def create(name: str, **values: Any) -> FeatureDetector:
    """A detector by its name.

    Raises
    ------
    ValueError
        For an unknown name or a value out of range.
    TypeError
        For an unknown parameter or a value of the wrong type.

    Examples
    --------
    >>> create('harris', window_size=7).window_size
    7
    """
    detector = get(name)
    known = parameters.specifications(detector)
    unknown = sorted(set(values) - set(known))
    if unknown:
        raise TypeError(f'{name} has no parameter {", ".join(map(repr, unknown))}; it has {", ".join(known)}')
    return detector(**values)


for _detector in (HarrisDetector, GoodFeaturesToTrackDetector, FastDetector, OrbDetector):
    register(_detector)
