#!/usr/bin/env python3
"""launch/compare.launch: a mosaic of detectors, by default and with detectors of the user's choice."""

import sys
import time
import unittest

import cv2
import numpy as np
import rospy
import rostest
from ros_helpers import Camera, Diagnostics, Inbox, exchange_until, texture
from sensor_msgs.msg import CompressedImage, Image

from rvc_features.image_transport.messages import to_array

COMPILATION = 120.0   # seconds, at the most
MOSAIC = (2 * (240 + 40) + 10, 2 * 320 + 10, 3)   # of the four default detectors on 320 x 240 pixels


class TestCompare(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_compare')
        # The nodes compile before they advertise, which takes long where nothing is compiled yet and the machine busy.
        deadline = time.monotonic() + COMPILATION
        wanted = {'/compare/mosaic', '/two/compare/mosaic', '/faulty/compare/mosaic', '/hanging/mosaic'}
        while not wanted <= {topic for topic, _ in rospy.get_published_topics()}:
            assert time.monotonic() < deadline, 'the nodes do not come up'
            time.sleep(0.1)

    def setUp(self):
        self.camera = Camera('/camera/image_raw')
        self.addCleanup(self.camera.publisher.unregister)

    def inbox(self, topic, message_class):
        inbox = Inbox(topic, message_class)
        self.addCleanup(inbox.close)
        return inbox

    def test_a_mosaic_with_the_stamp_of_its_image(self):
        raw = self.inbox('/compare/mosaic', Image)
        compressed = self.inbox('/compare/mosaic/compressed', CompressedImage)
        exchange_until(self.camera, texture(), [raw, compressed])
        smooth = cv2.GaussianBlur(texture(seed=1), (0, 0), 2)
        stamp = self.camera.send(smooth)
        message = raw.wait_for(lambda message: message.header.stamp == stamp, 'mosaic of the image sent')
        self.assertEqual(message.header.frame_id, 'camera_optical')
        picture = to_array(message, 'bgr8')
        self.assertEqual(picture.shape, MOSAIC)
        for y in (40, 40 + 240 + 50):      # four tiles, each the image with points in colour
            for x in (0, 330):
                tile = picture[y:y + 240, x:x + 320].astype(int)
                self.assertGreater((np.ptp(tile, axis=2) > 0).sum(), 500)
                # The others are the image's own; ORB's large circles cover nearly half of it, the largest in white.
                self.assertGreater((tile == smooth[:, :, None]).all(axis=2).mean(), 0.4)
        answer = compressed.wait_for(lambda message: message.header.stamp == stamp, 'the same, compressed')
        self.assertEqual(to_array(answer, 'bgr8').shape, MOSAIC)

    def test_detectors_of_the_users_choice(self):
        mosaic = self.inbox('/two/compare/mosaic', Image)
        exchange_until(self.camera, texture(), [mosaic])
        stamp = self.camera.send(texture(seed=2))
        picture = to_array(mosaic.wait_for(lambda message: message.header.stamp == stamp, 'mosaic'), 'bgr8')
        self.assertEqual(picture.shape, (240 + 40, 2 * 320 + 10, 3))
        one_point = picture[40:, 330:].astype(int)       # CentreDetector finds one, in the middle
        drawn = np.argwhere(np.ptp(one_point, axis=2) > 60)
        self.assertLess(np.abs(drawn - (120, 160)).max(), 10)
        self.assertGreater(len(drawn), 5)

    def diagnostics(self, node):
        diagnostics = Diagnostics(node)
        self.addCleanup(diagnostics.close)
        return diagnostics

    def test_detectors_that_fail_leave_the_others_their_tiles(self):
        """Whatever they do: raise, call sys.exit, return rubbish."""
        mosaic, diagnostics = self.inbox('/faulty/compare/mosaic', Image), self.diagnostics('faulty/compare')
        exchange_until(self.camera, texture(), [mosaic])
        image = cv2.GaussianBlur(texture(seed=1), (0, 0), 2)
        stamp = self.camera.send(image)
        picture = to_array(mosaic.wait_for(lambda message: message.header.stamp == stamp, 'mosaic'), 'bgr8')
        self.assertEqual(picture.shape, MOSAIC)
        tiles = [picture[y:y + 240, x:x + 320].astype(int) for y in (40, 40 + 240 + 50) for x in (0, 330)]
        self.assertGreater((np.ptp(tiles[0], axis=2) > 0).sum(), 500)
        for tile in tiles[1:]:
            np.testing.assert_array_equal(tile, np.repeat(image[:, :, None], 3, axis=2))
        values = diagnostics.wait_for_values(lambda values: values.get('frames processed', '0') != '0', 'at work')
        self.assertEqual(values['level'], 1)
        for text in ('fails: ZeroDivisionError', 'fails: SystemExit: enough', 'fails: KeyPointError'):
            self.assertIn(text, values['message'])

    def test_a_detector_that_hangs_is_seen_in_diagnostics(self):
        self.inbox('/hanging/mosaic', Image)
        camera, diagnostics = Camera('/hanging/camera'), self.diagnostics('hanging')
        camera.send(texture())
        values = diagnostics.wait_for_values(lambda values: 'has been at work' in values['message'], 'hanging')
        self.assertIn('the mosaic has been at work on one image for', values['message'])
        self.assertGreaterEqual(values['level'], 1)

    def test_a_bad_image_is_skipped(self):
        mosaic = self.inbox('/compare/mosaic', Image)
        exchange_until(self.camera, texture(), [mosaic])
        diagnostics = self.diagnostics('compare')
        self.camera.send(texture(), encoding='nonsense')
        values = diagnostics.wait_for_values(lambda values: values.get('frames rejected') == '1', 'counted')
        self.assertIn("unknown encoding 'nonsense'", values['last rejected because'])
        self.assertEqual(values['input'], '/camera/image_raw (raw)')
        stamp = self.camera.send(texture(seed=3))
        mosaic.wait_for(lambda message: message.header.stamp == stamp, 'the image after the bad one')


if __name__ == '__main__':
    rostest.rosrun('rvc_features', 'compare', TestCompare, sys.argv)
