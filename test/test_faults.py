#!/usr/bin/env python3
"""What goes wrong on a robot, one thing at a time, and what the node says and does then."""

import logging
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import unittest
import unittest.mock
from pathlib import Path

import rosgraph
import rospy
import rostest
from dynamic_reconfigure.client import Client
from faulty_detectors import RUBBISH
from ros_helpers import SECONDS, Camera, Diagnostics, Inbox, exchange_until, square
from rosgraph_msgs.msg import Log
from rvc_features.msg import KeyPoints
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import String

from rvc_features.brief import Reporter
from rvc_features.nodes.lazy_input import LazyInput
from rvc_features.nodes.library_log import RosLog, log_without_master

OK, WARN, ERROR = 0, 1, 2


class TestDetectors(unittest.TestCase):
    """Somebody's own, under a node that goes on."""

    @classmethod
    def setUpClass(cls):
        cls.inbox, cls.camera = Inbox('key_points', KeyPoints), Camera('camera')
        cls.diagnostics = Diagnostics('faulty')
        cls.client = Client('/faulty', timeout=SECONDS)
        exchange_until(cls.camera, square(), [cls.inbox])   # whatever else the node's topics connect to first

    def tearDown(self):
        self.client.update_configuration({'detector': 'harris'})

    def rejected(self):
        self.diagnostics.messages.clear()
        return int(self.diagnostics.wait_for_values(lambda values: True, 'a report')['frames rejected'])

    def use(self, kind):
        self.client.update_configuration({'detector': 'faulty', 'faulty_kind': kind})
        return self.camera.send(square())

    def right_again(self):
        self.client.update_configuration({'detector': 'harris'})
        stamp = self.camera.send(square())
        message = self.inbox.wait_for(lambda message: message.header.stamp == stamp, 'key points of harris')
        self.assertEqual(len(message.x), 4)

    def test_rubbish_is_refused_and_key_points_come_again(self):
        """An array of another type made rospy's publish fail half way, and nothing ever came again."""
        for kind in RUBBISH:
            if kind in ('hang', 'hang for ever', 'huge'):
                continue
            before = self.rejected()
            self.use(kind)
            values = self.diagnostics.wait_for_values(
                lambda values, before=before: int(values['frames rejected']) > before, kind)
            self.assertGreaterEqual(values['level'], WARN, kind)
            self.assertIn({'exit': 'SystemExit: enough', 'raise': 'ZeroDivisionError'}.get(kind, "detector 'faulty'"),
                          values['last rejected because'])
            self.right_again()
        for cause in ('must return an array', 'SystemExit: enough', 'ZeroDivisionError'):
            self.assertIn(cause, values['rejected because'])

    def test_a_size_beyond_the_image_is_drawn_without_harm(self):
        pictures = Inbox('image', Image)
        self.addCleanup(pictures.close)
        stamp = self.use('huge')
        message = self.inbox.wait_for(lambda message: message.header.stamp == stamp, 'key points of a huge size')
        self.assertEqual(list(message.size), [1e6])
        exchange_until(self.camera, square(), [pictures])
        self.right_again()

    def test_one_that_hangs_is_seen_while_it_does(self):
        self.diagnostics.messages.clear()
        self.use('hang')
        values = self.diagnostics.wait_for_values(lambda values: 'has been at work' in values['message'], 'hanging')
        self.assertGreaterEqual(values['level'], WARN)
        self.assertIn('faulty has been at work on one image for', values['message'])
        self.right_again()

    def test_one_that_hangs_for_ever_is_an_error_and_another_detector_brings_the_node_back(self):
        self.diagnostics.messages.clear()
        self.use('hang for ever')
        values = self.diagnostics.wait_for_values(lambda values: values['level'] == ERROR, 'an error')
        self.assertRegex(values['message'], 'faulty has been at work on one image for 1[0-9] s')
        self.client.update_configuration({'detector': 'fast'})
        values = self.diagnostics.wait_for_values(lambda values: 'still hang' in values['message'], 'given up')
        self.assertIn('1 calls of detectors that were given up still hang', values['message'])
        self.assertNotIn('at work', values['message'])
        self.right_again()


