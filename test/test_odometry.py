#!/usr/bin/env python3
"""What the node does for an odometry, end to end: mask, tracks, rays, descriptors, service, and the converters."""

import sys
import unittest

import cv2
import numpy as np
import rospy
import rostest
from dynamic_reconfigure.client import Client
from ros_helpers import Camera, Inbox, exchange_until, texture
from rvc_features.msg import Descriptors, KeyPoints, Tracks
from rvc_features.srv import Detect
from sensor_msgs.msg import CameraInfo, Image, PointCloud

from rvc_features import detectors
from rvc_features.image_transport.messages import to_array, to_image_message
from rvc_features.nodes import point_messages
from rvc_features.odometry.descriptors import describe

K = [300.0, 0, 160, 0, 300, 120, 0, 0, 1]
D = [-0.2, 0.05, 0.001, 0.0, 0.0]
DETECTOR = detectors.create('harris', threshold=0.05)


def positions(message):
    return np.column_stack((message.x, message.y))


class TestOdometry(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.camera = Camera('camera/image_raw')
        cls.masks = rospy.Publisher('mask', Image, queue_size=5)
        cls.calibrations = rospy.Publisher('camera/camera_info', CameraInfo, queue_size=5)
        cls.inboxes = {'key_points': Inbox('key_points', KeyPoints), 'tracks': Inbox('tracks', Tracks),
                       'descriptors': Inbox('descriptors', Descriptors), 'annotated': Inbox('annotated', Image)}
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

    def test_masks_of_a_parameter_a_topic_and_the_border(self):
        self.assertTrue((np.rint(positions(self.answer('key_points', texture()))) >= 30).any(axis=1).all())
        mask = np.zeros((240, 320), np.uint8)
        mask[:, 160:] = 255
        left_out = self.send_until(self.masks, to_image_message(mask, 'mono8'), 'key_points',
                                   lambda message: message.x and min(message.x) >= 159.5)
        self.assertGreater(len(left_out.x), 20)
        # Of a wrong size or encoding: the last good one stays, and the log says why.
        for wrong in (to_image_message(np.full((120, 160), 255, np.uint8), 'mono8'),
                      to_image_message(np.full((240, 320, 3), 255, np.uint8), 'bgr8')):
            self.masks.publish(wrong)
            for _ in range(3):
                self.assertGreaterEqual(min(self.answer('key_points', texture()).x), 159.5)
                self.assertGreaterEqual(min(self.answer('tracks', texture()).x), 159.5)
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

        clouds = Inbox('vins', PointCloud)
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

        info.width = 640
        self.send_until(self.calibrations, info, 'key_points', lambda message: not message.ray_x)

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
