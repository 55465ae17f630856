"""What a node is started with: its command line, and files of parameters."""

from __future__ import annotations

import argparse
import sys
from typing import Any, Collection

import rospy

from rvc_features.nodes import settings

# Not dynamic.
_ONLY_AT_START = {'config', 'preset', 'image_transport', 'most_megapixels', 'detector_modules', 'mask'}

_LARGEST = 2 ** 31 - 1   # integer of XML-RPC


def only_ros_arguments(name: str, description: str) -> None:
    """Answer --help, and refuse with status 2 what is none of ROS's own arguments; no master is needed.

    Parameters
    ----------
    name : str
        The executable.
    description : str
        What --help tells: the module's docstring.
    """
    parser = argparse.ArgumentParser(prog=name, usage=f'rosrun rvc_features {name} [TOPIC:=TOPIC ...] '
                                     '[_PARAMETER:=VALUE ...]', description=description,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args(rospy.myargv()[1:])


def take_settings(known: Collection[str]) -> list[str]:
    """Turn ~preset and ~config into private parameters, before a dynamic_reconfigure server reads them.

    ~preset is the name of a preset; ~config is a file of parameters or the text in one (so that a launch file can give
    a file that is not on the node's machine). Their values win over what is on the parameter server, the file's over
    the preset's, and `_name:=value` on the command line over all. Both are taken away, so that a later start without
    them does not come back to them.

    Parameters
    ----------
    known : collection of str
        Names of the dynamic parameters.

    Returns
    -------
    list of str
        A sentence for each thing that can't be used.
    """
    preset, config = _taken('~preset'), _taken('~config')
    values: dict[str, Any] = {}
    problems = []
    if preset:
        try:
            values.update(settings.of_preset(preset))
        except ValueError as error:
            problems.append(f'~preset: {error}')
    if config:
        try:
            text = '\n' in config or ': ' in config
            values.update(settings.parse(config, rospy.get_name()) if text
                          else settings.read(config, rospy.get_name()))
        except settings.SettingsError as error:
            problems.append(f'~config: {error}')
    given = {name[1:] for name in (argument.partition(':=')[0] for argument in sys.argv[1:]) if name.startswith('_')}
    return problems + _set(values, given, known)


def _taken(name: str) -> str:
    value = rospy.get_param(name, '')
    if value != '':
        rospy.delete_param(name)
    return str(value)


def _set(values: dict[str, Any], given: set[str], known: Collection[str]) -> list[str]:
    problems = [f'~config: there is no {name!r}' for name in sorted(set(values) - set(known) - _ONLY_AT_START)]
    for name, value in values.items():
        if name not in known or name in given:
            continue
        if isinstance(value, (bool, float, str)) or (isinstance(value, int) and abs(value) <= _LARGEST):
            rospy.set_param(f'~{name}', value)
        else:   # what the parameter server can't carry
            problems.append(f'~config: {name} must be a number, true, false or text; got {value!r}')
    return problems
