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
    ~most_megapixels (number, default: 36)
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

import threading
import time
import traceback
from typing import Any

import numpy as np
import rospy

from rvc_features.brief import reporter, shown
from rvc_features.cfg import FeatureDetectorConfigConfig as FeatureDetectorConfig
from rvc_features.drawing import displayable_response, draw_key_points
from rvc_features.feature_detector import as_grey
from rvc_features.heap import FrameHeap, keep_large_blocks, resident_bytes
from rvc_features.image_transport import ImageTransport, Subscriber, TransportHints, known_transport
from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.messages import to_array, to_image_message
from rvc_features.kernels import warm_up
from rvc_features.nodes import detector_config, detector_modules, odometry_config
from rvc_features.nodes.diagnostics import ERROR, WARN, Finding, Input, Situation, judge
from rvc_features.nodes.graph_watch import GraphWatch
from rvc_features.nodes.lazy_input import LazyInput
from rvc_features.nodes.library_log import library_log
from rvc_features.nodes.newest_worker import NewestWorker
from rvc_features.nodes.odometry_outputs import OdometryOutputs
from rvc_features.nodes.outputs import Listener, Publishers
from rvc_features.nodes.sliders import with_detectors
from rvc_features.nodes.spin import spin
from rvc_features.nodes.start import only_ros_arguments, take_settings
from rvc_features.nodes.statistics import NodeStatistics
from rvc_features.nodes.status_publisher import StatusPublisher
from rvc_features.reconfigure import ReconfigureServer, warn_of_refused

_PATIENCE = 2.0         # seconds for each thread to end what it is at, when the node is told to end
_WAKE_UP = 1.0          # seconds until a subscription that has failed is thought of again
_LEAST_KEY_POINTS = 10
_MOST_TRACEBACKS = 10   # of errors in different places; each is shown once


