"""What is compared: detectors with their parameters and a label, from the command line or a YAML file.

On the command line `[label=]name[:parameter=value,...]`; in YAML a list of mappings with `detector`, and if wanted
`label`, `parameters` and `thinned`. The name is a detector's, or that of a preset of Harris. `thinned`, also accepted
among the parameters on the command line, is no parameter of the detector: points nearer than that to a stronger one are
dropped, which some detectors need for a fair comparison.
"""

from __future__ import annotations

import dataclasses
import re
from typing import Any, Callable, Mapping, Sequence

import numpy as np

from rvc_features import detectors, parameters, presets
from rvc_features.brief import cut, shown
from rvc_features.comparison import measures
from rvc_features.feature_detector import FeatureDetector
from rvc_features.harris_detector import HarrisDetector
from rvc_features.odometry.masks import Masks
from rvc_features.recordings.regular_files import SourceError, read_text


class ContestantError(ValueError):
    """A detector, parameter or file of detectors that can't be used; the text says what is accepted."""


@dataclasses.dataclass(frozen=True)
class Contestant:
    """One detector with its parameters, under the label it has in the report."""

    label: str
    detector: FeatureDetector
    thinned: float = 0.0
    masks: Masks | None = dataclasses.field(default=None, compare=False)   # the same for all that are compared

    def detect(self, image: np.ndarray) -> np.ndarray:
        """Key points of a grey image, strongest first (structured array)."""
        points = self.detector.detect_arrays(image, None if self.masks is None else self.masks.of(image.shape))
        return thinned(points, self.thinned) if self.thinned > 0 else points

    def asked_for(self, count: int) -> Contestant | None:
        """The same, asked for at most `count` points; None where its detector has no parameter for that."""
        known = parameters.specifications(self.detector)
        limits: dict[str, Any] = {name: count for name in known if name in ('number_of_points', 'anms_points')}
        if not limits or (getattr(self.detector, 'fixed_number_of_points', True) is False \
                and not getattr(self.detector, 'anms', False)):
            return None
        values: dict[str, Any] = {name: getattr(self.detector, name) for name in known}
        values.update(limits)
        return dataclasses.replace(self, detector=detectors.create(self.detector.name, **values))

    def settings(self) -> dict[str, Any]:
        """Every parameter with its value."""
        values = {name: getattr(self.detector, name) for name in parameters.specifications(self.detector)}
        return {**values, **({'thinned': self.thinned} if self.thinned else {})}

    def changed_settings(self) -> dict[str, Any]:
        """The parameters that differ from the detector's defaults."""
        defaults = parameters.defaults(self.detector)
        return {name: value for name, value in self.settings().items()
                if name not in defaults or value != defaults[name]}

    def specification(self) -> tuple[str, str, dict[str, Any], float]:
        """What `from_specification` makes the same contestant of, in another process."""
        values = {name: getattr(self.detector, name) for name in parameters.specifications(self.detector)}
        return self.label, self.detector.name, values, self.thinned


def thinned(points: np.ndarray, distance: float) -> np.ndarray:
    """Key points, strongest first, without those nearer than `distance` pixels to a stronger one that is kept."""
    kept: list[int] = []
    where = measures.positions(points)
    free = np.ones(len(points), bool)
    for i in range(len(points)):
        if free[i]:
            kept.append(i)
            free[i + 1:] &= np.hypot(*(where[i + 1:] - where[i]).T) >= distance
    return points[kept]


def from_specification(label: str, name: str, values: Mapping[str, Any], thinned: float) -> Contestant:
    return Contestant(label, detectors.create(name, **values), thinned)


def standard_choice(count: int) -> list[Contestant]:
    """What is compared when nothing is named: each detector asked for the same number of points."""
    limit = {'number_of_points': count}
    others: list[tuple[str, str, dict[str, Any], float]] = [
        ('GFTT, Harris score', 'good_features_to_track',
         {**limit, 'use_harris': True, 'gradient_size': 5, 'minimum_distance': 3.0, 'quality_level': 1e-6}, 0),
        ('GFTT', 'good_features_to_track', {**limit, 'minimum_distance': 3.0, 'quality_level': 1e-4}, 0),
        ('FAST', 'fast', limit, 0),
        ('ORB', 'orb', limit, 0),
    ]
    ours = [Contestant(f'Harris, {name}', presets.create(name, count))
            for name in ('repeatable', 'even', 'matching', 'course')]
    return [*ours, *(from_specification(*each) for each in others)]


def parse(text: str, count: int) -> Contestant:
    """The contestant written as `[label=]name[:parameter=value,...]`: a detector's name, or that of a preset of Harris.

    Raises
    ------
    ContestantError
        For an unknown detector or parameter, or a value that is not accepted.
    """
    match = re.fullmatch(r'(?:(?P<label>[^=:]+)=)?(?P<name>[^=:,]+)(?::(?P<values>.*))?', text.strip())
    if match is None:
        raise ContestantError(f'{text!r}: write [label=]detector[:parameter=value,...], '
                              'such as even or harris:window_size=7,octaves=3')
    values = {}
    for item in filter(None, (match['values'] or '').split(',')):
        name, equals, value = item.partition('=')
        if not equals:
            raise ContestantError(f'{text!r}: {item!r} is no parameter=value')
        if name.strip() in values:
            raise ContestantError(f'{text!r}: {name.strip()} is given twice')
        values[name.strip()] = value.strip()
    return _checked(repr(text), match['label'] or '', match['name'].strip(), values, None, count)


