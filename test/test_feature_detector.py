#!/usr/bin/env python3
"""The node end to end, by the content of what it publishes."""

import sys
import unittest

import cv2
import numpy as np
import rosgraph
import rospy
import rostest
from ros_helpers import Camera, Diagnostics, Inbox, exchange_until, square, texture
from rvc_features.msg import KeyPoints
from sensor_msgs.msg import Image

from rvc_features import detectors
from rvc_features.drawing import draw_key_points
from rvc_features.image_transport.messages import to_array

CORNERS = {(60, 60), (60, 99), (99, 60), (99, 99)}


class TestFeatureDetector(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.camera = Camera('camera/image_raw')
        cls.diagnostics = Diagnostics('feature_detector')
        cls.key_points = Inbox('key_points', KeyPoints)
        cls.pictures = Inbox('annotated', Image)
        cls.responses = Inbox('response', Image)
        exchange_until(cls.camera, square(), [cls.key_points, cls.pictures, cls.responses])

    def answer(self, inbox, image, *arguments, **changes):
        stamp = self.camera.send(image, *arguments, **changes)
        return inbox.wait_for(lambda message: message.header.stamp == stamp, f'the answer of {stamp}')

    def test_key_points_are_those_of_the_detector(self):
        message = self.answer(self.key_points, square())
        self.assertEqual({(round(x), round(y)) for x, y in zip(message.x, message.y)}, CORNERS)
        self.assertEqual((message.detector, message.width, message.height), ('harris', 160, 160))
        self.assertEqual(message.header.frame_id, 'camera_optical')
        image = texture()
        message = self.answer(self.key_points, image)
        expected = detectors.create('harris', threshold=0.1).detect_arrays(image)
        self.assertGreater(len(expected), 100)
        for name in expected.dtype.names:
            np.testing.assert_array_equal(np.array(getattr(message, name), expected.dtype[name]), expected[name])

    def test_the_picture_is_a_drawing_on_a_copy_of_the_image(self):
        detector = detectors.create('harris', threshold=0.1)
        colour = cv2.applyColorMap(texture(), cv2.COLORMAP_JET)
        for image in (square(), colour):
            message = self.answer(self.pictures, image)
            self.assertEqual((message.encoding, message.header.frame_id), ('bgr8', 'camera_optical'))
            grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
            np.testing.assert_array_equal(to_array(message, 'bgr8'),
                                          draw_key_points(image, detector.detect_arrays(grey)))

    def test_the_response_shows_corners_bright_and_edges_not(self):
        message = self.answer(self.responses, square())
        self.assertEqual(message.encoding, 'mono8')
        picture = to_array(message, 'mono8')
        self.assertEqual(picture[60, 60], 255)
        self.assertLess(picture[60, 80], 140)
        self.assertEqual(picture[10, 10], 128)

    def test_encodings_of_real_cameras(self):
        grey = square()
        images = {
            'mono8': grey, '8UC1': grey, 'bgr8': np.dstack([grey] * 3), 'rgb8': np.dstack([grey] * 3),
            '8UC3': np.dstack([grey] * 3), 'bgra8': np.dstack([grey] * 4), 'rgba8': np.dstack([grey] * 4),
            'mono16': grey.astype(np.uint16) << 8, '16UC1': grey.astype(np.uint16) * 20 + 500,
            '32FC1': np.where(grey > 0, 1.5, np.float32(4.0)).astype(np.float32),
            'bayer_rggb8': grey, 'yuv422': np.dstack([np.full_like(grey, 128), grey]),
        }
        for encoding, image in images.items():
            message = self.answer(self.key_points, image, encoding)
            points = np.column_stack((message.x, message.y))
            for corner in CORNERS:
                self.assertLess(np.hypot(*(points - corner).T).min(), 3, f'{encoding}: corner {corner} not found')

    def test_padded_rows(self):
        padded = np.full((160, 200), 255, np.uint8)
        padded[:, :160] = square()
        message = self.answer(self.key_points, square(), step=200, data=padded.tobytes())
        self.assertEqual({(round(x), round(y)) for x, y in zip(message.x, message.y)}, CORNERS)

    def test_bad_images_are_counted_and_skipped(self):
        self.answer(self.key_points, square())
        self.diagnostics.messages.clear()
        before = self.diagnostics.wait_for_values(lambda values: True, 'a report')
        rejected = int(before['frames rejected'])
        for number, (text, changes) in enumerate({
            'data has 100 bytes': {'data': bytes(100)},
            'unknown encoding': {'encoding': 'abc8'},
            'without pixels': {'width': 0, 'height': 0, 'step': 0, 'data': b''},
            'step is 3': {'step': 3},
        }.items(), 1):
            stamp = self.camera.send(square(), **changes)
            values = self.diagnostics.wait_for_values(
                lambda values, count=rejected + number: int(values['frames rejected']) == count, text)
            self.assertIn(text, values['last rejected because'])
            self.assertFalse([message for message in self.key_points.messages if message.header.stamp == stamp])
        self.answer(self.key_points, square())

    def test_every_frame_is_either_processed_or_counted_as_dropped(self):
        self.answer(self.key_points, square())
        image = texture((960, 1280))
        for _ in range(30):
            last = self.camera.send(image)
        self.key_points.wait_for(lambda message: message.header.stamp == last, 'the newest frame')
        ends = ('processed', 'dropped for newer ones', 'rejected')
        self.diagnostics.messages.clear()   # an earlier report accounts for fewer frames
        # The last one is counted only after it has been sent.
        values = self.diagnostics.wait_for_values(
            lambda values: int(values['frames received']) == sum(int(values[f'frames {end}']) for end in ends),
            'a report that accounts for every frame')
        self.assertGreaterEqual(int(values['frames received']), 30)
        self.assertGreater(int(values['frames dropped for newer ones']), 0)

    def test_zz_the_camera_is_subscribed_to_only_while_somebody_listens(self):
        """Runs last, by its name: it takes the listeners away."""
        for inbox in (self.key_points, self.pictures, self.responses):
            inbox.close()
        self.camera.send(square())   # rospy notices on sending that nobody listens any more
        self.diagnostics.messages.clear()
        self.diagnostics.wait_for_values(lambda values: values['message'].startswith('idle'), 'idle')
        subscribed = dict(rosgraph.Master('/test').getSystemState()[1])
        self.assertNotIn('/feature_detector', subscribed.get('/camera/image_raw', []))
        again = Inbox('annotated', Image)
        exchange_until(self.camera, square(), [again])
        again.close()


if __name__ == '__main__':
    rospy.init_node('test_feature_detector')
    rostest.rosrun('rvc_features', 'feature_detector', TestFeatureDetector, sys.argv)