class FeatureDetectorNode:
    """Subscriber, worker and publishers; the detector is one reference that `update_config` swaps."""

    def __init__(self) -> None:
        self.detector = detector_config.create(FeatureDetectorConfig.defaults)
        self.worker = NewestWorker(lambda item: self.process(*item), self.frame_failed, 'feature_detector')
        self.statistics = NodeStatistics(lambda: (self.worker.received, self.worker.dropped))
        self.odometry = OdometryOutputs(lambda: self.detector)
        self.heap = FrameHeap()
        self.input = LazyInput(self._subscribe, self._listeners)
        self.hints = TransportHints()
        self.publishers: Publishers | None = None
        self.server: ReconfigureServer | None = None
        self._starting = 'compiling the hot loops, or loading them'
        self._lasting: list[Finding] = []   # found while it starts, and true from then on
        self._least_key_points = _LEAST_KEY_POINTS
        self._picture = np.empty((0, 0, 3), np.uint8)
        self._tracebacks: set[tuple[str, int]] = set()
        self._stopping = False
        self.graph_watch = GraphWatch(lambda: [self._input_state().topic], self._restore_parameters)
        self.status = StatusPublisher('feature detector', self.report, self.heap.tidy)
        self._subscribing = threading.Thread(target=self._keep_subscribed, name='lazy input', daemon=True)
        rospy.on_shutdown(self.shutdown)
        self.status.start()   # first of all, so that whatever the start hangs at is seen
        self._start()

    def _start(self) -> None:
        rospy.loginfo('loading the detector\'s hot loops; where the build has not compiled them, this takes a while')
        rospy.loginfo('... took %.1f s', warm_up.compile_all())
        for problem in detector_modules.import_all(rospy.get_param('~detector_modules', []), self._importing):
            self._lasting.append(Finding(WARN, problem))
            rospy.logerr(problem)
        self._least_key_points = self._positive('~least_key_points', _LEAST_KEY_POINTS)
        config_type = with_detectors(FeatureDetectorConfig)
        problems = take_settings(config_type.defaults)
        if problems:
            self.reject_parameters(problems)
        self.server = ReconfigureServer(config_type, self.update_config, reject=self.reject_parameters,
                                        settle=odometry_config.settle)
        self.hints = known_transport(self._refuse_transport)
        images = self._input_state()
        if not images.remapped:
            rospy.logwarn('in is not remapped (in:=/camera/image_raw): images are expected on %s', images.topic)
        self.odometry.start(Listener(self.input.changed), self.reject_parameters)
        self.publishers = Publishers(self.input.changed)
        self._starting = ''
        self._subscribing.start()
        self.graph_watch.start()

    def update_config(self, config: Any, level: int) -> Any:
        """Callback of dynamic_reconfigure, with sane values: a new detector takes the place of the old one."""
        self.detector = detector_config.create(config)
        self.odometry.configure(config)
        return config

    def reject_parameters(self, problems: list[str]) -> None:
        """Count and report parameter values that were refused."""
        self.statistics.parameters_refused(len(problems))
        warn_of_refused(problems)

    def image_message_callback(self, message: Any) -> None:
        """Called for each image: only keeps it, for the worker to take the newest."""
        stamp = message.header.stamp
        arrived = self.statistics.frame_arrived((rospy.Time.now() - stamp).to_sec() if stamp else None)
        self.worker.put((message, arrived))

    def process(self, message: Any, arrived: float) -> None:
        """One image from message to messages, in the worker's thread; a bad one is reported and skipped."""
        start = time.monotonic()
        self.heap.note(len(message.data))
        try:
            found, shape = self._detect_and_publish(message)
        except ImageError as error:
            self.statistics.frame_rejected(str(error))
            reporter().say(rospy.logwarn, 'images', f'image skipped: {error}')
        else:
            now = time.monotonic()
            self.statistics.frame_processed(found, shape, now - start, now - arrived)

    def frame_failed(self, error: BaseException) -> None:
        """Called with what a detector that is plugged in raises, be it SystemExit: the next frame may be better."""
        text = f'{type(error).__name__}: {error}'
        self.statistics.frame_rejected(text)
        reporter().say(rospy.logerr, 'detector', f'image skipped: {text}')
        places = traceback.extract_tb(error.__traceback__)
        place = (places[-1].filename, places[-1].lineno or 0) if places else ('', 0)
        if place not in self._tracebacks and len(self._tracebacks) < _MOST_TRACEBACKS:
            self._tracebacks.add(place)
            rospy.logerr('this is said once:\n%s', ''.join(traceback.format_list(places[-4:])).rstrip()[-1000:])

    def report(self) -> tuple[Finding, dict[str, Any]]:
        """Level and message of the node's diagnostic status, and its values."""
        report, images, detector = self.statistics.report(), self._input_state(), self.detector
        busy_since, graph, output = self.worker.busy_since, self.graph_watch.graph, rospy.resolve_name('image')
        situation = Situation(
            detector.name, report, images,
            busy=0.0 if busy_since is None else time.monotonic() - busy_since, starting=self._starting,
            least_points=min(self._least_key_points, getattr(detector, 'number_of_points', self._least_key_points)),
            other_publishers=tuple(node for node in (graph.publishers.get(output, ()) if graph else ())
                                   if node != rospy.get_name()),
            output_topic=output, last_problem=self.statistics.last_problem, lasting=tuple(self._lasting),
            passing=library_log().recent(), master=self.graph_watch.problem)
        processed = report.interval.processed
        return judge(situation), {
            'detector': detector.name,
            'input': f'{images.topic} ({images.transport})',
            'publishers connected': images.connections,
            'frames received': self.worker.received,
            'frames processed': self.statistics.processed,
            'frames dropped for newer ones': self.worker.dropped,
            'frames rejected': self.statistics.frames_rejected,
            'last rejected because': self.statistics.last_problem,
            'rejected because': self.statistics.causes_in_words(),
            'parameter values rejected': self.statistics.parameters_rejected,
            'key points in last frame': self.statistics.points,
            'milliseconds per frame': f'{1000 * report.interval.busy_seconds / processed:.1f}' if processed else 'none',
            'age of output in ms, median': f'{1000 * report.age_median:.1f}' if processed else 'none',
            'age of output in ms, worst': f'{1000 * report.age_worst:.1f}' if processed else 'none',
            'seconds from stamp to arrival': 'none' if report.stamp_delay is None else f'{report.stamp_delay:.3f}',
            **self.odometry.values(),
            'memory in MB': f'{resident_bytes() / 1e6:.0f}',
        }

    def shutdown(self) -> None:
        """End the threads; called by rospy, whose own flag is not set yet."""
        self._stopping = True
        self.input.changed.set()
        self.graph_watch.stop()
        self.status.stop(_PATIENCE)
        if self._subscribing.is_alive():
            self._subscribing.join(_PATIENCE)
        self.worker.stop(_PATIENCE)

    def _detect_and_publish(self, message: Any) -> tuple[np.ndarray, tuple[int, int]]:
        detector, publishers = self.detector, self.publishers   # the same ones for the whole frame
        assert publishers is not None   # nothing is subscribed to before
        draw = publishers.image.get_num_subscribers() > 0
        image = to_array(message, 'bgr8' if draw else 'mono8')
        self.heap.note(image.nbytes)
        grey = as_grey(image)
        mask = self.odometry.mask(grey.shape, message.header)
        found = detector.detect_arrays(grey, mask)
        if publishers.key_points.get_num_connections() > 0:
            publishers.key_points.publish(self.odometry.key_points(found, message.header, detector.name, grey.shape))
        self.odometry.publish(grey, found, message.header, detector, mask, draw)
        if draw:
            picture = self.odometry.drawn(self._draw(image, found), mask)
            publishers.image.publish_array(picture, 'bgr8', message.header)
        if publishers.response.get_num_connections() > 0:
            response = detector.response_map(grey)
            if response is None:
                reporter().say(rospy.logwarn, 'response', f'{detector.name} has no response map to publish')
            else:
                picture = displayable_response(response)
                publishers.response.publish(to_image_message(picture, 'mono8', message.header))
        return found, (grey.shape[0], grey.shape[1])

    def _draw(self, image: np.ndarray, found: np.ndarray) -> np.ndarray:
        """Draw on one picture that serves frame after frame, for fresh memory costs more than the drawing."""
        if self._picture.shape[:2] != image.shape[:2]:
            self._picture = np.empty((*image.shape[:2], 3), np.uint8)
        return draw_key_points(image, found, self._picture)

    def _keep_subscribed(self) -> None:
        """Subscribe while somebody listens.

        A thread of its own: rospy announces listeners with locks held that subscribing needs too, and without a master
        subscribing waits until there is one.
        """
        while not self._stopping:
            self.input.update()
            self.input.wait(_WAKE_UP)

    def _listeners(self) -> int:
        return 0 if self.publishers is None else self.publishers.listeners() + self.odometry.listeners()

    def _subscribe(self) -> Subscriber:
        self.statistics.waiting()
        return ImageTransport().subscribe('in', self.image_message_callback, queue_size=1, transport_hints=self.hints,
                                          decode=False)

    def _input_state(self) -> Input:
        return self.input.state('in', self.hints.transport, self.graph_watch.graph)

    def _importing(self, module: str) -> None:
        self._starting = f'importing {shown(module)}' if module else 'taking over the parameters'

    def _positive(self, name: str, default: int) -> int:
        value = rospy.get_param(name, default)
        if isinstance(value, int) and value >= 0:
            return int(value)
        self.reject_parameters([f'{name} must be an integer of at least 0; got {shown(value)}, {default} is used'])
        return default

    def _refuse_transport(self, problem: str) -> None:
        self._lasting.append(Finding(ERROR, problem))
        self.reject_parameters([problem])

    def _restore_parameters(self) -> None:
        if self.server is not None:
            self.server.restore_parameters()


def main() -> int:
    """Run the node until it is told to end; the exit status."""
    only_ros_arguments('feature_detector', __doc__)
    keep_large_blocks()
    return spin('feature_detector', FeatureDetectorNode)