def read_yaml(path: str, count: int) -> list[Contestant]:
    """The contestants in a YAML file; ContestantError as in `parse`, with the file's name."""
    accepted = ('accepted is a list of mappings with the keys detector, label, parameters and thinned, '
                'alone or under the key detectors')
    try:
        import yaml  # here, for the rest works without
    except ImportError:
        raise ContestantError(f'{path}: reading it needs PyYAML, which is not installed here: python3 -m pip install '
                              'PyYAML') from None
    try:
        # BaseLoader leaves every scalar a text: YAML 1.1 would read FAST's type 9_16 as the number 916.
        content = yaml.load(read_text(path), Loader=yaml.BaseLoader)
    except SourceError as error:
        raise ContestantError(f'{error}; {accepted}') from None
    except (yaml.YAMLError, RecursionError) as error:
        raise ContestantError(f'{path}: not YAML ({cut(str(error))}); {accepted}') from None
    entries = content.get('detectors') if isinstance(content, dict) else content
    if not isinstance(entries, list) or not entries:
        raise ContestantError(f'{path}: no list of detectors in it; {accepted}')
    contestants = []
    for number, entry in enumerate(entries, 1):
        where = f'{path}, detector {number}'
        if isinstance(entry, str):
            entry = {'detector': entry}
        if not isinstance(entry, dict) or not isinstance(entry.get('detector'), str):
            raise ContestantError(f'{where}: it has no name under detector; {accepted}')
        unknown = sorted(set(entry) - {'detector', 'label', 'parameters', 'thinned'})
        if unknown:
            raise ContestantError(f'{where}: unknown key {", ".join(map(repr, unknown))}; {accepted}')
        values = entry.get('parameters') or {}
        if not isinstance(values, dict) or not all(isinstance(value, str) for value in values.values()):
            raise ContestantError(f'{where}: parameters must be a mapping of names to values')
        contestants.append(_checked(where, str(entry.get('label') or ''), entry['detector'], values,
                                    entry.get('thinned'), count))
    return contestants


def with_distinct_labels(contestants: Sequence[Contestant]) -> list[Contestant]:
    """The same with labels that differ: to a label that is there twice is added what tells its detectors apart."""
    def told_apart(labels: list[str], addition: Callable[[Contestant], str]) -> list[str]:
        by_label: dict[str, set[str]] = {}
        for label, contestant in zip(labels, contestants):
            by_label.setdefault(label, set()).add(addition(contestant))
        return [f'{label} ({addition(contestant)})' if len(by_label[label]) > 1 else label
                for label, contestant in zip(labels, contestants)]

    labels = told_apart([contestant.label for contestant in contestants], lambda each: each.detector.name)
    labels = told_apart(labels, lambda each: ', '.join(f'{name} {value}' for name, value
                                                       in each.changed_settings().items()) or 'defaults')
    distinct: list[Contestant] = []
    for contestant, label in zip(contestants, labels):
        taken = {other.label for other in distinct}
        base, number = label, 1
        while label in taken:
            number += 1
            label = f'{base} #{number}'
        distinct.append(dataclasses.replace(contestant, label=label))
    return distinct


def _checked(where: str, label: str, name: str, texts: Mapping[str, str], thinned: str | None,
             count: int) -> Contestant:
    preset = name in presets.names() and name not in detectors.names()
    try:
        known = parameters.specifications(HarrisDetector if preset else _detector(name))
        values = {key: _value(text, known.get(key)) for key, text in texts.items()}
        if 'thinned' in values and 'thinned' not in known:
            thinned = texts['thinned']
            del values['thinned']
        distance = _distance(thinned)
        # As many as are compared, unless said otherwise: a limit below would decide the comparison.
        if preset:
            detector: FeatureDetector = presets.create(name, values.pop('number_of_points', count or None), **values)
        else:
            if 'number_of_points' in known and count > getattr(detectors.get(name), 'number_of_points', count):
                values.setdefault('number_of_points', count)
            detector = detectors.create(name, **values)
        return Contestant(label.strip() or name, detector, distance)
    except (TypeError, ValueError) as error:
        raise ContestantError(f'{where}: {error}') from None


def _detector(name: str) -> type[FeatureDetector]:
    if name not in detectors.names():
        raise ValueError(f'unknown detector {shown(name)}; there are {", ".join(detectors.names())}, and the presets '
                         f'of harris {", ".join(presets.names())}')
    return detectors.get(name)


def _value(text: str, specification: parameters.Specification | None) -> Any:
    """`text` as a value of the kind wanted; unchanged where it isn't one, for the detector's own error."""
    try:
        if isinstance(specification, parameters.Integer):
            return int(text)
        if isinstance(specification, parameters.Real):
            return float(text)
    except ValueError:
        return text
    if isinstance(specification, parameters.Flag):
        return {'true': True, 'yes': True, 'on': True, '1': True,
                'false': False, 'no': False, 'off': False, '0': False}.get(text.lower(), text)
    return text


def _distance(text: str | None) -> float:
    try:
        distance = float(text or 0)
    except ValueError:
        distance = -1
    if not 0 <= distance < 1e6:
        raise ValueError(f'thinned must be a distance in pixels; got {text!r}')
    return distance
