#!/usr/bin/env python3
"""The tools as a user runs them: make_bag, rosbag play into the node, the demo, and the node's end."""

import contextlib
import io
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

import cv2
import numpy as np
import rosbag
import rospy
import rostest
import yaml
from ros_helpers import SECONDS, Diagnostics, Inbox, texture
from rvc_features.msg import KeyPoints
from sensor_msgs.msg import Image

from rvc_features import detectors
from rvc_features.demo.play import _Session
from rvc_features.image_transport.messages import to_array
from rvc_features.recordings import make_bag, unmake_bag
from rvc_features.recordings.bags import BagImages
from rvc_features.recordings.image_sources import SourceError, Video

CALIBRATION = {
    'image_width': 320, 'image_height': 240, 'distortion_model': 'plumb_bob',
    'distortion_coefficients': {'rows': 1, 'cols': 5, 'data': [0.1, -0.2, 0, 0, 0]},
    'camera_matrix': {'rows': 3, 'cols': 3, 'data': [300, 0, 160, 0, 300, 120, 0, 0, 1]},
    'rectification_matrix': {'rows': 3, 'cols': 3, 'data': [1, 0, 0, 0, 1, 0, 0, 0, 1]},
    'projection_matrix': {'rows': 3, 'cols': 4, 'data': [300, 0, 160, 0, 0, 300, 120, 0, 0, 0, 1, 0]},
}


def run(*command, **options):
    return subprocess.run(['rosrun', 'rvc_features', *command], capture_output=True, text=True, timeout=90,
                          check=False, **options)


def wait_until(reached, patience=60):
    deadline = time.monotonic() + patience
    while not reached():
        assert time.monotonic() < deadline, 'it does not come'
        time.sleep(0.05)


def descendants(process):
    children = Path(f'/proc/{process}/task/{process}/children').read_text().split()
    return [int(child) for child in children] + [each for child in children for each in descendants(child)]


def runs(process):
    try:
        return Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except FileNotFoundError:
        return False


def call(main, *arguments):
    """What `run` gives, of a tool's function in this process: quicker."""
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        try:
            status = main([str(argument) for argument in arguments])
        except SystemExit as stop:     # argparse's
            status = stop.code
    return subprocess.CompletedProcess(arguments, status, out.getvalue(), errors.getvalue())


