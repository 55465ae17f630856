"""A dynamic_reconfigure server that no request can break. It knows parameters, not detectors."""

from __future__ import annotations

import traceback
from typing import Any, Callable

import rospy
from dynamic_reconfigure.encoding import decode_config, encode_config, extract_params
from dynamic_reconfigure.server import Server

from rvc_features.parameters import Flag, Integer, Real, Specification


class ReconfigureServer(Server):
    """`dynamic_reconfigure.server.Server`, made safe.

    The original believes what it is sent: a launch file's `abc` for a number ends the node, NaN passes the limits, an
    exception in the callback kills the panel in rqt_reconfigure. Here each value, preset or sent, becomes one of the
    declared type and range, or is refused with a warning while the last good one stays; and the callback's errors end
    in the log.

    Parameters
    ----------
    config_type : module
        Generated from a .cfg file, or made like one.
    callback : callable
        Takes (config, level) and returns the configuration that is now in force.
    namespace : str
        As in dynamic_reconfigure; default: the node's private one.
    reject : callable
        Takes a sentence for each value that is refused; default: a warning in the log.
    settle : callable, optional
        Takes (config, previous), makes the values in `config` sane by knowledge beyond types and ranges, and returns
        a sentence for each that it refused; as `nodes.detector_config.settle` does.
    """

    def __init__(self, config_type: Any, callback: Callable[[Any, int], Any], namespace: str = '',
                 reject: Callable[[str], None] = rospy.logwarn,
                 settle: Callable[[Any, Any], list[str]] = lambda config, previous: []) -> None:
        self._reject, self._settle = reject, settle
        self._specifications = {entry['name']: _specification(config_type, entry)
                                for entry in extract_params(config_type.config_description)}
        self._callback = callback
        super().__init__(config_type, self._guarded_callback, namespace)

    def update_configuration(self, changes: dict[str, Any]) -> Any:
        known = {}
        for name, value in changes.items():
            if name in self._specifications:
                known[name] = value
            else:
                self._reject(f'there is no {name!r}')
        return super().update_configuration(known)

    def _clamp(self, config: Any) -> None:
        """Called by the original on all values before each callback: here is where they become sane."""
        # At start `config` is self.config itself, with the presets in it, and the defaults are the last good ones.
        previous = self.type.defaults if config is self.config else self.config
        for problem in self._settle(config, previous):
            self._reject(problem)
        for name, specification in self._specifications.items():
            try:
                config[name] = specification.nearest(config[name], previous[name])
            except ValueError as error:
                self._reject(f'{name} must be {error}; got {config[name]!r}, {previous[name]!r} stays')
                config[name] = previous[name]

    def _guarded_callback(self, config: Any, level: int) -> Any:
        try:
            return self._callback(config, level)
        except Exception:
            rospy.logerr('parameters not taken over, the last ones stay:\n%s', traceback.format_exc())
            return self.config

    def _set_callback(self, request: Any) -> Any:
        # Sub-groups, which these servers have none of, crash decode_config (ros/dynamic_reconfigure#109).
        request.config.groups = []
        return encode_config(self.update_configuration(decode_config(request.config)))


class _Text(Specification):
    """Any string: the choices of an enum are checked by those who know them."""

    def accepted(self) -> str:
        return 'text'

    def nearest(self, value: Any, previous: Any) -> str:
        return str(value)


def _specification(config_type: Any, entry: dict[str, Any]) -> Specification:
    """Type and range that the .cfg file declares."""
    name, kind, text = entry['name'], entry['type'], entry['description']
    if kind == 'bool':
        return Flag(text)
    if kind == 'str':
        return _Text(text)
    limits = config_type.min[name], config_type.max[name]
    return Integer(text, *limits) if kind == 'int' else Real(text, *limits)
