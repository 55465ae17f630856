"""The node: images in, the same images with key points out (exercise 1).

    rosrun rvc_features feature_detector in:=/camera/image_raw

Subscribed topics
    in (sensor_msgs/Image, or what ~image_transport names)
        The camera. Subscribed to only while somebody listens to one of the topics below.

Published topics
    image (sensor_msgs/Image and the other transports, bgr8)
        The image with the key points drawn in.
    key_points (rvc_features/KeyPoints)
        The key points, strongest first.
    response (sensor_msgs/Image, mono8)
        The detector's response map, where it has one: corners bright, edges dark.
    /diagnostics (diagnostic_msgs/DiagnosticArray)
        Once a second: frames received, processed, dropped, rejected; points; milliseconds per frame.

Parameters
    Those of cfg/FeatureDetectorConfig.cfg, by dynamic_reconfigure or preset, and
    ~image_transport (string, default: raw)
        Transport of `in`.
    ~detector_modules (list of strings, default: empty)
        Python modules to import at start that register detectors of their own.
    ~config (string, default: none)
        File of dynamic parameters to start with, as dynparam, rqt_reconfigure or rosparam save it; or its text.

Stamp and frame_id of all that is published are those of the input image. When images come faster than they can be
processed, the newest one is taken and the others are counted as dropped.
"""

from __future__ import annotations

import importlib
import threading
import time
import traceback
from typing import Any

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_updater import Updater
from sensor_msgs.msg import Image

from rvc_features import key_points
from rvc_features.brief import reporter, shown
from rvc_features.cfg import FeatureDetectorConfigConfig as FeatureDetectorConfig
from rvc_features.drawing import displayable_response, draw_key_points
from rvc_features.feature_detector import as_grey
from rvc_features.heap import keep_large_blocks
from rvc_features.image_transport import ImageTransport, Subscriber, known_transport
from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.messages import to_array, to_image_message
from rvc_features.kernels import warm_up
from rvc_features.msg import KeyPoints
from rvc_features.nodes import detector_config
from rvc_features.nodes.lazy_input import LazyInput
from rvc_features.nodes.newest_worker import NewestWorker
from rvc_features.nodes.sliders import with_detectors
from rvc_features.nodes.spin import spin
from rvc_features.nodes.start import only_ros_arguments, take_settings
from rvc_features.nodes.statistics import NodeStatistics
from rvc_features.reconfigure import ReconfigureServer, warn_of_refused

_WARNING_PERIOD = 5.0   # seconds between two reports of the same trouble
_REPORT_PERIOD = 1.0    # seconds between two diagnostic messages
_PATIENCE = 2.0         # seconds for each thread to end what it is at, when the node is told to end


