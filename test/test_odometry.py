#!/usr/bin/env python3
"""What the node does for an odometry, end to end: mask, tracks, rays, descriptors, service, and the converters."""

import importlib.util
import io
import os
import re
import shutil
import subprocess
import sys
import threading
import unittest
from pathlib import Path

import cv2
import numpy as np
import rospy
import rostest
from dynamic_reconfigure.client import Client
from ros_helpers import Camera, Inbox, exchange_until, texture
from rosgraph_msgs.msg import Log
from rvc_features.msg import Descriptors, KeyPoints, Tracks
from rvc_features.srv import Detect
from sensor_msgs.msg import CameraInfo, Image, PointCloud
from std_msgs.msg import Bool, Header

from rvc_features import detectors
from rvc_features.image_transport.messages import to_array, to_image_message
from rvc_features.nodes import point_messages
from rvc_features.odometry.covariance import covariances
from rvc_features.odometry.descriptors import describe
from rvc_features.odometry.tracks import Tracker

K = [300.0, 0, 160, 0, 300, 120, 0, 0, 1]
D = [-0.2, 0.05, 0.001, 0.0, 0.0]
DETECTOR = detectors.create('harris', threshold=0.05)
DOCUMENT = Path(__file__).resolve().parents[1] / 'docs' / 'odometry.md'


def positions(message):
    return np.column_stack((message.x, message.y))


def messages_of(package):
    """The module of a package's messages; skips the test where it is not installed."""
    try:
        return importlib.import_module(f'{package}.msg')
    except ImportError:
        raise unittest.SkipTest(f'{package} is not installed here') from None


def example(start):
    """The code in the document that begins with that text."""
    return re.search(rf'```\w+\n({re.escape(start)}.*?)```', DOCUMENT.read_text(), re.DOTALL)[1]