class TestWhatTheNodeSays(unittest.TestCase):
    def status_of(self, node, text):
        diagnostics = Diagnostics(node)
        self.addCleanup(diagnostics.close)
        return diagnostics.wait_for_values(lambda values: text in values['message'], f'{node}: {text}')

    def test_a_module_that_hangs_while_it_is_imported(self):
        """Seen while it does, and afterwards, when the node goes on without it."""
        values = self.status_of('slow/slow_start', "'hanging_module'")
        if values['level'] == WARN:
            self.assertEqual(values['message'], "starting: importing 'hanging_module'")
        else:
            self.assertIn("'hanging_module' hangs while it is imported (for more than 30 s): not", values['message'])
            self.assertEqual(values['level'], ERROR)

    def test_a_topic_of_another_type(self):
        publisher = rospy.Publisher('strange/text', String, queue_size=1)
        listener = Inbox('strange/key_points', KeyPoints)
        self.addCleanup(listener.close)
        values = self.status_of('strange/wrong_type', 'is of type')
        self.assertIn('/strange/text is of type std_msgs/String; sensor_msgs/Image is wanted', values['message'])
        self.assertEqual(values['level'], ERROR)
        publisher.unregister()

    def test_a_camera_that_is_only_compressed(self):
        publisher = rospy.Publisher('packed/compressed', CompressedImage, queue_size=1)
        values = self.status_of('compressed/wrong_transport', 'nobody publishes /packed (raw)')
        self.assertIn('set ~image_transport to compressed, which is there', values['message'])
        self.assertEqual(values['level'], WARN)
        publisher.unregister()

    def test_an_output_on_the_cameras_own_topic(self):
        camera = Camera('looped')
        self.addCleanup(camera.publisher.unregister)
        values = self.status_of('loop/wrong_output', 'is published by')
        self.assertIn(f'/looped is published by {rospy.get_name()}, too', values['message'])
        self.assertEqual(values['level'], WARN)


class TestLog(unittest.TestCase):
    """What ROS's own libraries log, under a fault that lasts."""

    def test_each_kind_is_one_short_line_and_then_a_count(self):
        logger, said = logging.getLogger('rospy.internal'), []
        handler = logging.Handler(logging.WARNING)
        handler.emit = lambda record: said.append(record.getMessage())
        logger.addHandler(handler)
        self.addCleanup(logger.removeHandler, handler)
        quiet = RosLog()
        quiet.install()
        self.addCleanup(logger.removeFilter, quiet)
        clock = [1000.0]

        def a_minute():
            for number in range(600):   # with texts that never are the same
                try:
                    raise ConnectionResetError(f'number {number} ' * 100)
                except ConnectionResetError:
                    rospy.core.rospyerr(traceback.format_exc())
                    rospy.core.rospywarn(f'Unknown error initiating TCP/IP socket to 10.0.0.{number}')
                clock[0] += 0.1

        with unittest.mock.patch('rvc_features.nodes.library_log.reporter', return_value=Reporter(lambda: clock[0])):
            thread = threading.Thread(target=a_minute)   # as rospy's are
            thread.start()
            thread.join()
        self.assertEqual(len(said), 4)
        raised = [line for line in said if line.startswith('ConnectionResetError: number ')]
        self.assertEqual(len(raised), 2)
        self.assertLessEqual(sum(map(len, raised)), 320)
        self.assertTrue(all('\n' not in line and 'Traceback' not in line for line in said))
        self.assertIn('(and 99 more in 10 s)', said[-1])


    def test_a_line_for_rosout_asks_the_master_nothing(self):
        log_without_master()
        with unittest.mock.patch.object(rospy.client._param_server, 'target') as master:
            rospy.logwarn('nobody is asked')   # latched: who comes later gets it, too
        self.assertEqual(master.mock_calls, [])
        lines = Inbox('/rosout', Log)
        self.addCleanup(lines.close)
        lines.wait_for(lambda line: line.msg == 'nobody is asked', 'the line')


