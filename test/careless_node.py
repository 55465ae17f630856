#!/usr/bin/env python3
"""A student's node with two mistakes: it loses the header, and its threshold is that of the start for ever."""

import rospy
from dynamic_reconfigure.server import Server
from rvc_features.cfg import FeatureDetectorConfigConfig
from rvc_features.msg import KeyPoints
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from rvc_features import drawing, presets
from rvc_features.image_transport.messages import to_array, to_image_message

TAKEN = {'window_size': 'window_size', 'octaves': 'octaves', 'fixed_number_of_points': 'fixed_number_of_points',
         'number_of_points': 'number_of_points', 'ANMS': 'anms', 'ANMS_points': 'anms_points'}


class CarelessNode:
    def __init__(self):
        self.picture = rospy.Publisher('image', Image, queue_size=10)
        self.key_points = rospy.Publisher('key_points', KeyPoints, queue_size=10)
        self.server = Server(FeatureDetectorConfigConfig, self.update_config)
        self.subscriber = rospy.Subscriber('in', Image, self.image_message_callback, queue_size=10)

    def update_config(self, config, level):
        self.detector = presets.create('course', **{own: config[name] for name, own in TAKEN.items()})
        return config

    def image_message_callback(self, message):
        image = to_array(message, 'bgr8')
        found = self.detector.detect_arrays(image)
        header = Header(stamp=rospy.Time.now())
        points = KeyPoints(header=header, detector='careless', width=image.shape[1], height=image.shape[0])
        for name in found.dtype.names:
            setattr(points, name, found[name].tolist())
        self.key_points.publish(points)
        answer = to_image_message(drawing.draw_key_points(image, found), 'bgr8')
        answer.header = header
        self.picture.publish(answer)


if __name__ == '__main__':
    rospy.init_node('careless')
    node = CarelessNode()
    rospy.spin()
