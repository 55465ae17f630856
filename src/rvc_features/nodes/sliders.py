"""Sliders for every detector: the generated configuration, extended by detectors that other packages register."""

from __future__ import annotations

import ast
import copy
from types import SimpleNamespace
from typing import Any

from rvc_features import detectors, parameters
from rvc_features.nodes import detector_config
from rvc_features.parameters import Flag, Integer, Real, Specification


def with_detectors(config_type: Any) -> SimpleNamespace:
    """A copy of the generated configuration with the detectors it doesn't know: an enum entry and parameters for each.

    Detectors that register themselves from other packages become selectable that way, with sliders of their own.
    """
    extended = SimpleNamespace(**{name: copy.deepcopy(getattr(config_type, name))
                                  for name in ('config_description', 'defaults', 'min', 'max', 'level', 'type')})
    entries = extended.config_description['parameters']
    selector = next(entry for entry in entries if entry['name'] == 'detector')
    enum = ast.literal_eval(selector['edit_method'])
    listed = [constant['value'] for constant in enum['enum']]
    for name in detectors.names():
        if name in listed:
            continue
        detector = detectors.get(name)
        enum['enum'].append({**enum['enum'][0], 'name': name, 'value': name, 'description': detector.__module__})
        defaults = parameters.defaults(detector)
        for field, specification in parameters.specifications(detector).items():
            entry = detector_config.key(name, field)
            if entry in extended.defaults:
                continue
            kind, low, high = _slider(specification)
            extended.defaults[entry], extended.min[entry], extended.max[entry] = defaults[field], low, high
            extended.type[entry], extended.level[entry] = kind, 1
            entries.append({**selector, 'name': entry, 'type': kind, 'default': defaults[field], 'min': low,
                            'max': high, 'description': f'{name}: {specification.description}', 'edit_method': ''})
    selector['edit_method'] = repr(enum)
    return extended


def _slider(specification: Specification) -> tuple[str, Any, Any]:
    """Type, least and greatest value of a parameter as dynamic_reconfigure has them."""
    if isinstance(specification, Integer):
        return 'int', specification.low, 0x7FFFFFFF if specification.high is None else specification.high
    if isinstance(specification, Real):
        return 'double', specification.low, specification.high
    return ('bool', False, True) if isinstance(specification, Flag) else ('str', '', '')