class FeatureDetectorNode:
    """Subscriber, worker and publishers; the detector is one reference that `update_config` swaps."""

    def __init__(self) -> None:
        rospy.loginfo('loading the detector\'s hot loops; where the build has not compiled them, this takes a while')
        rospy.loginfo('... took %.1f s', warm_up.compile_all())
        self.statistics = NodeStatistics()
        self._import_detectors(rospy.get_param('~detector_modules', []))
        config_type = with_detectors(FeatureDetectorConfig)
        problems = take_settings(config_type.defaults)
        if problems:
            self.reject_parameters(problems)
        self.detector = detector_config.create(config_type.defaults)
        self.server = ReconfigureServer(config_type, self.update_config, reject=self.reject_parameters,
                                        settle=detector_config.settle)

        self.worker = NewestWorker(self.process, self.frame_failed, 'feature_detector')
        self._picture = np.empty((0, 0, 3), np.uint8)
        self.image_transport = ImageTransport()
        self._hints = known_transport(lambda problem: self.reject_parameters([problem]))
        self._stopping = False
        self.input = LazyInput(self._subscribe, self._listeners)
        self.image_publisher = self.image_transport.advertise(
            'image', queue_size=1, subscriber_connected=self.input.changed.set,
            subscriber_disconnected=self.input.changed.set)
        listener = _Listener(self.input.changed)
        self.key_points_publisher = rospy.Publisher('key_points', KeyPoints, listener, tcp_nodelay=True, queue_size=1)
        self.response_publisher = rospy.Publisher('response', Image, listener, tcp_nodelay=True, queue_size=1)

        self.diagnostics = Updater()
        self.diagnostics.setHardwareID('none')
        self.diagnostics.add('feature detector', self.report)
        self._housekeeper = threading.Thread(target=self._keep_house, name='housekeeper', daemon=True)
        rospy.on_shutdown(self.shutdown)
        self._housekeeper.start()

    def update_config(self, config: Any, level: int) -> Any:
        """Callback of dynamic_reconfigure, with sane values: a new detector takes the place of the old one."""
        self.detector = detector_config.create(config)
        return config

    def reject_parameters(self, problems: list[str]) -> None:
        """Count and report parameter values that were refused."""
        for _ in problems:
            self.statistics.parameter_rejected()
        warn_of_refused(problems)

    def image_message_callback(self, message: Any) -> None:
        """Called for each image: only keeps it, for the worker to take the newest."""
        self.worker.put(message)

    def process(self, message: Any) -> None:
        """One image from message to messages, in the worker's thread; a bad one is reported and skipped."""
        start = time.perf_counter()
        try:
            points = self._detect_and_publish(message)
        except ImageError as error:
            self.statistics.frame_rejected(str(error))
            reporter().say(rospy.logwarn, 'images', f'image skipped: {error}')
        else:
            self.statistics.frame_processed(points, time.perf_counter() - start)

    def frame_failed(self, error: BaseException) -> None:
        """Called with what a detector that is plugged in raises, be it SystemExit: the next frame may be better."""
        self.statistics.frame_rejected(f'{type(error).__name__}: {error}')
        reporter().say(rospy.logerr, 'detector', f'image skipped: {type(error).__name__}: {error}')

    def report(self, status: Any) -> Any:
        """Fill in the node's diagnostic status."""
        interval = self.statistics.interval()
        subscriber = self.input.subscriber
        if subscriber is None:
            status.summary(DiagnosticStatus.OK, 'idle: nobody listens')
        elif interval.frames_rejected:
            status.summary(DiagnosticStatus.WARN, f'images rejected: {self.statistics.last_problem}')
        elif interval.frames == 0:
            status.summary(DiagnosticStatus.WARN, f'no images on {subscriber.get_topic()}')
        else:
            status.summary(DiagnosticStatus.OK, f'{interval.frames / interval.seconds:.1f} images per second')
        milliseconds = f'{1000 * interval.busy_seconds / interval.frames:.1f}' if interval.frames else 'none'
        publishers = subscriber.get_num_publishers() if subscriber is not None else 0
        for name, value in (('detector', self.detector.name),
                            ('publishers connected', publishers),
                            ('frames received', self.worker.received),
                            ('frames processed', self.statistics.processed),
                            ('frames dropped for newer ones', self.worker.dropped),
                            ('frames rejected', self.statistics.frames_rejected),
                            ('last rejected because', self.statistics.last_problem),
                            ('parameter values rejected', self.statistics.parameters_rejected),
                            ('key points in last frame', self.statistics.points),
                            ('milliseconds per frame', milliseconds)):
            status.add(name, str(value))
        return status

    def shutdown(self) -> None:
        """End the threads; called by rospy, whose own flag is not set yet."""
        self._stopping = True
        self.input.changed.set()
        if self._housekeeper.is_alive():
            self._housekeeper.join(_PATIENCE)
        self.worker.stop(_PATIENCE)

    def _detect_and_publish(self, message: Any) -> int:
        detector = self.detector   # the same one for the whole frame
        draw = self.image_publisher.get_num_subscribers() > 0
        image = to_array(message, 'bgr8' if draw else 'mono8')
        grey = as_grey(image)
        found = detector.detect_arrays(grey)

        if self.key_points_publisher.get_num_connections() > 0:
            height, width = grey.shape
            self.key_points_publisher.publish(KeyPoints(
                header=message.header, detector=detector.name, width=width, height=height,
                **{name: found[name] for name in key_points.NAMES}))
        if draw:
            self.image_publisher.publish_array(self._draw(image, found), 'bgr8', message.header)
        if self.response_publisher.get_num_connections() > 0:
            response = detector.response_map(grey)
            if response is None:
                rospy.logwarn_throttle(_WARNING_PERIOD, f'{detector.name} has no response map to publish')
            else:
                picture = displayable_response(response)
                self.response_publisher.publish(to_image_message(picture, 'mono8', message.header))
        return len(found)

    def _draw(self, image: np.ndarray, found: np.ndarray) -> np.ndarray:
        """Draw on one picture that serves frame after frame, for fresh memory costs more than the drawing."""
        if self._picture.shape[:2] != image.shape[:2]:
            self._picture = np.empty((*image.shape[:2], 3), np.uint8)
        return draw_key_points(image, found, self._picture)

    def _keep_house(self) -> None:
        """Subscribe while somebody listens, and report once a second (by the wall, whatever /clock does).

        A thread of its own, because rospy announces listeners with locks held that subscribing needs too.
        """
        next_report = time.monotonic()
        while not self._stopping:
            try:
                self.input.update()
                if time.monotonic() >= next_report:
                    next_report = time.monotonic() + _REPORT_PERIOD
                    self.diagnostics.force_update()
            except Exception:   # whatever the network does: the node goes on, and tries again
                rospy.logerr_throttle(_WARNING_PERIOD, traceback.format_exc())
            self.input.wait(max(0.0, next_report - time.monotonic()))

    def _listeners(self) -> int:
        return (self.image_publisher.get_num_subscribers() + self.key_points_publisher.get_num_connections()
                + self.response_publisher.get_num_connections())

    def _subscribe(self) -> Subscriber:
        return self.image_transport.subscribe('in', self.image_message_callback, queue_size=1,
                                              transport_hints=self._hints, decode=False)

    def _import_detectors(self, modules: Any) -> None:
        if isinstance(modules, str):
            modules = [modules]
        if not isinstance(modules, list):
            self.reject_parameters([f'~detector_modules must be a list of module names; got {shown(modules)}'])
            return
        for module in modules:
            try:
                importlib.import_module(module)
            except Exception:   # of a module that is not ours: its detectors are missing, the others work
                rospy.logerr(f'~detector_modules: {module!r} can not be imported:\n{traceback.format_exc()}')


class _Listener(rospy.SubscribeListener):
    """Sets an event when somebody begins or ceases to listen."""

    def __init__(self, changed: threading.Event) -> None:
        super().__init__()
        self._changed = changed

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        self._changed.set()

    def peer_unsubscribe(self, topic_name: str, num_peers: int) -> None:
        self._changed.set()


def main() -> int:
    """Run the node until it is told to end; the exit status."""
    only_ros_arguments('feature_detector', __doc__)
    keep_large_blocks()
    rospy.init_node('feature_detector')
    return spin(FeatureDetectorNode)
