"""A node that shows detectors side by side, live (exercise 3).

    roslaunch rvc_features compare.launch in:=/camera/image_raw

Subscribed topics
    in (sensor_msgs/Image, or what ~image_transport names)
        The camera. Subscribed to only while somebody listens to `mosaic`.

Published topics
    mosaic (sensor_msgs/Image and the other transports, bgr8)
        A tile for each detector: name, number of points, milliseconds (the median of the last 15 images), points per
        cell of an 8x8 grid and how many cells have any; the points are drawn in. The tile of a detector that fails
        says so, and the others go on.
    /diagnostics (diagnostic_msgs/DiagnosticArray)
        Once a second, from before the detectors are loaded; as that of feature_detector.

Parameters
    ~detectors (list of strings, default: harris, good_features_to_track, fast and orb, 500 points each)
        In the form of the command line: [label=]detector[:parameter=value,...]; see docs/comparison.md.
    ~tile_width (int, default: 640)
        Pixels to which wider images are shrunk in the mosaic (not for the detectors).
    ~image_transport (string, default: raw)
        Transport of `in`.
    ~most_megapixels (number, default: 25)
        Larger images are refused, in any transport.
    ~mask (string, default: none)
        Rectangles `x,y,width,height` without points, or an image file; see docs/odometry.md.
    ~detector_modules (list of strings, default: empty)
        Python modules to import at start that register detectors of their own.

All detectors take turns on the same image, in one thread; of images that come faster, the newest is taken.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import cv2
import rospy

from rvc_features.brief import shown
from rvc_features.comparison import live
from rvc_features.comparison.contestants import ContestantError
from rvc_features.heap import FrameHeap, keep_large_blocks
from rvc_features.image_transport import ImageTransport, Publisher, Subscriber, TransportHints, known_transport
from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.messages import to_array
from rvc_features.nodes.diagnostics import ERROR, Finding
from rvc_features.nodes.lazy_input import LazyInput
from rvc_features.nodes.newest_worker import NewestWorker
from rvc_features.nodes.spin import spin
from rvc_features.nodes.start import only_ros_arguments
from rvc_features.nodes.supervision import Supervision
from rvc_features.odometry.masks import MaskError, Masks, parse

_WRONG_PARAMETER = 2   # exit status


class CompareNode:
    """Between the topics `in` and `mosaic`."""

    def __init__(self) -> None:
        self.side_by_side: live.SideBySide | None = None
        self.publisher: Publisher | None = None
        self.hints = TransportHints()
        self.heap = FrameHeap()
        self.worker = NewestWorker(lambda item: self.process(*item), lambda error: self.supervision.frame_failed(error),
                                   'compare')
        self.input = LazyInput(self._subscribe, self._listeners)
        self.supervision = Supervision('detectors side by side', lambda: 'the mosaic', self.worker, self.input,
                                       'mosaic', house_work=self.heap.tidy)
        self.supervision.start()   # first of all, so that whatever the start hangs at is seen

    def start(self) -> int:
        """Read the parameters and begin; the exit status where they make no sense, else 0."""
        supervision = self.supervision
        supervision.import_detector_modules()
        texts = rospy.get_param('~detectors', list(live.DEFAULT))
        tile_width = rospy.get_param('~tile_width', 640)
        if not isinstance(tile_width, int) or tile_width < 1:
            rospy.logwarn(f'~tile_width must be an integer of at least 1; got {shown(tile_width)}, 640 is used')
            tile_width = 640
        masks = Masks()
        try:
            masks.fixed = parse(rospy.get_param('~mask', ''))
        except MaskError as error:
            rospy.logwarn(f'~mask: {error}; no mask is used')
        supervision.starting = 'trying each detector'
        try:
            if not isinstance(texts, list) or not texts:
                raise ContestantError(f'a list of detectors is wanted, such as {list(live.DEFAULT)}; '
                                      f'got {shown(texts)}')
            self.side_by_side = live.SideBySide(live.contestants([str(text) for text in texts]), tile_width, masks)
        except ValueError as error:
            rospy.logfatal(f'~detectors: {error}')
            return _WRONG_PARAMETER
        self.hints = known_transport(self._refuse_transport)
        supervision.transport = self.hints.transport
        changed = self.input.changed.set
        self.publisher = ImageTransport().advertise('mosaic', subscriber_connected=changed,
                                                    subscriber_disconnected=changed)
        supervision.started()
        return 0

    def image_message_callback(self, message: Any) -> None:
        """Called for each image: only keeps it, for the worker to take the newest."""
        self.worker.put((message, self.supervision.frame_arrived(message)))

    def process(self, message: Any, arrived: float) -> None:
        """One image from message to mosaic, in the worker's thread; a bad one is reported and skipped."""
        start = time.monotonic()
        side_by_side, publisher = self.side_by_side, self.publisher
        assert side_by_side is not None   # nothing is subscribed to before there are both
        assert publisher is not None
        self.heap.note(len(message.data))
        try:
            image = to_array(message, 'bgr8')
            publisher.publish_array(side_by_side.mosaic(image), 'bgr8', message.header)
        except ImageError as error:
            self.supervision.frame_refused(error)
        else:
            self.supervision.frame_processed(image.shape, start, arrived)

    def _subscribe(self) -> Subscriber:
        self.supervision.statistics.waiting()
        return ImageTransport().subscribe('in', self.image_message_callback, transport_hints=self.hints, decode=False)

    def _listeners(self) -> int:
        return 0 if self.publisher is None else self.publisher.get_num_subscribers()

    def _refuse_transport(self, problem: str) -> None:
        self.supervision.lasting.append(Finding(ERROR, problem))
        rospy.logerr(problem)


def main() -> int:
    """Run the node until it is told to end; the exit status."""
    only_ros_arguments('compare_mosaic', __doc__)
    keep_large_blocks()
    cv2.setNumThreads(1)   # the times are to be comparable
    return spin('compare', lambda: CompareNode().start())


if __name__ == '__main__':
    sys.exit(main())
