"""All that the node does for an odometry, behind one object: mask, rays, tracks, descriptors, and the service.

Each part is off until somebody asks for it: a topic is computed while it has listeners, a mask counts once one is
there, and rays are sent once there is a calibration.
"""

from __future__ import annotations

from typing import Any, Callable

import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from rvc_features.brief import reporter
from rvc_features.feature_detector import FeatureDetector
from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.image_transport import most_megapixels
from rvc_features.image_transport.messages import to_array
from rvc_features.image_transport.whole_reads import subscribe
from rvc_features.image_transport.whole_writes import TopicPublisher
from rvc_features.msg import Descriptors, KeyPoints, Tracks
from rvc_features.nodes import odometry_config
from rvc_features.nodes.point_messages import descriptors_message, key_points_message, tracks_message
from rvc_features.odometry.covariance import covariances
from rvc_features.odometry.descriptors import describe
from rvc_features.odometry.masks import MaskError, Masks, parse, shaded
from rvc_features.odometry.rays import Calibration, CalibrationError, from_camera_info
from rvc_features.odometry.tracks import Tracker
from rvc_features.odometry.trails import Trails
from rvc_features.srv import Detect, DetectRequest, DetectResponse

_STALE = 5.0   # seconds that a mask with a stamp may be behind the image before it is said


