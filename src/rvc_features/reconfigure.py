"""A dynamic_reconfigure server that no request can break. It knows parameters, not detectors."""

from __future__ import annotations

from typing import Any, Callable

import rospy
from dynamic_reconfigure.encoding import decode_config, encode_config, extract_params
from dynamic_reconfigure.server import Server

from rvc_features.brief import reporter, shown
from rvc_features.parameters import Flag, Integer, Real, Specification


class ReconfigureServer(Server):
    """`dynamic_reconfigure.server.Server`, made safe.

    The original believes what it is sent: a launch file's `abc` for a number ends the node, NaN passes the limits, an
    exception in the callback kills the panel in rqt_reconfigure. Here each value, preset or sent, becomes one of the
    declared type and range, or is refused with a warning while the last good one stays; the callback's errors end
    in the log, and so do those of the parameter server, without which everything else goes on. What has changed is
    said in one line, and under a storm of requests in a few lines a minute.

    Parameters
    ----------
    config_type : module
        Generated from a .cfg file, or made like one.
    callback : callable
        Takes (config, level) and returns the configuration that is now in force.
    namespace : str
        As in dynamic_reconfigure; default: the node's private one.
    reject : callable, optional
        Takes a list of sentences, one for each value that a request or the presets had refused; default: a warning in
        the log.
    settle : callable, optional
        Takes (config, previous), makes the values in `config` sane by knowledge beyond types and ranges, and returns
        a sentence for each that it refused; as `nodes.detector_config.settle` does.
    """

    def __init__(self, config_type: Any, callback: Callable[[Any, int], Any], namespace: str = '',
                 reject: Callable[[list[str]], Any] | None = None,
                 settle: Callable[[Any, Any], list[str]] = lambda config, previous: []) -> None:
        self._reject, self._settle = reject or warn_of_refused, settle
        self._specifications = {entry['name']: _specification(config_type, entry)
                                for entry in extract_params(config_type.config_description)}
        self._callback = callback
        self._on_server: dict[str, Any] = {}   # what the parameter server is known to hold
        self._problems: list[str] = []         # of the request at hand
        super().__init__(config_type, self._guarded_callback, namespace)

    def update_configuration(self, changes: dict[str, Any]) -> Any:
        known = {}
        for name, value in changes.items():
            if name in self._specifications:
                known[name] = value
            else:
                self._reject([f'there is no {shown(name)}'])
        return super().update_configuration(known)

    def restore_parameters(self) -> None:
        """Write all values to the parameter server again, which has lost them with a master that was restarted."""
        with self.mutex:
            self._on_server.clear()
            self._copy_to_parameter_server()

    def _clamp(self, config: Any) -> None:
        """Called by the original on all values before each callback: here is where they become sane."""
        # At start `config` is self.config itself, with the presets in it, and the defaults are the last good ones.
        previous = self.type.defaults if config is self.config else self.config
        problems, self._problems = self._problems, []
        problems += self._settle(config, previous)
        for name, specification in self._specifications.items():
            try:
                config[name] = specification.nearest(config[name], previous[name])
            except ValueError as error:
                problems.append(f'{name} must be {error}; got {shown(config[name])}, {shown(previous[name])} stays')
                config[name] = previous[name]
        if problems:
            self._reject(problems)

    def _guarded_callback(self, config: Any, level: int) -> Any:
        previous = self.type.defaults if config is self.config else self.config
        try:
            taken = self._callback(config, level)
        except Exception as error:
            reporter().say(rospy.logerr, f'{self.ns} callback', f'{self.ns}: parameters not taken over, the last ones '
                                                                f'stay: {type(error).__name__}: {error}')
            return self.config
        changes = [f'{name} {shown(previous[name])} -> {shown(taken[name])}' for name in self._specifications
                   if taken[name] != previous[name]]
        if changes:
            reporter().say(rospy.loginfo, f'{self.ns} changed', f'{self.ns}: {", ".join(changes)}')
        return taken

    def _copy_from_parameter_server(self) -> None:
        for name in self._specifications:
            try:
                self.config[name] = self._on_server[name] = rospy.get_param(self.ns + name)
            except KeyError:
                continue
            except Exception as error:   # such as an integer beyond 64 bits, which can be set and not be got
                self._problems.append(f'{name} can not be read ({type(error).__name__}: {error}), '
                                      f'{shown(self.config[name])} stays')

    def _copy_to_parameter_server(self) -> None:
        for name in self._specifications:
            value = self.config[name]
            if name in self._on_server and _same(self._on_server[name], value):
                continue
            try:
                rospy.set_param(self.ns + name, value)
            except Exception as error:   # there is no master for the moment: the value is in force all the same
                self._on_server.clear()
                reporter().say(rospy.logwarn, f'{self.ns} parameter server', f'{self.ns}: values are in force, but not '
                               f'on the parameter server: {type(error).__name__}: {error}')
                return
            self._on_server[name] = value

    def _set_callback(self, request: Any) -> Any:
        # Sub-groups, which these servers have none of, crash decode_config (ros/dynamic_reconfigure#109).
        request.config.groups = []
        return encode_config(self.update_configuration(decode_config(request.config)))


def warn_of_refused(problems: list[str]) -> None:
    """One line for all values that a request had refused."""
    reporter().say(rospy.logwarn, 'parameters refused', f'refused: {"; ".join(problems)}')


def _same(one: Any, other: Any) -> bool:
    return type(one) is type(other) and one == other


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
