"""The node: images in, the same images with key points out (exercise 1).

    rosrun rvc_features feature_detector in:=/camera/image_raw

Subscribed topics
    in (sensor_msgs/Image, or what ~image_transport names)
        The camera. Subscribed to only while somebody listens to one of the topics below.
    mask (sensor_msgs/Image, mono8)
        Points may lie where it is not zero; the newest one of the images' size counts.
    camera_info (sensor_msgs/CameraInfo)
        The calibration, with which key points and tracks have rays.

Published topics
    image (sensor_msgs/Image and the other transports, bgr8)
        The image with the key points drawn in.
    key_points (rvc_features/KeyPoints)
        The key points, strongest first.
    tracks (rvc_features/Tracks), descriptors (rvc_features/Descriptors)
        Points followed from image to image, and descriptors of the key points; see docs/odometry.md.
    response (sensor_msgs/Image, mono8)
        The detector's response map, where it has one: corners bright, edges dark.
    /diagnostics (diagnostic_msgs/DiagnosticArray)
        Once a second, from before the detectors are loaded: a level with all that is not as it should be, and frames
        received, processed, dropped, rejected and why; points; milliseconds per frame; age of the output.

Services
    detect (rvc_features/Detect)
        The key points of one image.

Parameters
    Those of cfg/FeatureDetectorConfig.cfg, by dynamic_reconfigure or preset, and
    ~image_transport (string, default: raw)
        Transport of `in`.
    ~most_megapixels (number, default: 25)
        Larger images are refused, in any transport.
    ~detector_modules (list of strings, default: empty)
        Python modules to import at start that register detectors of their own.
    ~preset (string, default: none)
        Name of a preset to start with, as in config/: course, even, matching, repeatable.
    ~config (string, default: none)
        File of dynamic parameters to start with, as dynparam, rqt_reconfigure or rosparam save it; or its text.
    ~mask (string, default: none)
        Rectangles to leave out, as `x,y,width,height`, several separated by blanks; or an image file, as `mask`.
    ~least_key_points (int, default: 10)
        Fewer in all of the last five images, or all of them in one corner, are worth a warning in /diagnostics; 0 for
        none.

Stamp and frame_id of all that is published are those of the input image. When images come faster than they can be
processed, the newest one is taken and the others are counted as dropped. docs/reliability.md says what the node does
when things go wrong.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import rospy

from rvc_features.brief import reporter, shown
from rvc_features.cfg import FeatureDetectorConfigConfig as FeatureDetectorConfig
from rvc_features.drawing import displayable_response, draw_key_points
from rvc_features.feature_detector import as_grey
from rvc_features.heap import FrameHeap, keep_large_blocks
from rvc_features.image_transport import ImageTransport, Subscriber, TransportHints, known_transport
from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.messages import to_array, to_image_message
from rvc_features.kernels import compiler, warm_up
from rvc_features.nodes import detector_config, odometry_config
from rvc_features.nodes.diagnostics import ERROR, HANGING, Finding
from rvc_features.nodes.lazy_input import LazyInput
from rvc_features.nodes.newest_worker import NewestWorker
from rvc_features.nodes.odometry_outputs import OdometryOutputs
from rvc_features.nodes.outputs import Listener, Publishers
from rvc_features.nodes.sliders import with_detectors
from rvc_features.nodes.spin import spin
from rvc_features.nodes.start import only_ros_arguments, take_settings
from rvc_features.nodes.supervision import Supervision
from rvc_features.reconfigure import ReconfigureServer, warn_of_refused

_LEAST_KEY_POINTS = 10


class FeatureDetectorNode:
    """Subscriber, worker and publishers; the detector is one reference that `update_config` swaps."""

    def __init__(self) -> None:
        self.detector = self._at_work = detector_config.create(FeatureDetectorConfig.defaults)
        self.worker = NewestWorker(lambda item: self.process(*item), lambda error: self.supervision.frame_failed(error),
                                   'feature_detector')
        self.odometry = OdometryOutputs(lambda: self.detector)
        self.heap = FrameHeap()
        self.input = LazyInput(self._subscribe, self._listeners)
        self.hints = TransportHints()
        self.publishers: Publishers | None = None
        self.server: ReconfigureServer | None = None
        self._least_key_points = _LEAST_KEY_POINTS
        self.supervision = Supervision('feature detector', lambda: self._at_work.name, self.worker, self.input, 'image',
                                       self._details, self._once_a_second, self._restore_parameters)
        self.supervision.start()   # first of all, so that whatever the start hangs at is seen
        self._start()

    def _start(self) -> None:
        supervision = self.supervision
        supervision.starting = 'compiling the hot loops, or loading them'
        rospy.loginfo('running on %s', compiler.description())
        if compiler.available():
            rospy.loginfo('loading the hot loops; where the build has not compiled them, this takes a while')
            rospy.loginfo('... took %.1f s', warm_up.compile_all())
        supervision.import_detector_modules()
        self._least_key_points = self._positive('~least_key_points', _LEAST_KEY_POINTS)
        config_type = with_detectors(FeatureDetectorConfig)
        problems = take_settings(config_type.defaults)
        if problems:
            self.reject_parameters(problems)
        self.server = ReconfigureServer(config_type, self.update_config, reject=self.reject_parameters,
                                        settle=odometry_config.settle)
        self.hints = known_transport(self._refuse_transport)
        supervision.transport = self.hints.transport
        images = supervision.input_state()
        if not images.remapped:
            rospy.logwarn('in is not remapped (in:=/camera/image_raw): images are expected on %s', images.topic)
        self.odometry.start(Listener(self.input.changed), self.reject_parameters)
        self.publishers = Publishers(self.input.changed)
        supervision.started()

    def update_config(self, config: Any, level: int) -> Any:
        """Callback of dynamic_reconfigure, with sane values: a new detector takes the place of the old one."""
        self.detector = detector_config.create(config)
        self.odometry.configure(config)
        return config

    def reject_parameters(self, problems: list[str]) -> None:
        """Count and report parameter values that were refused."""
        self.supervision.statistics.parameters_refused(len(problems))
        warn_of_refused(problems)

    def image_message_callback(self, message: Any) -> None:
        """Called for each image: only keeps it, for the worker to take the newest."""
        self.worker.put((message, self.supervision.frame_arrived(message)))

    def process(self, message: Any, arrived: float) -> None:
        """One image from message to messages, in the worker's thread; a bad one is reported and skipped."""
        start = time.monotonic()
        self.heap.note(len(message.data))
        try:
            found, shape = self._detect_and_publish(message)
        except ImageError as error:
            self.supervision.frame_refused(error)
        else:
            self.supervision.frame_processed(shape, start, arrived, found)

    def _detect_and_publish(self, message: Any) -> tuple[np.ndarray, tuple[int, int]]:
        detector, publishers = self.detector, self.publishers   # the same ones for the whole frame
        self._at_work = detector
        assert publishers is not None   # nothing is subscribed to before
        draw = publishers.image.get_num_subscribers() > 0
        # Pixels that came from the socket or from a conversion are nobody else's: what is drawn is drawn on them.
        image = to_array(message, 'bgr8', writable=True) if draw else to_array(message, 'mono8')
        self.heap.note(image.nbytes)
        grey = as_grey(image)
        mask = self.odometry.mask(grey.shape, message.header)
        found = detector.detect_arrays(grey, mask)
        self.worker.check()
        if publishers.key_points.get_num_connections() > 0:
            publishers.key_points.publish(self.odometry.key_points(grey, found, message.header, detector))
        self.odometry.publish(grey, found, message.header, detector, mask, draw)
        if draw:
            picture = self.odometry.drawn(draw_key_points(image, found, image), mask)
            picture.flags.writeable = False   # so that a slow subscriber gets it without a copy
            publishers.image.publish(to_image_message(picture, 'bgr8', message.header))
        if publishers.response.get_num_connections() > 0:
            response = detector.response_map(grey)
            self.worker.check()
            if response is None:
                reporter().say(rospy.logwarn, 'response', f'{detector.name} has no response map to publish')
            else:
                picture = displayable_response(response)
                publishers.response.publish(to_image_message(picture, 'mono8', message.header))
        return found, (grey.shape[0], grey.shape[1])

    def _listeners(self) -> int:
        return 0 if self.publishers is None else self.publishers.listeners() + self.odometry.listeners()

    def _subscribe(self) -> Subscriber:
        self.supervision.statistics.waiting()
        return ImageTransport().subscribe('in', self.image_message_callback, queue_size=1, transport_hints=self.hints,
                                          decode=False)

    def _details(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """What else /diagnostics should know and show."""
        detector, statistics = self.detector, self.supervision.statistics
        least = min(self._least_key_points, getattr(detector, 'number_of_points', self._least_key_points))
        return {'least_points': least}, {
            'detector': detector.name,
            'parameter values rejected': statistics.parameters_rejected,
            'key points in last frame': statistics.points,
            **self.odometry.values(),
        }

    def _once_a_second(self) -> None:
        self.heap.tidy()
        if self.supervision.busy() > HANGING and self._at_work != self.detector and self.worker.renew():
            reporter().say(rospy.logerr, 'hangs', f'{self._at_work.name} is given up: the next images go to '
                           f'{self.detector.name}, in a thread of its own')

    def _positive(self, name: str, default: int) -> int:
        value = rospy.get_param(name, default)
        if isinstance(value, int) and value >= 0:
            return int(value)
        self.reject_parameters([f'{name} must be an integer of at least 0; got {shown(value)}, {default} is used'])
        return default

    def _refuse_transport(self, problem: str) -> None:
        self.supervision.lasting.append(Finding(ERROR, problem))
        self.reject_parameters([problem])

    def _restore_parameters(self) -> None:
        if self.server is not None:
            self.server.restore_parameters()


def main() -> int:
    """Run the node until it is told to end; the exit status."""
    only_ros_arguments('feature_detector', __doc__)
    keep_large_blocks()
    return spin('feature_detector', FeatureDetectorNode)
