"""Files of parameters: what each tool writes is read, and what we write each tool reads."""

from pathlib import Path

import pytest
import yaml

from rvc_features import detectors, presets
from rvc_features.nodes import detector_config, settings

CONFIG = Path(__file__).resolve().parents[2] / 'config'

PLAIN = 'ANMS: true\nANMS_points: 120\ndetector: orb\nthreshold: 0.02\n'

# As `dynparam dump` and rqt's Save wrote it (shortened to four parameters).
DUMPED = '''!!python/object/new:dynamic_reconfigure.encoding.Config
dictitems:
  ANMS: true
  ANMS_points: 120
  detector: orb
  groups: !!python/object/new:dynamic_reconfigure.encoding.Config
    dictitems:
      ANMS: true
      ANMS_points: 120
      detector: orb
      groups: !!python/object/new:dynamic_reconfigure.encoding.Config
        state: []
      id: 0
      name: Default
      parameters: !!python/object/new:dynamic_reconfigure.encoding.Config
        state: []
      parent: 0
      state: true
      threshold: 0.02
      type: ''
    state: []
  threshold: 0.02
state: []
'''
EVERYTHING = f'''
rosdistro: noetic
camera:
  feature_detector:
{''.join('    ' + line for line in PLAIN.splitlines(keepends=True))}
other: {{threshold: 0.1}}
'''
VALUES = {'ANMS': True, 'ANMS_points': 120, 'detector': 'orb', 'threshold': 0.02}


@pytest.mark.parametrize(('text', 'node'), [
    (PLAIN, '/feature_detector'), (DUMPED, '/feature_detector'), (EVERYTHING, '/camera/feature_detector'),
    ('feature_detector: {' + PLAIN.replace('\n', ', ') + '}', '/feature_detector'),
    ('/feature_detector: {' + PLAIN.replace('\n', ', ') + '}', '/feature_detector'),
], ids=['plain', 'dumped', 'everything', 'nested', 'nested with slash'])
def test_all_ways_to_save_read_the_same(tmp_path, text, node):
    file = tmp_path / 'saved.yaml'
    file.write_text(text)
    assert settings.read(file, node) == VALUES


def test_values_with_an_underscore_need_no_quotes():
    assert settings.parse('fast_type: 5_8\nthreshold: 0.02\nnumber_of_points: 1200\n') == {
        'fast_type': '5_8', 'threshold': 0.02, 'number_of_points': 1200}


def test_no_code_is_run(tmp_path):
    file, victim = tmp_path / 'evil.yaml', tmp_path / 'victim'
    file.write_text(f'threshold: !!python/object/apply:os.mkdir ["{victim}"]')
    assert settings.read(file) == {'threshold': [str(victim)]}
    assert not victim.exists()


@pytest.mark.parametrize(('text', 'problem'), [
    ('- 1\n- 2', 'holds no parameters'), ('', 'holds no parameters'), ('threshold', 'holds no parameters'),
    ('1: 2', 'holds no parameters'), ('a: [1', 'is not YAML'), ('a: !unknown 1', 'is not YAML')])
def test_what_is_no_table_is_refused_in_one_sentence(tmp_path, text, problem):
    file = tmp_path / 'wrong.yaml'
    file.write_text(text)
    with pytest.raises(settings.SettingsError, match=f'wrong.yaml {problem}'):
        settings.read(file)


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(settings.SettingsError, match=r'none\.yaml: No such file'):
        settings.read(tmp_path / 'none.yaml')
    with pytest.raises(settings.SettingsError, match='No such file'):
        settings.write(tmp_path / 'none' / 'x.yaml', VALUES)
    (tmp_path / 'binary.yaml').write_bytes(b'a: \xff')
    with pytest.raises(settings.SettingsError, match=r'binary\.yaml is not YAML'):
        settings.read(tmp_path / 'binary.yaml')


def test_written_plainly_in_the_order_given(tmp_path):
    file = tmp_path / 'new.yaml'
    settings.write(file, {'threshold': 0.02, 'detector': 'orb'}, 'For halls.\nCosts nothing.')
    assert file.read_text() == '# For halls.\n# Costs nothing.\nthreshold: 0.02\ndetector: orb\n'
    assert yaml.safe_load(file.read_text()) == settings.read(file) == {'threshold': 0.02, 'detector': 'orb'}


@pytest.mark.parametrize('name', presets.names())
def test_a_preset_as_settings_is_the_preset(name):
    assert detector_config.create(settings.of_preset(name)) == presets.create(name)
    assert detector_config.create(settings.read(CONFIG / f'{name}.yaml')) == presets.create(name)
    assert detectors.create('harris', **presets.values(name)) == presets.create(name)


def test_the_files_of_the_presets_are_as_they_are_made(tmp_path):
    settings.write_presets(tmp_path)
    made = {file.name: file.read_text() for file in tmp_path.iterdir()}
    there = {file.name: file.read_text() for file in CONFIG.glob('*.yaml')}
    assert there == made, './run exec python3 -m rvc_features.nodes.settings config'
    assert all(text.startswith('# ') and text.splitlines()[1].startswith('# ') for text in made.values())


def test_an_unknown_preset():
    with pytest.raises(ValueError, match="unknown preset 'odd'; there are course, even, matching, repeatable"):
        settings.of_preset('odd')