class OdometryOutputs:
    """Made before the node listens to anything; `start` brings it onto topics.

    Parameters
    ----------
    detector : callable
        Returns the detector of this moment, for the service.
    """

    def __init__(self, detector: Callable[[], FeatureDetector]) -> None:
        self.masks = Masks()
        self.calibration: Calibration | None = None
        self._detector = detector
        self._tracker, self._trails = Tracker(), Trails()
        self._draw_trails, self._descriptor = False, 'orb'
        self._with_covariance, self._noise = False, 0.0
        self._camera_info: Any = None          # the fields of the last one
        self._mask_stamp = rospy.Time()
        self._number_of_tracks = 0
        self._publishers: tuple[TopicPublisher, TopicPublisher] | None = None

    def configure(self, config: Any) -> None:
        """Take over settled dynamic parameters."""
        self.masks.border = odometry_config.border(config)
        self._tracker.settings = odometry_config.tracker(config)
        self._draw_trails = config.get('trails', False)
        self._descriptor = config.get('descriptor', 'orb')
        self._with_covariance = config.get('covariance', False)
        self._noise = config.get('covariance_noise', 0.0)

    def start(self, listener: rospy.SubscribeListener, refuse: Callable[[list[str]], Any]) -> None:
        """Read ~mask, advertise and subscribe; `refuse` takes sentences about parameters that make no sense."""
        try:
            self.masks.fixed = parse(rospy.get_param('~mask', ''))
        except MaskError as error:
            refuse([f'~mask: {error}; no mask is used'])
        self._publishers = (TopicPublisher('tracks', Tracks, listener),
                            TopicPublisher('descriptors', Descriptors, listener))
        limit = most_megapixels()
        subscribe('mask', Image, self._take_mask, limit, queue_size=1, buff_size=1 << 24)
        subscribe('camera_info', CameraInfo, self._take_camera_info, limit, queue_size=1)
        rospy.Service('detect', Detect, self._detect)

    def listeners(self) -> int:
        return sum(publisher.get_num_connections() for publisher in self._publishers or ())

    def mask(self, shape: tuple[int, ...], header: Header) -> np.ndarray | None:
        """Where points may lie in that image; what is wrong with a mask that was given is said."""
        problem = self.masks.problem(shape)
        if problem:
            reporter().say(rospy.logwarn, 'mask', problem)
        elif self._mask_stamp and header.stamp and (header.stamp - self._mask_stamp).to_sec() > _STALE:
            reporter().say(rospy.logwarn, 'mask age', f'the mask is stale: it is '
                           f'{(header.stamp - self._mask_stamp).to_sec():.1f} s older than the image, and still counts '
                           '(one that always holds has the stamp 0)')
        return self.masks.of(shape)

    def key_points(self, image: np.ndarray, found: np.ndarray, header: Header, detector: FeatureDetector) -> KeyPoints:
        """The message of key points, with rays where there is a calibration for such images."""
        return key_points_message(found, header, detector.name, image.shape, self._fitting(image.shape),
                                  self._covariances(image, found, detector) if self._with_covariance else None)

    def publish(self, image: np.ndarray, found: np.ndarray, header: Header, detector: FeatureDetector,
                mask: np.ndarray | None, drawing: bool) -> None:
        """Follow, describe and publish what somebody listens to; `drawing`: trails may be wanted in the picture."""
        if self._publishers is None:
            return
        tracks, descriptors = self._publishers
        if tracks.get_num_connections() > 0 or (drawing and self._draw_trails):
            self._follow(image, found, header, detector, mask, tracks)
        elif self._number_of_tracks:
            self._tracker.reset()   # whoever listens next begins with new tracks: frames have gone by unseen
            self._trails.clear()
            self._number_of_tracks = 0
        if descriptors.get_num_connections() > 0:
            name = self._descriptor
            descriptors.publish(descriptors_message(*describe(image, found, name), header, name, detector.name))

    def _follow(self, image: np.ndarray, found: np.ndarray, header: Header, detector: FeatureDetector,
                mask: np.ndarray | None, publisher: TopicPublisher) -> None:
        calibration = self._fitting(image.shape)
        undistort = None if calibration is None else calibration.undistorted
        followed = self._tracker.track(image, header.stamp.to_sec(), detector, mask, undistort, found)
        self._number_of_tracks = len(followed)
        if self._draw_trails:
            self._trails.add(followed)
        publisher.publish(tracks_message(followed, header, image.shape, self._tracker.interval, calibration))

    def drawn(self, picture: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
        """The picture with the mask faintly and the trails, drawn in place."""
        shaded(picture, mask)
        return self._trails.draw(picture) if self._draw_trails else picture

    def values(self) -> dict[str, Any]:
        """What there is to say in diagnostics."""
        return {'tracks in last frame': self._number_of_tracks, 'calibrated': self.calibration is not None}

    def _covariances(self, image: np.ndarray, found: np.ndarray, detector: FeatureDetector) -> np.ndarray | None:
        try:
            return covariances(image, found, detector, self._noise or None)
        except ValueError as error:
            reporter().say(rospy.logwarn, 'covariance', str(error))
            return None

    def _fitting(self, shape: tuple[int, ...]) -> Calibration | None:
        calibration = self.calibration
        if calibration is None:
            return None
        problem = calibration.misfit(shape)
        if problem:
            reporter().say(rospy.logwarn, 'calibration size', problem)
            return None
        return calibration

    def _take_mask(self, message: Image) -> None:
        try:
            if message.encoding not in ('mono8', '8UC1'):
                raise MaskError(f'its encoding is {message.encoding!r}; accepted are mono8 and 8UC1')
            self.masks.add(to_array(message, 'mono8'))
        except (ImageError, MaskError) as error:
            reporter().say(rospy.logwarn, 'mask refused', f'mask refused, the last one stays: {error}')
        else:
            self._mask_stamp = message.header.stamp

    def _take_camera_info(self, message: CameraInfo) -> None:
        region = message.roi
        fields = (message.width, message.height, message.distortion_model, tuple(message.K), tuple(message.D),
                  (message.binning_x, message.binning_y))
        where = region.x_offset, region.y_offset, region.width, region.height
        if (fields, where) == self._camera_info:
            return
        self._camera_info = fields, where
        try:
            self.calibration = from_camera_info(*fields, region)
        except CalibrationError as error:
            self.calibration = None
            reporter().say(rospy.logwarn, 'calibration', str(error))

    def _detect(self, request: DetectRequest) -> DetectResponse:
        detector = self._detector()
        try:
            grey = to_array(request.image, 'mono8')
        except ImageError as error:
            raise rospy.ServiceException(f'no key points of that image: {error}') from None
        found = detector.detect_arrays(grey, self.masks.of(grey.shape))
        return DetectResponse(self.key_points(grey, found, request.image.header, detector))
