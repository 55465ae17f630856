"""Files of parameters, as people save them (no ROS here: settings are a dict).

`rosrun dynamic_reconfigure dynparam dump` and rqt's *Save* write YAML with a Python tag, which roslaunch and `rosparam
load` refuse; `rosparam dump` writes it plain, with the names of nodes above when nobody asked for one node only; and
people write a few lines by hand. `parse` takes them all.

The presets as such files are in config/; `python3 -m rvc_features.nodes.settings FOLDER` writes them anew.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import yaml

from rvc_features import presets
from rvc_features.nodes import detector_config


class SettingsError(Exception):
    """A file of parameters can't be used; the text is a sentence for whoever named it."""


class _Loader(yaml.SafeLoader):
    """Safe, reads objects that dynamic_reconfigure dumped as what they hold, and 5_8 as text, which YAML has for 58."""

    def construct_yaml_int(self, node: yaml.Node) -> Any:
        return node.value if '_' in node.value else super().construct_yaml_int(node)


def _dumped_object(loader: _Loader, kind: str, node: yaml.Node) -> Any:
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True).get('dictitems', {})
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)


_Loader.add_constructor('tag:yaml.org,2002:int', _Loader.construct_yaml_int)
_Loader.add_multi_constructor('tag:yaml.org,2002:python/', _dumped_object)


def read(path: str | Path, node: str = '') -> dict[str, Any]:
    """The parameters in a file, as `parse` takes them; SettingsError where there is no such file."""
    try:
        return parse(Path(path).read_bytes(), node, str(path))
    except OSError as error:
        raise SettingsError(f'{path}: {error.strerror}') from None


def parse(text: str | bytes, node: str = '', source: str = 'the text') -> dict[str, Any]:
    """The parameters in a text.

    Parameters
    ----------
    text : str or bytes
        As written by dynparam, rqt_reconfigure, `rosparam dump` (of the node or of everything) or by hand.
    node : str
        Name of the node that they are for: chosen where there are the parameters of several.
    source : str
        What an error calls the text.

    Returns
    -------
    dict
        Parameter names and values. What dynamic_reconfigure keeps beside them (`groups`) is left out.

    Raises
    ------
    SettingsError
        If it is no table of parameters.
    """
    try:
        content = yaml.load(text, Loader=_Loader)   # a safe one, see above
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise SettingsError(f'{source} is not YAML: {error}') from None
    for name in node.strip('/').split('/'):
        if isinstance(content, dict):
            inner = content.get(name, content.get('/' + name))
            content = inner if isinstance(inner, dict) else content
    if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
        raise SettingsError(f'{source} holds no parameters; lines such as "threshold: 0.02" are wanted')
    return {name: value for name, value in content.items() if name != 'groups'}


def write(path: str | Path, values: dict[str, Any], comment: str = '') -> None:
    """Write parameters as plain YAML, one a line in the order given, which every tool of ROS reads.

    Raises
    ------
    SettingsError
        If the file can't be written.
    """
    text = ''.join(f'# {line}\n' for line in comment.splitlines()) + yaml.safe_dump(values, sort_keys=False)
    try:
        Path(path).write_text(text, encoding='utf-8')
    except OSError as error:
        raise SettingsError(f'{path}: {error.strerror}') from None


def of_preset(name: str) -> dict[str, Any]:
    """The dynamic parameters that a preset sets; ValueError with the known names for an unknown one."""
    return {'detector': 'harris',
            **{detector_config.key('harris', field): value for field, value in presets.values(name).items()}}


def write_presets(folder: Path) -> None:
    """Write a file for each preset, which says what it is for and what it costs."""
    for name in presets.names():
        preset = presets.get(name)
        write(folder / f'{name}.yaml', of_preset(name), f'{preset.purpose}\n{preset.cost}')


if __name__ == '__main__':
    write_presets(Path(sys.argv[1]))
