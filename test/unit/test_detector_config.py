"""The table of dynamic parameters: cfg/FeatureDetectorConfig.cfg and the detectors agree; values settle."""

import functools
import math
import runpy
import sys
import types
from pathlib import Path

import pytest

from rvc_features import detectors, parameters
from rvc_features.nodes import detector_config, odometry_config

CFG = Path(__file__).resolve().parents[2] / 'cfg' / 'FeatureDetectorConfig.cfg'
FIXED = ['detector', 'window_size', 'window', 'threshold', 'fixed_number_of_points', 'number_of_points', 'octaves',
         'ANMS', 'ANMS_points']


class Recorder:
    """Takes the place of dynamic_reconfigure's generator, which only a ROS build has."""

    def __init__(self):
        self.entries = {}

    def const(self, name, kind, value, text):
        return value

    def enum(self, constants, text):
        return constants

    def add(self, name, kind, level, text, default, low=None, high=None, edit_method=None):
        assert '"' not in text
        assert "'" not in text
        self.entries[name] = (kind, default, low, high, edit_method)

    def generate(self, *names):
        self.names = names


@pytest.fixture(scope='module')
def entries():
    recorder = Recorder()
    module = types.ModuleType('dynamic_reconfigure.parameter_generator_catkin')
    module.__dict__.update(ParameterGenerator=lambda: recorder, bool_t='bool', double_t='double', int_t='int',
                           str_t='str')
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, 'dynamic_reconfigure', types.ModuleType('dynamic_reconfigure'))
        patch.setitem(sys.modules, module.__name__, module)
        with pytest.raises(SystemExit):
            runpy.run_path(str(CFG))
    assert recorder.names == ('rvc_features', 'feature_detector', 'FeatureDetectorConfig')
    return recorder.entries


@pytest.fixture
def config(entries):
    return {name: entry[1] for name, entry in entries.items()}


def test_the_fixed_names_come_first_in_their_order(entries):
    assert list(entries)[:len(FIXED)] == FIXED
    assert entries['detector'][4] == ['harris', 'good_features_to_track', 'fast', 'orb']


def test_every_parameter_of_the_detectors_listed_is_in_the_cfg_with_its_type_default_and_range(entries):
    """Those that it does not list get their sliders when the node starts."""
    expected = {'detector'}
    kinds = {parameters.Integer: 'int', parameters.Real: 'double', parameters.Flag: 'bool', parameters.Choice: 'str'}
    declared = [(odometry_config.SPECIFICATIONS, odometry_config.DEFAULTS, str)]
    for name in entries['detector'][4]:
        detector = detectors.get(name)
        declared.append((parameters.specifications(detector), parameters.defaults(detector),
                         functools.partial(detector_config.key, name)))
    for specifications, defaults, key in declared:
        for field, specification in specifications.items():
            entry = key(field)
            kind, default, low, high, choices = entries[entry]
            expected.add(entry)
            assert kind == kinds[type(specification)], entry
            assert default == defaults[field], entry
            if kind in ('int', 'double'):
                assert specification.checked(low) == low, entry
                assert specification.checked(high) == high, entry
            if kind == 'str':
                assert tuple(choices) == specification.choices, entry
    assert set(entries) == expected


def test_defaults_give_the_default_detectors(config):
    for name in detectors.names():
        config['detector'] = name
        assert detector_config.create(config) == detectors.create(name)


def test_values_reach_the_detector(config):
    config.update(ANMS=True, ANMS_points=7, window_size=9, fast_threshold=33, number_of_points=12)
    detector = detector_config.create(config)
    assert (detector.anms, detector.anms_points, detector.window_size, detector.threshold) == (True, 7, 9, 0.05)
    fast = detector_config.create({**config, 'detector': 'fast'})
    assert (fast.threshold, fast.number_of_points) == (33, 12)


def test_settled_values_are_left_alone(config):
    before = dict(config)
    assert detector_config.settle(config, before) == []
    assert config == before


def test_settle_snaps_refuses_and_says_so(config):
    previous = dict(config)
    config.update(window_size=6, threshold=math.nan, window='round', octaves=99, detector='sift', orb_scale_factor=-1)
    problems = detector_config.settle(config, previous)
    assert config == {**previous, 'window_size': 7, 'octaves': 10}
    assert len(problems) == 4
    text = '\n'.join(problems)
    assert f"detector must be one of {', '.join(detectors.names())}; got 'sift', 'harris' stays" in text
    assert 'threshold must be a finite number; got nan, 0.05 stays' in text
    assert "window must be one of 'gaussian', 'box'; got 'round', 'gaussian' stays" in text
    assert 'orb_scale_factor must be a finite number above 1, at most 4; got -1, 1.2 stays' in text


def test_names_that_no_detector_has_are_left_alone(config):
    config['groups'] = {'name': 'Default'}
    assert detector_config.settle(config, dict(config)) == []
    assert config['groups'] == {'name': 'Default'}
