#!/usr/bin/env python3
"""Parameters preset by a launch file with wrong types and values: every node of presets.test comes up sane."""

import sys
import unittest

import rospy
import rostest
from dynamic_reconfigure.client import Client
from ros_helpers import SECONDS, Camera, Diagnostics, Inbox, square
from rvc_features.msg import KeyPoints

EXPECTED = {
    'whole_number': {'threshold': 0.5},
    'broken_number': {'window_size': 9},
    'even_number': {'window_size': 9},
    'text': {'window_size': 5, 'number_of_points': 7},
    'nan': {'threshold': 0.05},
    'list': {'octaves': 1},
    'too_much': {'octaves': 6},
    'beyond_64_bits': {'number_of_points': 500, 'window_size': 9},
    'unknown_detector': {'detector': 'harris', 'ANMS': True},
    'other_detector': {'detector': 'orb'},
    'unknown_transport': {'detector': 'harris'},
    'no_list_of_modules': {'detector': 'harris'},
}


class TestPresets(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_presets')

    def test_values(self):
        for node, expected in EXPECTED.items():
            config = Client(f'/{node}', timeout=SECONDS).get_configuration(SECONDS)
            for name, value in expected.items():
                self.assertEqual((node, config[name], type(config[name])), (node, value, type(value)))
                self.assertEqual((node, rospy.get_param(f'/{node}/{name}')), (node, value))

    def test_a_transport_that_there_is_not_stays_an_error(self):
        """It has to be seen that raw images come instead, at ten times the bandwidth."""
        for node, value in (('unknown_transport', "got 'telepathy'"), ('no_list_of_modules', 'got ')):
            values = Diagnostics(node).wait_for_values(
                lambda values, text=value: '~image_transport' in values['message'] and text in values['message'], node)
            self.assertEqual(values['level'], 2)

    def test_all_of_them_process_images(self):
        """They share the topics: as many answers must come as there are nodes."""
        inbox, camera = Inbox('key_points', KeyPoints), Camera('in')
        for node in EXPECTED:
            Diagnostics(node).wait_for_values(lambda values: values['publishers connected'] == '1', f'{node} listening')
        camera.send(square())
        for node in EXPECTED:
            inbox.wait_for(lambda message, node=node: message._connection_header['callerid'] == f'/{node}', node)


if __name__ == '__main__':
    rostest.rosrun('rvc_features', 'presets', TestPresets, sys.argv)
