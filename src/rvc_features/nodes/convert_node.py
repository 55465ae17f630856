"""A node that turns this package's messages into those that other packages read.

    rosrun rvc_features convert_points tracks:=/feature_detector/tracks vins:=/feature_tracker/feature

Subscribed topics, each only while somebody listens to what is made of it
    tracks (rvc_features/Tracks), with rays
    key_points (rvc_features/KeyPoints)

Published topics
    vins (sensor_msgs/PointCloud)
        As the estimator of VINS-Mono reads it on /feature_tracker/feature.
    vins_restart (std_msgs/Bool)
        True when the clock has jumped back or by more than a second, as VINS-Mono reads it on
        /feature_tracker/restart; the tracks of that image are not sent.
    points (opencv_apps/Point2DArrayStamped), where that package is installed
        The positions of the key points.
    markers (visualization_msgs/ImageMarker), where visualization_msgs is installed
        The key points, for a viewer that overlays markers on images.
    rays (visualization_msgs/MarkerArray), where visualization_msgs is installed
        The rays of the tracks, one metre long, in the camera's frame.
"""

from __future__ import annotations

import functools
import importlib
import threading
from typing import Any, Callable

import rospy
from geometry_msgs.msg import Point
from sensor_msgs.msg import PointCloud
from std_msgs.msg import Bool

from rvc_features.brief import reporter
from rvc_features.msg import KeyPoints, Tracks
from rvc_features.nodes.outputs import Listener
from rvc_features.nodes.point_messages import vins_point_cloud
from rvc_features.nodes.spin import spin
from rvc_features.nodes.start import only_ros_arguments

_GREEN = 0.2, 1.0, 0.2
_GAP = rospy.Duration(1)   # between images, beyond which VINS-Mono's own front end starts anew
_PATIENCE = 1.0   # seconds until the node notices that it has been told to end


def to_point_array(message: KeyPoints, messages: Any) -> Any:
    """Key points as an opencv_apps/Point2DArrayStamped; `messages` is the module of its messages, here as below."""
    return messages.Point2DArrayStamped(
        header=message.header, points=[messages.Point2D(x, y) for x, y in zip(message.x, message.y)])


def to_image_marker(message: KeyPoints, messages: Any) -> Any:
    """Key points as a visualization_msgs/ImageMarker of points."""
    marker = messages.ImageMarker(header=message.header, ns='key_points', scale=3.0)
    marker.type, marker.action = messages.ImageMarker.POINTS, messages.ImageMarker.ADD
    marker.outline_color.r, marker.outline_color.g, marker.outline_color.b = _GREEN
    marker.outline_color.a = 1.0
    marker.points = [Point(x, y, 0.0) for x, y in zip(message.x, message.y)]
    return marker


def to_marker_array(message: Tracks, messages: Any) -> Any:
    """The rays of tracks as a visualization_msgs/MarkerArray: one list of lines from the camera's centre."""
    marker = messages.Marker(header=message.header, ns='rays')
    marker.type, marker.action = messages.Marker.LINE_LIST, messages.Marker.ADD
    marker.pose.orientation.w = 1.0
    marker.scale.x = 0.002
    marker.color.r, marker.color.g, marker.color.b = _GREEN
    marker.color.a = 0.6
    for x, y in zip(message.ray_x, message.ray_y):
        length = (x * x + y * y + 1) ** 0.5
        marker.points += [Point(0.0, 0.0, 0.0), Point(x / length, y / length, 1 / length)]
    return messages.MarkerArray(markers=[marker])


class ConvertNode:
    """A converter for each topic, which subscribes while it has listeners."""

    def __init__(self) -> None:
        self._changed = threading.Event()
        self._last_stamp = rospy.Time()
        self._restart = rospy.Publisher('vins_restart', Bool, queue_size=1)
        self._converters = [_Converter('vins', PointCloud, 'tracks', Tracks, self._to_vins, self._changed)]
        for package, name, output, source, kind, function in (
                ('opencv_apps', 'Point2DArrayStamped', 'points', 'key_points', KeyPoints, to_point_array),
                ('visualization_msgs', 'ImageMarker', 'markers', 'key_points', KeyPoints, to_image_marker),
                ('visualization_msgs', 'MarkerArray', 'rays', 'tracks', Tracks, to_marker_array)):
            try:
                module = importlib.import_module(f'{package}.msg')
            except ImportError:
                rospy.loginfo('%s is not installed: no topic %s', package, output)
                continue
            self._converters.append(_Converter(output, getattr(module, name), source, kind,
                                               functools.partial(function, messages=module), self._changed))

    def run(self) -> None:
        """Subscribe while somebody listens; returns when the node is told to end."""
        while not rospy.is_shutdown():
            for converter in self._converters:
                converter.update()
            if self._changed.wait(_PATIENCE):
                self._changed.clear()

    def _to_vins(self, message: Tracks) -> PointCloud | None:
        last, self._last_stamp = self._last_stamp, message.header.stamp
        if last and not rospy.Duration() <= message.header.stamp - last <= _GAP:
            self._restart.publish(Bool(True))
            return None
        return vins_point_cloud(message)


class _Converter:
    def __init__(self, output: str, output_class: Any, source: str, source_class: Any, function: Callable[[Any], Any],
                 changed: threading.Event) -> None:
        self._source, self._function = (source, source_class), function
        self._subscriber: rospy.Subscriber | None = None
        self._publisher = rospy.Publisher(output, output_class, Listener(changed), queue_size=10)

    def update(self) -> None:
        """Subscribe or unsubscribe; not from a callback of rospy, which holds locks that this needs."""
        wanted = self._publisher.get_num_connections() > 0
        if wanted and self._subscriber is None:
            self._subscriber = rospy.Subscriber(*self._source, self._convert, queue_size=10)
        elif not wanted and self._subscriber is not None:
            self._subscriber.unregister()
            self._subscriber = None

    def _convert(self, message: Any) -> None:
        try:
            converted = self._function(message)
        except ValueError as error:
            reporter().say(rospy.logwarn, 'no conversion', str(error))
        else:
            if converted is not None:
                self._publisher.publish(converted)


def main() -> int:
    """Run the node until it is told to end; the exit status."""
    only_ros_arguments('convert_points', __doc__)
    return spin('convert_points', lambda: ConvertNode().run())