class TestTools(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)
        self.images = [texture(seed=number) for number in range(6)]
        (self.folder / 'frames').mkdir()
        for number, image in enumerate(self.images):
            cv2.imwrite(str(self.folder / 'frames' / f'img{number}.png'), image)
        self.bag = str(self.folder / 'made.bag')

    def make_bag(self, *options):
        result = call(make_bag.main, self.bag, self.folder / 'frames', *options)
        self.assertEqual(result.returncode, 0, result.stderr)
        return result.stdout

    def test_make_bag(self):
        (self.folder / 'camera.yaml').write_text(yaml.safe_dump(CALIBRATION))
        made = run('make_bag', self.bag, str(self.folder / 'frames'), '--rate', '4', '--topic', '/left/image_raw',
                   '--frame-id', 'left', '--start', '1000', '--camera-info', str(self.folder / 'camera.yaml'))
        self.assertEqual(made.returncode, 0, made.stderr)
        self.assertIn('6 frames on /left/image_raw, 4 per second', made.stdout)
        with rosbag.Bag(self.bag) as bag:
            images = [message for _, message, _ in bag.read_messages(['/left/image_raw'])]
            infos = [message for _, message, _ in bag.read_messages(['/left/camera_info'])]
        self.assertEqual([message.header.stamp.to_sec() for message in images],
                         [1000 + number / 4 for number in range(6)])
        for message, info, image in zip(images, infos, self.images):
            self.assertEqual((message.header.frame_id, message.encoding), ('left', 'mono8'))
            np.testing.assert_array_equal(to_array(message, 'mono8'), image)
            self.assertEqual(str(info.header), str(message.header))
            self.assertEqual((info.K[0], info.P[5], info.D[1], info.width), (300, 300, -0.2, 320))
        self.assertEqual([frame.image.shape for frame in BagImages(self.bag, '/left/image_raw')], [(240, 320, 3)] * 6)

    def test_make_bag_refuses_with_one_sentence(self):
        for arguments, text in (
                ([self.bag, 'missing.png'], 'make_bag: missing.png: no such file or folder'),
                ([self.bag, str(self.folder)], 'no images in this folder'),
                ([self.bag, str(self.folder / 'frames'), '--camera-info', __file__], 'not a camera calibration'),
                ([str(self.folder / 'none' / 'x.bag'), str(self.folder / 'frames')], 'No such file or directory'),
                ([self.bag, str(self.folder / 'frames'), '--rate', '0'], "--rate: must be a positive number; got '0'"),
                ([self.bag, str(self.folder / 'frames'), '--rate', '1e-9'], 'give another --start, or a higher --rate'),
                ([self.bag, str(self.folder / 'frames'), '--topic', 'a b'], "'a b' is not a topic name"),
                ([self.bag, str(self.folder / 'frames'), '--topic', ''], "'' is not a topic name"),
                (['my.avi', str(self.folder / 'frames')], "its name must end in .bag; got 'my.avi'")):
            result = call(make_bag.main, *arguments)
            self.assertEqual(result.returncode, 2)
            self.assertIn(text, result.stderr)
            self.assertNotIn('Traceback', result.stderr)
            self.assertFalse(Path(self.bag).exists())

    def test_make_bag_replaces_nothing_unasked(self):
        Path(self.bag).write_text('precious')
        (self.folder / 'made.bag.part').symlink_to(self.folder / 'made.bag')    # what an earlier version wrote through
        refused = call(make_bag.main, self.bag, self.folder / 'frames')
        self.assertEqual(refused.returncode, 2)
        self.assertEqual(refused.stderr, f'make_bag: {self.bag}: there is such a file already; name another, or give '
                                         '--force\n')
        self.assertEqual(Path(self.bag).read_text(), 'precious')
        self.make_bag('--force')
        self.assertEqual(len(BagImages(self.bag)), 6)
        self.assertTrue((self.folder / 'made.bag.part').is_symlink())

    def test_unmake_bag_is_the_inverse(self):
        stamps = [1305031102_175304000 + 33_333_333 * number for number in range(6)]
        frames = self.folder / 'stamped'
        frames.mkdir()
        for stamp, image in zip(stamps, self.images):
            cv2.imwrite(str(frames / f'{stamp}.png'), image)        # as EuRoC names its files
        made = call(make_bag.main, self.bag, frames)
        self.assertEqual(made.returncode, 0, made.stderr)
        self.assertIn('6 frames on /camera/image_raw, at the times that came with the images, 0.167 s', made.stdout)
        with rosbag.Bag(self.bag) as bag:
            self.assertEqual([message.header.stamp.to_nsec() for _, message, _ in bag.read_messages()], stamps)

        back = self.folder / 'back'
        result = run('unmake_bag', self.bag, str(back))
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual(sorted(path.name for path in back.iterdir()),
                         [f'{stamp // 10 ** 9}.{stamp % 10 ** 9:09}.png' for stamp in stamps])
        for path, image in zip(sorted(back.iterdir()), self.images):
            np.testing.assert_array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), image)
        again = call(make_bag.main, self.folder / 'again.bag', back)
        self.assertEqual(again.returncode, 0, again.stderr)
        with rosbag.Bag(str(self.folder / 'again.bag')) as bag:
            self.assertEqual([message.header.stamp.to_nsec() for _, message, _ in bag.read_messages()], stamps)

        refused = call(unmake_bag.main, self.bag, back)
        self.assertEqual(refused.returncode, 2)
        self.assertIn('there is such a file already; name another place, or give --force', refused.stderr)
        video = self.folder / 'video.avi'
        result = call(unmake_bag.main, self.bag, video)
        self.assertEqual(result.returncode, 0, result.stderr)
        source = Video(video)
        self.assertAlmostEqual(source.rate, 30, delta=0.1)
        for frame, image in zip(source, self.images):
            self.assertLess(np.abs(frame.image[:, :, 0].astype(int) - image).mean(), 8)     # compressed as JPEG
        self.assertEqual(len(source), 6)

    def test_bags_that_can_not_be_read_are_named(self):
        self.make_bag()
        for topic, text in (('/other', f'{self.bag}: no images on topic /other; its image topics: /camera/image_raw'),):
            with self.assertRaisesRegex(SourceError, text):
                BagImages(self.bag, topic)
        self.assertEqual(BagImages(self.bag).topic, '/camera/image_raw')
        cut = self.folder / 'cut.bag'
        cut.write_bytes(Path(self.bag).read_bytes()[:3000])
        for path, text in ((cut, 'cut.bag: '), (self.folder / 'no.bag', 'no.bag: no such file'),
                           (__file__, 'not a bag')):
            with self.assertRaisesRegex(SourceError, text):
                BagImages(path)

    def test_rosbag_play_into_the_node(self):
        self.make_bag('--rate', '4', '--topic', '/in')
        inbox = Inbox('key_points', KeyPoints)
        played = subprocess.run(['rosbag', 'play', '--quiet', '--wait-for-subscribers', self.bag],
                                stdout=subprocess.DEVNULL, timeout=60, check=False)
        self.assertEqual(played.returncode, 0)
        with rosbag.Bag(self.bag) as bag:
            stamps = [message.header.stamp for _, message, _ in bag.read_messages()]
        for stamp, image in zip(stamps, self.images):
            message = inbox.wait_for(lambda message, stamp=stamp: message.header.stamp == stamp, f'frame of {stamp}')
            expected = detectors.create('harris').detect_arrays(image)
            self.assertEqual(list(message.x), expected['x'].tolist())

    def test_the_demo_on_a_bag_of_ones_own(self):
        self.bag = str(self.folder / "a bag's name.bag")
        self.make_bag('--rate', '5', '--topic', '/mine')
        output = self.folder / 'an "output" folder'
        result = run('demo', '--bag', self.bag, '--output', str(output))
        self.assertEqual(result.returncode, 0, result.stderr)
        rows = [line[13:].split() for line in result.stdout.splitlines() if line.startswith("a bag's name ")]
        self.assertEqual([row[-4:-2] for row in rows], [['1', '1']] * 6)           # every frame came out
        self.assertTrue(all(float(row[-1]) > 0.5 for row in rows), result.stdout)   # milliseconds
        self.assertIn('strongest 150', result.stdout)
        self.assertRegex(result.stdout, r'The node ran on (Numba \d|without Numba \().*, NumPy \d.*, OpenCV \d')
        sheet = cv2.imread(str(output / 'contact_sheet.png'))
        self.assertEqual(sheet.shape, (2 * (30 + 360 + 8), 3 * (480 + 8), 3))
        shown = cv2.resize(self.images[3], (480, 360), interpolation=cv2.INTER_AREA)
        for row in range(2):       # the same frame under each setting, and something drawn on it
            for column in range(3):
                tile = sheet[row * 398 + 34:row * 398 + 394, column * 488 + 4:column * 488 + 484].astype(int)
                share = (tile == shown[:, :, None]).all(axis=2).mean()
                self.assertTrue(0.3 < share < 0.99, share)
        with rosbag.Bag(str(output / 'output.bag')) as bag:
            self.assertEqual(bag.get_message_count('/feature_detector/image'), 6)
            self.assertEqual(bag.get_message_count('/feature_detector/key_points'), 6)
        self.assertIn("a bag's name", (output / 'summary.txt').read_text())
        refused = run('demo', '--bag', self.bag, '--topic', '/nothing', '--output', str(output))
        self.assertEqual(refused.returncode, 2)
        self.assertIn('its image topics: /mine', refused.stderr)

    def test_the_demo_holds_the_player_back_for_a_slow_node(self):
        session = _Session.__new__(_Session)
        session._changed, session._over, session._on_their_way = threading.Condition(), False, 0
        calls = queue.Queue()
        session._pause = calls.put
        holding = threading.Thread(target=session._hold_back, daemon=True)
        holding.start()
        for on_their_way, call in ((1, None), (2, True), (1, None), (0, False), (1, None)):
            with session._changed:
                session._on_their_way = on_their_way
                session._changed.notify_all()
            if call is not None:
                self.assertEqual(calls.get(timeout=SECONDS), call)
        with session._changed:
            session._over = True
            session._changed.notify_all()
        holding.join(SECONDS)
        self.assertEqual((holding.is_alive(), calls.empty()), (False, True))

    def test_the_demo_ends_at_once_and_is_alone_in_its_folder(self):
        self.make_bag('--rate', '0.1')   # it plays for much longer than a second demo takes to start on a busy machine
        output = self.folder / 'output'
        command = ['demo', '--bag', self.bag, '--output', str(output)]
        demo = subprocess.Popen(['rosrun', 'rvc_features', *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                text=True)
        try:
            wait_until(lambda: (output / 'launch.log').exists() and 'player' in (output / 'launch.log').read_text())
            second = run(*command)
            self.assertEqual((second.returncode, second.stdout), (2, ''))
            self.assertIn(f'demo: another demo is writing into {output}', second.stderr)
            launched = descendants(demo.pid)
            self.assertGreaterEqual(len(launched), 3)    # roslaunch, the node, the player
            demo.send_signal(signal.SIGTERM)
            _, errors = demo.communicate(timeout=15)
        finally:
            demo.kill()
            demo.communicate()
        self.assertEqual((demo.returncode, errors),
                         (143, 'demo: interrupted by SIGTERM; all that it started has ended\n'))
        self.assertFalse([process for process in launched if runs(process)])
        self.assertEqual([path.name for path in output.iterdir()], ['launch.log'])     # nothing half made

    def test_the_node_ends_at_once_when_told_to(self):
        environment = {**os.environ, 'PYTHONUNBUFFERED': '1'}
        for number, while_it_starts in ((signal.SIGINT, False), (signal.SIGTERM, False), (signal.SIGTERM, True)):
            node = subprocess.Popen(['rosrun', 'rvc_features', 'feature_detector', '__name:=ending', 'in:=/ending',
                                     'image:=/ending/image'], env=environment, stdout=subprocess.PIPE)
            try:
                pictures, diagnostics = Inbox('/ending/image', Image), Diagnostics('ending')
                if while_it_starts:   # the first thing of it that is there
                    rospy.wait_for_service('/ending/set_parameters', SECONDS)
                else:
                    diagnostics.wait_for_values(lambda values: True, 'a report of a node that runs')
                node.send_signal(number)
                self.assertEqual(node.wait(10), 0)
            finally:
                node.kill()
                node.communicate()
                pictures.close()
                diagnostics.close()


if __name__ == '__main__':
    rospy.init_node('test_tools')
    rostest.rosrun('rvc_features', 'tools', TestTools, sys.argv)
