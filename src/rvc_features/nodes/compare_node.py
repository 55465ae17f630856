"""A node that shows detectors side by side, live (exercise 3).

    roslaunch rvc_features compare.launch in:=/camera/image_raw

Subscribed topics
    in (sensor_msgs/Image, or what ~image_transport names)
        The camera. Subscribed to only while somebody listens to `mosaic`.

Published topics
    mosaic (sensor_msgs/Image and the other transports, bgr8)
        A tile for each detector: name, number of points, milliseconds (the median of the last 15 images), points per
        cell of an 8x8 grid and how many cells have any; the points are drawn in.

Parameters
    ~detectors (list of strings, default: harris, good_features_to_track, fast and orb, 500 points each)
        In the form of the command line: [label=]detector[:parameter=value,...]; see docs/comparison.md.
    ~tile_width (int, default: 640)
        Pixels to which wider images are shrunk in the mosaic (not for the detectors).
    ~image_transport (string, default: raw)
        Transport of `in`.
    ~most_megapixels (number, default: 36)
        Larger images are refused, in any transport.
    ~mask (string, default: none)
        Rectangles `x,y,width,height` without points, or an image file; see docs/odometry.md.
    ~detector_modules (list of strings, default: empty)
        Python modules to import at start that register detectors of their own.

All detectors take turns on the same image, in one thread; of images that come faster, the newest is taken.
"""

from __future__ import annotations

import sys
from typing import Any

import cv2
import rospy

from rvc_features.brief import reporter, shown
from rvc_features.comparison import live
from rvc_features.comparison.contestants import ContestantError
from rvc_features.heap import FrameHeap, keep_large_blocks
from rvc_features.image_transport import ImageTransport, known_transport
from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.messages import to_array
from rvc_features.nodes import detector_modules
from rvc_features.nodes.graph_watch import GraphWatch
from rvc_features.nodes.lazy_input import LazyInput
from rvc_features.nodes.newest_worker import NewestWorker
from rvc_features.nodes.spin import spin
from rvc_features.nodes.start import only_ros_arguments
from rvc_features.odometry.masks import MaskError, Masks, parse

_PATIENCE = 1.0   # seconds until the node notices that it has been told to end
_WRONG_PARAMETER = 2   # exit status


class CompareNode:
    """Between the topics `in` and `mosaic`."""

    def __init__(self, side_by_side: live.SideBySide) -> None:
        self.side_by_side = side_by_side
        self.heap = FrameHeap()
        self.worker = NewestWorker(self.process, self.frame_failed, 'compare')
        transport, hints = ImageTransport(), known_transport()
        self.input = LazyInput(lambda: transport.subscribe('in', self.worker.put, transport_hints=hints, decode=False),
                               lambda: self.publisher.get_num_subscribers())
        changed = self.input.changed.set
        self.publisher = transport.advertise('mosaic', subscriber_connected=changed, subscriber_disconnected=changed)
        self.graph_watch = GraphWatch()

    def process(self, message: Any) -> None:
        """One image from message to mosaic, in the worker's thread; a bad one is reported and skipped."""
        self.heap.note(len(message.data))
        try:
            mosaic = self.side_by_side.mosaic(to_array(message, 'bgr8'))
            self.publisher.publish_array(mosaic, 'bgr8', message.header)
        except ImageError as error:
            reporter().say(rospy.logwarn, 'images', f'image skipped: {error}')

    def frame_failed(self, error: BaseException) -> None:
        """Called with what a detector that is plugged in raises: the next frame may be better."""
        reporter().say(rospy.logerr, 'detectors', f'image skipped: {type(error).__name__}: {error}')

    def run(self) -> None:
        """Subscribe while somebody listens; returns when the node is told to end."""
        self.graph_watch.start()
        while not rospy.is_shutdown():
            self.input.update()
            reporter().catch_up()
            self.heap.tidy()
            self.input.wait(_PATIENCE)
        self.graph_watch.stop()
        self.worker.stop(_PATIENCE)


def run() -> int:
    """Read the parameters and run until the node is told to end; the exit status."""
    for problem in detector_modules.import_all(rospy.get_param('~detector_modules', [])):
        rospy.logerr(problem)
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
    try:
        if not isinstance(texts, list) or not texts:
            raise ContestantError(f'a list of detectors is wanted, such as {list(live.DEFAULT)}; got {shown(texts)}')
        side_by_side = live.SideBySide(live.contestants([str(text) for text in texts]), tile_width, masks)
    except ValueError as error:
        rospy.logfatal(f'~detectors: {error}')
        return _WRONG_PARAMETER
    CompareNode(side_by_side).run()
    return 0


def main() -> int:
    """Run the node until it is told to end; the exit status."""
    only_ros_arguments('compare_mosaic', __doc__)
    keep_large_blocks()
    cv2.setNumThreads(1)   # the times are to be comparable
    return spin('compare', run)


if __name__ == '__main__':
    sys.exit(main())