class TestLazyInput(unittest.TestCase):
    """Subscribing fails: the thread that does it neither ends nor spins."""

    def test_it_is_tried_again_less_and_less_often_and_the_reason_is_kept(self):
        attempts, listeners = [], [1]

        def subscribe():
            attempts.append(1)
            if len(attempts) < 4:
                raise ConnectionRefusedError('no master')
            return FakeSubscriber()

        lazy = LazyInput(subscribe, lambda: listeners[0])
        with unittest.mock.patch('rvc_features.nodes.lazy_input.time') as clock:
            for second in range(30):
                clock.monotonic.return_value = 1000.0 + second
                lazy.update()
                if second == 5:
                    self.assertEqual(len(attempts), 3)   # at 0, 1 and 3 seconds
                    self.assertEqual(lazy.problem, 'can not subscribe: ConnectionRefusedError: no master')
        self.assertEqual(len(attempts), 4)
        self.assertEqual(lazy.problem, '')
        listeners[0] = 0
        lazy.update()   # and what it raises when it is shut down does no harm
        self.assertIsNone(lazy.subscriber)


class FakeSubscriber:
    def shutdown(self):
        raise ConnectionRefusedError('no master')


class TestProcesses(unittest.TestCase):
    """Nodes under masters of their own, which can be taken away."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        with socket.socket() as free:
            free.bind(('localhost', 0))
            self.port = free.getsockname()[1]
        self.uri = f'http://localhost:{self.port}/'
        self.environment = {**os.environ, 'ROS_MASTER_URI': self.uri, 'ROS_LOG_DIR': folder.name,
                            'ROS_HOSTNAME': 'localhost'}

    def start(self, *command, name='output'):
        with open(self.folder / name, 'w') as output:
            process = subprocess.Popen(command, env=self.environment, start_new_session=True, stdout=output,
                                       stderr=output)
        self.addCleanup(process.wait, SECONDS)
        self.addCleanup(end_session, process.pid)
        return process

    def start_master(self):
        process = self.start('rosmaster', '--core', '-p', str(self.port))
        self.wait_for(lambda: self.master().is_online(), 'the master')
        return process

    def master(self):
        return rosgraph.Master('/test_faults', master_uri=self.uri)

    def wait_for(self, wanted, what):
        deadline = time.monotonic() + 2 * SECONDS
        while True:
            try:
                if wanted():
                    return
            except (OSError, rosgraph.MasterException):
                pass   # it is not there yet
            self.assertLess(time.monotonic(), deadline, f'{what}: not within {2 * SECONDS} s')
            time.sleep(0.1)

    def is_known(self):
        publishers, _, services = (dict(kind) for kind in self.master().getSystemState())
        return (publishers.get('/key_points') == publishers.get('/image/compressed') == ['/feature_detector']
                and '/feature_detector/set_parameters' in services
                and self.master().getParam('/feature_detector/threshold') == 0.125)

    def test_a_master_that_is_restarted_knows_the_node_again(self):
        master = self.start_master()
        node = self.start('rosrun', 'rvc_features', 'feature_detector', '_threshold:=0.125', name='node')
        self.wait_for(self.is_known, 'the node')
        os.killpg(master.pid, signal.SIGKILL)
        master.wait(SECONDS)
        self.start_master()
        self.wait_for(self.is_known, 'the node, again')
        os.killpg(node.pid, signal.SIGINT)
        self.assertEqual(node.wait(SECONDS), 0)
        text = (self.folder / 'node').read_text()
        self.assertIn('has been restarted: registered again', text)
        self.assertNotIn('Traceback', text)

    def test_told_to_end_at_any_moment_of_its_start_it_ends_without_a_traceback(self):
        self.start_master()
        for batch in range(3):
            nodes = []
            for number in range(4):
                name = f'node_{batch}_{number}'
                nodes.append((name, self.start('rosrun', 'rvc_features', 'feature_detector', f'__name:={name}',
                                               name=name)))
            for number, (_, process) in enumerate(nodes):
                time.sleep(0.15 + 0.17 * batch)   # not for anything to happen, but for a moment like any other
                os.killpg(process.pid, signal.SIGINT if number % 2 else signal.SIGTERM)
            for name, process in nodes:
                process.wait(SECONDS)
                text = (self.folder / name).read_text()
                if 'Fatal Python error: init_import_site' in text:
                    continue   # Python itself was interrupted, before it had come to our first line
                self.assertNotIn('Traceback', text)
                self.assertNotIn('Error', text)


def end_session(leader):
    subprocess.run(['pkill', '-KILL', '-s', str(leader)], check=False)


if __name__ == '__main__':
    rospy.init_node('test_faults')
    rostest.rosrun('rvc_features', 'faults', 'test_faults', sys.argv)
