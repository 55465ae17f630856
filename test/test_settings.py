#!/usr/bin/env python3
"""Tune, save, start again with it, by every way to save; the sliders; what the nodes say where no master runs."""

import os
import shutil
import subprocess
import sys
import tempfile
import time
import tkinter
import unittest
from pathlib import Path

import rospy
import rostest
import yaml
from dynamic_reconfigure.client import Client
from ros_helpers import SECONDS

from rvc_features.nodes import settings
from rvc_features.windows.sliders import SlidersWindow

NODE = '/feature_detector'
TUNED = {'detector': 'orb', 'threshold': 0.03, 'ANMS': True, 'ANMS_points': 123, 'window': 'box', 'window_size': 9}


def run(*command, **options):
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, **options)


class TestSettings(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_settings')
        cls.client = Client(NODE, timeout=SECONDS)
        cls.defaults = cls.values_of(cls.client)

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.client.update_configuration(dict(self.defaults))

    @staticmethod
    def values_of(client):
        return {name: value for name, value in client.get_configuration(SECONDS).items() if name != 'groups'}

    def wait_for(self, wanted, what):
        deadline = time.monotonic() + SECONDS
        while not wanted():
            self.assertLess(time.monotonic(), deadline, what)
            time.sleep(0.02)

    def save_by_all_ways(self):
        """Files with what is in force now, by the name of the way."""
        self.wait_for(lambda: rospy.get_param(f'{NODE}/detector') == 'orb', 'the parameter server knows')
        files = {way: self.folder / f'{way}.yaml' for way in ('dynparam', 'rqt', 'rosparam', 'everything', 'hand')}
        dynparam = ['rosrun', 'dynamic_reconfigure', 'dynparam']
        for way, command in (('dynparam', [*dynparam, 'dump', NODE, files['dynparam']]),
                             ('rosparam', ['rosparam', 'dump', files['rosparam'], NODE]),
                             ('everything', ['rosparam', 'dump', files['everything']])):
            result = run(*map(str, command))
            self.assertEqual(result.returncode, 0, f'{way}: {result.stderr}')
        # What rqt_reconfigure's Save writes: the client's configuration, as it is.
        files['rqt'].write_text(yaml.dump(self.client.get_configuration(SECONDS)))
        files['hand'].write_text('# for the hall\n' + ''.join(f'{name}: {value}\n' for name, value in TUNED.items()))
        self.assertIn('!!python/object', files['dynparam'].read_text())
        self.assertIn('!!python/object', files['rqt'].read_text())
        return files

    def test_tune_save_and_start_again(self):
        self.client.update_configuration(dict(TUNED))
        files = self.save_by_all_ways()
        # Everything was saved from a node of this name; a node of another name is not in it.
        names = {'everything': 'feature_detector'}
        launch = self.folder / 'again.launch'
        launch.write_text('<launch>' + ''.join(f'''
            <group ns="again_{way}">
              <include file="$(find rvc_features)/launch/feature_detector.launch">
                <arg name="name" value="{names.get(way, way)}"/><arg name="config" value="{file}"/>
              </include>
            </group>''' for way, file in files.items()) + f'''
            <include file="$(find rvc_features)/launch/feature_detector.launch">
              <arg name="name" value="overruled"/><arg name="detector" value="fast"/>
              <arg name="config" value="{files['dynparam']}"/>
            </include>
            <include file="$(find rvc_features)/launch/feature_detector.launch">
              <arg name="name" value="preset"/><arg name="preset" value="even"/>
            </include></launch>''')
        everything = yaml.safe_load(files['everything'].read_text())
        files['everything'].write_text(yaml.safe_dump({'again_everything': everything}))
        launched = subprocess.Popen(['roslaunch', str(launch)], stdout=subprocess.DEVNULL)
        try:
            for way in files:
                client = Client(f'/again_{way}/{names.get(way, way)}', timeout=SECONDS)
                self.assertEqual((way, self.values_of(client)), (way, {**self.defaults, **TUNED}))
                self.assertFalse(rospy.has_param(f'/again_{way}/{names.get(way, way)}/config'), 'taken once only')
            overruled = self.values_of(Client('/overruled', timeout=SECONDS))
            self.assertEqual(overruled, {**self.defaults, **TUNED, 'detector': 'fast'})
            preset = self.values_of(Client('/preset', timeout=SECONDS))
            self.assertEqual(preset, {**self.defaults, **settings.of_preset('even')})
        finally:
            launched.terminate()
            launched.wait(SECONDS)

    def test_the_sliders_move_the_node_and_follow_it(self):
        with _Screen() as display:
            root = tkinter.Tk(screenName=display)
            window = SlidersWindow(root, NODE)

            def pump(wanted, what):
                deadline = time.monotonic() + SECONDS
                while not wanted():
                    self.assertLess(time.monotonic(), deadline, f'{what}; it says: {window.status.get()}')
                    root.update()
                    time.sleep(0.01)

            def node_has(**values):
                return lambda: values.items() <= self.client.get_configuration(SECONDS).items()

            try:
                pump(lambda: window.values, 'values have come')
                self.assertIn(NODE, window.nodes['values'])
                self.assertEqual(list(window.values), list(self.defaults))
                rows = window.panel.rows
                threshold = rows['threshold'].range.value(60)
                self.assertNotEqual(threshold, self.defaults['threshold'])
                rows['threshold'].scale.set(60)
                pump(node_has(threshold=threshold), 'the node follows the slider')
                rows['window_size'].set(8)
                pump(lambda: rows['window_size'].value == 9, 'the slider shows what the node made of it')
                self.client.update_configuration({'ANMS': True})
                pump(lambda: rows['ANMS'].value, 'the window follows the node')

                moved = {'threshold': threshold, 'window_size': 9, 'ANMS': True}
                file = self.folder / 'saved.yaml'
                window.save(str(file))
                window.buttons['Reset'].invoke()
                pump(node_has(**self.defaults), 'reset')
                window.load(str(file))
                pump(node_has(**moved), 'load')
                self.assertEqual(settings.read(file), {**self.defaults, **moved})
                self.assertEqual(run('rosparam', 'load', str(file), '/elsewhere').returncode, 0)
                file.write_text('threshold: 0.07\nnothing: 1')
                window.load(str(file))
                self.assertIn('nothing', window.status.get())
                pump(node_has(threshold=0.07), 'what is known is taken')
                window.take_preset('matching')
                pump(node_has(**settings.of_preset('matching')), 'preset')
                window.load(str(self.folder / 'none.yaml'))
                self.assertIn('No such file', window.status.get())
            finally:
                window.close()

    def test_without_a_master_the_nodes_say_what_they_are(self):
        environment = {**os.environ, 'ROS_MASTER_URI': 'http://127.0.0.1:9'}
        environment.pop('DISPLAY', None)
        for node, told in (('feature_detector', 'Subscribed topics'), ('compare_mosaic', 'Published topics'),
                           ('republish', 'compressed'), ('sliders', 'rqt_reconfigure'), ('view', 'image_view')):
            result = run('rosrun', 'rvc_features', node, '--help', env=environment)
            self.assertEqual((node, result.returncode), (node, 0), result.stderr)
            self.assertIn(told, result.stdout)
            result = run('rosrun', 'rvc_features', node, '--wrong', env=environment)
            self.assertEqual((node, result.returncode), (node, 2))
            self.assertRegex(result.stderr, 'usage: .*\n.*(unrecognized arguments: --wrong|arguments are required)')
        result = run('rosrun', 'rvc_features', 'sliders', env=environment)
        self.assertEqual((result.returncode, result.stderr.count('\n')), (1, 1))
        self.assertIn('sliders: no screen to show a window on', result.stderr)

    def test_no_argument_of_a_launch_file_is_required(self):
        for name in ('feature_detector', 'demo', 'compare'):
            result = run('roslaunch', '--ros-args', 'rvc_features', f'{name}.launch')
            self.assertIn('Optional Arguments', result.stdout, result.stderr)
            self.assertNotIn('Required Arguments', result.stdout)


class _Screen:
    """A screen in memory."""

    def __enter__(self):
        if shutil.which('Xvfb') is None:
            raise unittest.SkipTest('Xvfb is not installed')
        reader, writer = os.pipe()
        self._server = subprocess.Popen(['Xvfb', '-displayfd', str(writer)], pass_fds=[writer],
                                        stderr=subprocess.DEVNULL)
        os.close(writer)
        with os.fdopen(reader) as answer:
            return f':{answer.readline().strip()}'

    def __exit__(self, *_):
        self._server.terminate()
        self._server.wait(SECONDS)


if __name__ == '__main__':
    rostest.rosrun('rvc_features', 'settings', TestSettings, sys.argv)
