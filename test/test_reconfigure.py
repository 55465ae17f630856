#!/usr/bin/env python3
"""Parameters turned while images arrive: the next frame shows it, and nothing hostile gets through."""

import ast
import math
import sys
import unittest

import own_detector  # noqa: F401  (registers itself here as it does in the node)
import rospy
import rostest
from dynamic_reconfigure.client import Client
from dynamic_reconfigure.msg import Config, DoubleParameter, GroupState, IntParameter, StrParameter
from dynamic_reconfigure.srv import Reconfigure
from ros_helpers import SECONDS, Camera, Diagnostics, Inbox, texture
from rvc_features.msg import KeyPoints

from rvc_features import detectors, parameters

NODE = '/feature_detector'


class TestReconfigure(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_reconfigure')
        cls.inbox = Inbox('key_points', KeyPoints)
        cls.camera = Camera('in')
        cls.client = Client(NODE, timeout=SECONDS)
        cls.defaults = {name: value for name, value in cls.client.get_configuration(SECONDS).items()
                        if name != 'groups'}
        cls.image = texture()

    def setUp(self):
        self.client.update_configuration(dict(self.defaults))

    def points(self):
        stamp = self.camera.send(self.image)
        return self.inbox.wait_for(lambda message: message.header.stamp == stamp, f'the answer of {stamp}')

    def expect(self, detector, changes, **fields):
        """After `changes` the node's points are those of the detector with these fields."""
        self.client.update_configuration({**self.defaults, 'detector': detector, **changes})
        message = self.points()
        expected = detectors.create(detector, **fields).detect_arrays(self.image)
        self.assertEqual(message.detector, detector)
        for name in expected.dtype.names:
            self.assertEqual(list(getattr(message, name)), expected[name].tolist(), f'{changes}: {name}')
        return message

    def test_every_parameter_of_harris_reaches_the_next_frame(self):
        sheet = {'strength': 'harris', 'evenness': 0.0, 'threshold': 0.01}   # uses all of them
        plain = self.expect('harris', sheet, **sheet)
        for name, value in {
            'window_size': 11, 'window': 'box', 'threshold': 0.15, 'minimum_response': 500000.0, 'harris_k': 0.15,
            'octaves': 3, 'octave_layers': 2, 'local_maxima': False, 'subpixel': False, 'derivative_sigma': 1.5,
            'border': 40, 'orientation_sigma': 7.0,
        }.items():
            message = self.expect('harris', {**sheet, name: value}, **{**sheet, name: value})
            if name != 'minimum_response':
                self.assertNotEqual((message.x, message.angle, message.size), (plain.x, plain.angle, plain.size),
                                    name)
        default = self.expect('harris', {})
        for name, value in {'strength': 'harris', 'evenness': 1.0, 'minimum_contrast': 100.0, 'window_size': 11,
                            'window': 'box', 'shape_adaptation': False}.items():
            message = self.expect('harris', {name: value}, **{name: value})
            self.assertNotEqual((message.x, message.angle), (default.x, default.angle), name)
        self.assertEqual(len(self.expect('harris', {'fixed_number_of_points': True, 'number_of_points': 7},
                                         fixed_number_of_points=True, number_of_points=7).x), 7)
        self.assertEqual(len(self.expect('harris', {'ANMS': True, 'ANMS_points': 9, 'ANMS_robustness': 0.5},
                                         anms=True, anms_points=9, anms_robustness=0.5).x), 9)

    def test_the_detector_is_switched_with_its_own_parameters(self):
        self.expect('good_features_to_track', {'good_features_to_track_minimum_distance': 20.0,
                                               'good_features_to_track_use_harris': True},
                    minimum_distance=20.0, use_harris=True)
        self.expect('fast', {'fast_threshold': 40, 'fast_type': '7_12', 'number_of_points': 33},
                    threshold=40, type='7_12', number_of_points=33)
        self.expect('orb', {'orb_levels': 2, 'orb_score': 'fast'}, levels=2, score='fast')

    def test_a_detector_of_the_users_own(self):
        self.expect('centre', {})
        message = self.expect('centre', {'centre_size': 31, 'centre_offset': 2.5}, size=31, offset=2.5)
        self.assertEqual((message.x, message.y, message.size), ((162.5,), (120.0,), (31.0,)))
        self.expect('centre', {'centre_place': 'corner'}, place='corner')
        described = {entry['name']: entry for entry in self.client.get_parameter_descriptions(SECONDS)}
        choices = ast.literal_eval(described['detector']['edit_method'])['enum']
        self.assertEqual({choice['value'] for choice in choices}, set(detectors.names()))
        self.assertEqual((described['centre_size']['min'], described['centre_size']['max']), (1, 99))

    def test_a_detector_that_fails_is_reported_and_the_node_stays(self):
        diagnostics = Diagnostics('feature_detector')
        self.client.update_configuration({**self.defaults, 'detector': 'centre', 'centre_fail': True})
        self.camera.send(self.image)
        values = diagnostics.wait_for_values(lambda values: values['last rejected because'] != '', 'a rejected frame')
        self.assertIn('RuntimeError: told to fail', values['last rejected because'])
        diagnostics.close()
        self.expect('harris', {})

    def test_even_windows_move_on_in_the_direction_of_the_slider(self):
        for asked, got in ((6, 7), (8, 9), (9, 9), (8, 7), (6, 5)):
            self.assertEqual(self.client.update_configuration({'window_size': asked})['window_size'], got)

    def test_values_out_of_range_are_clamped_and_shown(self):
        config = self.client.update_configuration({'octaves': 99, 'threshold': -1.0, 'number_of_points': -5})
        self.assertEqual((config['octaves'], config['threshold'], config['number_of_points']), (6, 0.0, 0))

    def test_hostile_requests_leave_the_last_good_state(self):
        diagnostics = Diagnostics('feature_detector')
        rejected = int(diagnostics.wait_for_values(lambda values: True, 'a report')['parameter values rejected'])
        request = Config()
        request.strs = [StrParameter('detector', 'banana'), StrParameter('window', ''), StrParameter('nothing', 'x'),
                        StrParameter('threshold', 'abc')]
        request.doubles = [DoubleParameter('harris_k', math.nan), DoubleParameter('ANMS_robustness', math.inf),
                           DoubleParameter('ANMS', 7.0), DoubleParameter('octaves', 2.2)]
        request.ints = [IntParameter('subpixel', 1)]
        request.groups = [GroupState('Default', True, 0, 0), GroupState('sub', False, 7, 0)]
        answer = rospy.ServiceProxy(f'{NODE}/set_parameters', Reconfigure)(request).config
        values = {pair.name: pair.value for kind in (answer.bools, answer.ints, answer.strs, answer.doubles)
                  for pair in kind}
        self.assertEqual(values, {**self.defaults, 'octaves': 2})
        after = diagnostics.wait_for_values(
            lambda values: int(values['parameter values rejected']) >= rejected + 7, 'seven rejects')
        self.assertEqual(int(after['parameter values rejected']), rejected + 7)
        diagnostics.close()
        self.expect('harris', {'octaves': 2}, octaves=2)

    def test_declared_ranges_reach_the_panel(self):
        described = {entry['name']: entry for entry in self.client.get_parameter_descriptions(SECONDS)}
        self.assertEqual(set(described), set(self.defaults))
        specifications = parameters.specifications(detectors.get('harris'))
        self.assertEqual(described['window_size']['min'], specifications['window_size'].low)
        self.assertTrue(all(entry['description'] for entry in described.values()))


if __name__ == '__main__':
    rostest.rosrun('rvc_features', 'reconfigure', TestReconfigure, sys.argv)