class TestOdometry(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.camera = Camera('camera/image_raw')
        cls.masks = rospy.Publisher('mask', Image, queue_size=5)
        cls.calibrations = rospy.Publisher('camera/camera_info', CameraInfo, queue_size=5)
        cls.inboxes = {'key_points': Inbox('key_points', KeyPoints), 'tracks': Inbox('tracks', Tracks),
                       'descriptors': Inbox('descriptors', Descriptors), 'annotated': Inbox('annotated', Image)}
        cls.log = Inbox('/rosout', Log)
        exchange_until(cls.camera, texture(), cls.inboxes.values())
        cls.client = Client('feature_detector', timeout=20)

    def answer(self, topic, image, **changes):
        inbox = self.inboxes[topic]
        stamp = self.camera.send(image, **changes)
        stamp = changes['header'].stamp if 'header' in changes else stamp
        return inbox.wait_for(lambda message: message.header.stamp == stamp, f'{topic} of {stamp}')

    def send_until(self, publisher, message, topic, wanted):
        """Publish until the node's answer shows that it has it: topics connect when they connect."""
        for _ in range(100):
            publisher.publish(message)
            answer = self.answer(topic, texture())
            if wanted(answer):
                return answer
        raise AssertionError('the node never took it')

    def said(self, text):
        return self.log.wait_for(lambda message: text in message.msg, repr(text))

    def converted(self, topic, message_class, source, image):
        """What the converter makes of the answer to an image, and that answer."""
        inbox = Inbox(topic, message_class)
        for _ in range(100):   # topics connect when they connect
            answer = self.answer(source, image)
            inbox.wait_a_moment()
            for message in inbox.messages:
                header = message.markers[0].header if topic == 'rays' else message.header
                if header.stamp == answer.header.stamp:
                    inbox.close()
                    return message, answer
        raise AssertionError(f'nothing on {topic}')

    def test_messages_travel_as_ros_would_write_them(self):
        found, header = DETECTOR.detect_arrays(texture()), Header(7, rospy.Time(5, 6), 'kämera')
        key_points = point_messages.key_points_message(found, header, 'harris', (480, 640), None,
                                                       np.ones((len(found), 2, 2)))
        tracks = point_messages.tracks_message(Tracker().track(texture(), 5.0, DETECTOR), header, (480, 640))
        descriptors = point_messages.descriptors_message(*describe(texture(), found, 'orb'), header, 'orb', 'harris')
        for message, plain in ((key_points, KeyPoints()), (tracks, Tracks()), (descriptors, Descriptors())):
            for name in plain.__slots__:
                value = getattr(message, name)
                setattr(plain, name, value.tolist() if isinstance(value, np.ndarray) else value)
            expected = io.BytesIO()
            plain.serialize(expected)
            assert len(expected.getvalue()) > 1000
            assert b''.join(message.pieces()) == expected.getvalue()

    def test_masks_of_a_parameter_a_topic_and_the_border(self):
        self.assertTrue((np.rint(positions(self.answer('key_points', texture()))) >= 30).any(axis=1).all())
        mask = np.zeros((240, 320), np.uint8)
        mask[:, 160:] = 255
        left_out = self.send_until(self.masks, to_image_message(mask, 'mono8'), 'key_points',
                                   lambda message: message.x and min(message.x) >= 159.5)
        self.assertGreater(len(left_out.x), 20)
        # Of a wrong size or encoding: the last good one stays, and the log says why.
        for wrong, sentence in (
                (to_image_message(np.full((240, 320, 3), 255, np.uint8), 'bgr8'),
                 "mask refused, the last one stays: its encoding is 'bgr8'; accepted are mono8 and 8UC1"),
                (to_image_message(np.full((120, 160), 255, np.uint8), 'mono8'),
                 'mask refused: it has 160 x 120 pixels, and the images have 320 x 240, the last one that fits stays')):
            self.masks.publish(wrong)
            for _ in range(3):
                self.assertGreaterEqual(min(self.answer('key_points', texture()).x), 159.5)
                self.assertGreaterEqual(min(self.answer('tracks', texture()).x), 159.5)
            self.said(sentence)
        # Of long ago: it counts, and that it is stale is said.
        old = to_image_message(mask, 'mono8')
        old.header.stamp = rospy.Time(1)
        self.send_until(self.masks, old, 'key_points', lambda message: any(
            'the mask is stale: it is' in entry.msg for entry in self.log.messages))
        self.assertGreaterEqual(min(self.answer('key_points', texture()).x), 159.5)
        self.client.update_configuration({'border_right': 40, 'border_top': 50})
        message = self.answer('key_points', texture())
        self.assertLess(max(message.x), 280)
        self.assertGreaterEqual(min(message.y), 49.5)
        picture = to_array(self.answer('annotated', texture()), 'bgr8')
        np.testing.assert_allclose(picture[200:, :150, 0], texture()[200:, :150] / 2, atol=1)
        self.client.update_configuration({'border_right': 0, 'border_top': 0})
        self.send_until(self.masks, to_image_message(np.full((240, 320), 1, np.uint8), 'mono8'), 'key_points',
                        lambda message: min(message.x) < 100)

    def test_tracks_keep_their_ids_and_trails_are_drawn(self):
        self.client.update_configuration({'trails': True, 'number_of_tracks': 100})
        image = cv2.GaussianBlur(texture(), (0, 0), 2)
        self.answer('tracks', image)
        before = self.answer('tracks', image)
        for shift in (3, 6, 9):
            message = self.answer('tracks', np.roll(image, shift, axis=1))
        tracks = point_messages.from_tracks_message(message)
        old = tracks[tracks['age'] >= 3]
        self.assertGreater(len(old), 40)
        self.assertLessEqual(len(tracks), 100)
        then = point_messages.from_tracks_message(before)
        _, now, earlier = np.intersect1d(old['id'], then['id'], return_indices=True)
        self.assertLess(np.median(np.abs(old['x'][now] - then['x'][earlier] - 9)), 0.2)
        self.assertLess(np.median(np.abs(old['velocity_x'] - 3)), 0.1)   # the stamps are a second apart
        picture = to_array(self.answer('annotated', np.roll(image, 12, axis=1)), 'bgr8')
        self.client.update_configuration({'trails': False})
        plain = to_array(self.answer('annotated', np.roll(image, 12, axis=1)), 'bgr8')
        self.assertGreater(np.count_nonzero((picture != plain).any(axis=2)), 500)
        last = max(message.id)
        earlier_stamp = to_image_message(image, 'mono8').header
        earlier_stamp.stamp = rospy.Time(5)
        again = self.answer('tracks', image, header=earlier_stamp)
        self.assertEqual(set(again.age), {0})
        self.assertGreater(min(again.id), last)

    def test_rays_and_the_converter_to_vins(self):
        """In key points and tracks, once there is a calibration; then as VINS-Mono's estimator reads them."""
        info = CameraInfo(width=320, height=240, distortion_model='plumb_bob', K=K, D=D)
        message = self.send_until(self.calibrations, info, 'key_points', lambda message: message.ray_x)

        def rays_of(points):
            return cv2.undistortPoints(points[:, None].astype(np.float64), np.reshape(K, (3, 3)), np.array(D))[:, 0]

        rays = np.column_stack((message.ray_x, message.ray_y))
        np.testing.assert_allclose(rays, rays_of(positions(message)), atol=1e-6)

        clouds, restarts = Inbox('vins', PointCloud), Inbox('vins_restart', Bool)
        image = cv2.GaussianBlur(texture(), (0, 0), 2)
        shift = 0
        while not clouds.messages:
            shift += 2
            self.assertLess(shift, 400, 'no point cloud')
            self.answer('tracks', np.roll(image, shift, axis=1))
            clouds.wait_a_moment()
        tracks = self.answer('tracks', np.roll(image, shift + 2, axis=1))
        cloud = clouds.wait_for(lambda cloud: cloud.header.stamp == tracks.header.stamp, 'the cloud of the tracks')
        seen = np.array(tracks.age) > 0
        self.assertEqual(cloud.header.frame_id, 'world')
        self.assertEqual(len(cloud.points), np.count_nonzero(seen))
        np.testing.assert_array_equal([point.z for point in cloud.points], 1)
        expected = rays_of(positions(tracks)[seen])
        np.testing.assert_allclose([(point.x, point.y) for point in cloud.points], expected, atol=1e-6)
        identity, u, v, velocity_x, velocity_y = (np.array(channel.values) for channel in cloud.channels)
        np.testing.assert_array_equal(identity, np.array(tracks.id)[seen])
        np.testing.assert_array_equal(np.column_stack((u, v)), positions(tracks)[seen])
        velocity = np.column_stack((tracks.velocity_x, tracks.velocity_y))[seen]
        before = rays_of(positions(tracks)[seen] - velocity)   # the stamps are a second apart
        np.testing.assert_allclose(np.column_stack((velocity_x, velocity_y)), expected - before, atol=1e-5)

        # The camera is started again: VINS-Mono is told to, and gets no tracks of that image, but those of the next.
        self.assertEqual(restarts.messages, [])
        for seconds in (15.0, 15.5, 17.0, 17.5):   # back, on, a gap, on
            header = to_image_message(image, 'mono8').header
            header.stamp = rospy.Time.from_sec(seconds)
            self.answer('tracks', image, header=header)
        clouds.wait_for(lambda cloud: cloud.header.stamp.to_sec() == 15.5, 'the cloud after the clock went back')
        clouds.wait_for(lambda cloud: cloud.header.stamp.to_sec() == 17.5, 'the cloud after the gap')
        self.assertEqual([restart.data for restart in restarts.messages], [True, True])
        self.assertFalse(any(cloud.header.stamp.to_sec() in (15.0, 17.0) for cloud in clouds.messages))

        info.width = 640
        self.send_until(self.calibrations, info, 'key_points', lambda message: not message.ray_x)

    def test_key_points_for_opencv_apps(self):
        module = messages_of('opencv_apps')
        message, expected = self.converted('points', module.Point2DArrayStamped, 'key_points', texture())
        self.assertEqual(message.header.frame_id, 'camera_optical')
        np.testing.assert_array_equal(positions(expected), [(point.x, point.y) for point in message.points])
        self.assertGreater(len(message.points), 20)

    def test_markers_and_rays_for_viewers(self):
        module = messages_of('visualization_msgs')
        message, expected = self.converted('markers', module.ImageMarker, 'key_points', texture())
        self.assertEqual((message.type, message.action), (module.ImageMarker.POINTS, module.ImageMarker.ADD))
        np.testing.assert_array_equal(positions(expected), [(point.x, point.y) for point in message.points])
        info = CameraInfo(width=320, height=240, distortion_model='plumb_bob', K=K, D=D)
        self.send_until(self.calibrations, info, 'key_points', lambda message: message.ray_x)
        message, expected = self.converted('rays', module.MarkerArray, 'tracks', texture())
        marker, = message.markers
        self.assertEqual(marker.type, module.Marker.LINE_LIST)
        ends = np.array([(point.x, point.y, point.z) for point in marker.points]).reshape(-1, 2, 3)
        self.assertFalse(ends[:, 0].any())
        np.testing.assert_allclose(np.linalg.norm(ends[:, 1], axis=1), 1)
        np.testing.assert_allclose(ends[:, 1, :2] / ends[:, 1, 2:], np.column_stack((expected.ray_x, expected.ray_y)))

    def test_the_example_that_pairs_images_and_key_points(self):
        if importlib.util.find_spec('message_filters') is None:
            self.skipTest('message_filters is not installed here')
        code = example('import message_filters')
        consumer = subprocess.Popen([sys.executable, '-u', '-c', code, '/feature_detector/key_points:=/key_points'],
                                    stdout=subprocess.PIPE, text=True)
        lines = []
        reader = threading.Thread(target=lambda: lines.extend(consumer.stdout), daemon=True)
        try:
            reader.start()
            for _ in range(200):
                found = len(self.answer('key_points', texture()).x)
                if lines:
                    break
                reader.join(0.1)
        finally:
            consumer.kill()
            consumer.wait()
        self.assertRegex(''.join(lines), f'{found} points in image [0-9]+')

    def test_the_example_in_cpp_compiles(self):
        prefixes = [*os.environ['CMAKE_PREFIX_PATH'].split(os.pathsep), '/usr']
        includes = [folder for folder in (Path(prefix) / 'include' for prefix in prefixes) if folder.is_dir()]
        if not shutil.which('g++') or not any((folder / 'ros' / 'ros.h').is_file() for folder in includes):
            self.skipTest('no compiler of C++ or no headers of roscpp here')
        compiled = subprocess.run(
            ['g++', '-fsyntax-only', '-Wall', '-x', 'c++', *(f'-I{folder}' for folder in includes[:-1]), '-'],
            input=example('#include <cmath>'), stderr=subprocess.PIPE, text=True, check=False)
        self.assertEqual(compiled.returncode, 0, compiled.stderr)

    def test_covariances_come_with_the_key_points_when_asked_for(self):
        image = texture(seed=5)
        self.assertEqual(len(self.answer('key_points', image).covariance_xx), 0)
        self.client.update_configuration({'covariance': True, 'covariance_noise': 2.0})
        message = self.answer('key_points', image)
        self.client.update_configuration({'covariance': False})
        found = point_messages.from_key_points_message(message)
        expected = covariances(image, found, DETECTOR, 2.0)
        np.testing.assert_array_equal(np.column_stack((message.covariance_xx, message.covariance_xy,
                                                       message.covariance_yy)), expected.reshape(-1, 4)[:, [0, 1, 3]])
        self.assertGreater(len(found), 20)

    def test_descriptors_are_those_of_the_key_points(self):
        image = texture(seed=3)
        found = DETECTOR.detect_arrays(image, np.pad(np.full((210, 290), 255, np.uint8), ((30, 0), (30, 0))))
        for name in ('sift', 'orb'):
            self.client.update_configuration({'descriptor': name})
            message = self.answer('descriptors', image)
            self.assertEqual((message.name, message.detector), (name, 'harris'))
            points = point_messages.from_key_points_message(self.answer('key_points', image))
            which, rows = point_messages.from_descriptors_message(message)
            expected_which, expected_rows = describe(image, points, name)
            np.testing.assert_array_equal(which, expected_which)
            np.testing.assert_array_equal(rows, expected_rows)
            self.assertGreater(len(which), len(found) // 3)

    def test_the_service_answers_for_one_image_or_says_why_not(self):
        rospy.wait_for_service('detect', 20)
        detect = rospy.ServiceProxy('detect', Detect)
        image = texture(seed=7)
        request = to_image_message(image, 'mono8')
        request.header.frame_id = 'somewhere'
        answer = detect(Image(request.header, 240, 320, 'mono8', 0, 320, image.tobytes())).key_points
        self.assertEqual((answer.detector, answer.width, answer.height, answer.header.frame_id),
                         ('harris', 320, 240, 'somewhere'))
        expected = self.answer('key_points', image)
        self.assertEqual(answer.x, expected.x)
        with self.assertRaisesRegex(rospy.ServiceException, "no key points of that image: .*'abc8'"):
            detect(Image(request.header, 240, 320, 'abc8', 0, 320, image.tobytes()))


if __name__ == '__main__':
    rospy.init_node('test_odometry')
    rostest.rosrun('rvc_features', 'odometry', TestOdometry, sys.argv)
