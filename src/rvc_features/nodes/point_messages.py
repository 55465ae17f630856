"""Key points, descriptors and tracks as messages and as arrays, both ways; and as other packages read them.

For `cv2.KeyPoint` objects see `key_points.to_objects` and `key_points.from_objects`.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from geometry_msgs.msg import Point32
from sensor_msgs.msg import ChannelFloat32, PointCloud
from std_msgs.msg import Header

from rvc_features import key_points
from rvc_features.image_transport.whole_writes import header_bytes
from rvc_features.msg import Descriptors, KeyPoints, Tracks
from rvc_features.odometry import tracks as followed
from rvc_features.odometry.rays import Calibration

# VINS-Mono sends an id as a float32, which has no more whole numbers than these without a gap.
IDS_OF_A_FLOAT = 1 << 24


class _InPieces:
    """Before a message class of a header, texts, uint32 and arrays: these travel as NumPy has them, not one by one."""

    def pieces(self: Any) -> list[bytes]:
        """The bytes of the message, for `whole_writes`."""
        pieces = [header_bytes(self.header)]
        for name, kind in zip(self.__slots__[1:], self._slot_types[1:]):
            value = getattr(self, name)
            if kind == 'uint32':
                pieces.append(_UINT32.pack(value))
                continue
            if kind == 'string':
                value = value.encode()
            pieces.append(_UINT32.pack(len(value)))
            if len(value) > 0:   # most optional arrays are empty
                pieces.append(value if isinstance(value, bytes) else np.asarray(value, _TYPES[kind]).tobytes())
        return [b''.join(pieces)]

    def serialize(self, buff: Any) -> None:
        buff.writelines(self.pieces())


_UINT32 = struct.Struct('<I')
_TYPES = {kind: np.dtype(name) for kind, name in (
    ('uint8[]', 'u1'), ('int32[]', '<i4'), ('uint32[]', '<u4'), ('uint64[]', '<u8'), ('float32[]', '<f4'),
    ('float64[]', '<f8'))}


class _KeyPoints(_InPieces, KeyPoints):
    pass


class _Tracks(_InPieces, Tracks):
    pass


class _Descriptors(_InPieces, Descriptors):
    pass


def key_points_message(found: np.ndarray, header: Header, detector: str, shape: tuple[int, ...],
                       calibration: Calibration | None = None, covariances: np.ndarray | None = None) -> KeyPoints:
    """The message of key points.

    Parameters
    ----------
    found : ndarray of key_points.DTYPE
    header : std_msgs/Header
        Of the image.
    detector : str
        Its registered name.
    shape : tuple
        Of the image: height, width.
    calibration : Calibration, optional
        Of the camera, for the rays.
    covariances : ndarray, shape (N, 2, 2), optional
        Of the positions, as `covariance.covariances` returns them.
    """
    # All fields next to each other at once, for each by itself is picked out of its records at five times the cost.
    columns = np.ascontiguousarray(np.ascontiguousarray(found).view(np.float32).reshape(-1, len(key_points.NAMES)).T)
    message = _KeyPoints(header=header, detector=detector, width=shape[1], height=shape[0],
                        **dict(zip(key_points.NAMES, columns)))
    message.octave = columns[-1].view(np.int32)
    if calibration is not None:
        message.ray_x, message.ray_y = calibration.rays(_positions(found)).astype(np.float32).T
    if covariances is not None:
        message.covariance_xx, message.covariance_xy, message.covariance_yy = \
            np.stack((covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1])).astype(np.float32)
    return message


def from_key_points_message(message: KeyPoints) -> np.ndarray:
    """The key points of a message as an array of key_points.DTYPE."""
    return _structured(message, key_points.DTYPE)


def tracks_message(tracks: np.ndarray, header: Header, shape: tuple[int, ...], interval: float = 0.0,
                   calibration: Calibration | None = None) -> Tracks:
    """The message of tracks.

    Parameters
    ----------
    tracks : ndarray of tracks.DTYPE
    header : std_msgs/Header
        Of the image.
    shape : tuple
        Of the image: height, width.
    interval : float
        Seconds since the frame before, as in `Tracker.interval`.
    calibration : Calibration, optional
        Of the camera, for the rays.
    """
    message = _Tracks(header=header, width=shape[1], height=shape[0], **{name: tracks[name] for name in followed.NAMES})
    if calibration is not None:
        positions = _positions(tracks)
        velocity = np.column_stack((tracks['velocity_x'], tracks['velocity_y'])).astype(np.float64)
        rays, before = calibration.rays(positions), calibration.rays(positions - velocity * interval)
        message.ray_x, message.ray_y = rays.astype(np.float32).T
        ray_velocity = (rays - before) / interval if interval > 0 else np.zeros_like(rays)
        message.ray_velocity_x, message.ray_velocity_y = ray_velocity.astype(np.float32).T
    return message


def from_tracks_message(message: Tracks) -> np.ndarray:
    """The tracks of a message as an array of tracks.DTYPE."""
    return _structured(message, followed.DTYPE)


def descriptors_message(which: np.ndarray, rows: np.ndarray, header: Header, name: str, detector: str) -> Descriptors:
    """The message of descriptors, as `descriptors.describe` returns them."""
    return _Descriptors(header=header, name=name, detector=detector, size=rows.shape[1],
                       key_point=which.astype(np.uint32), data=rows.tobytes())


def from_descriptors_message(message: Descriptors) -> tuple[np.ndarray, np.ndarray]:
    """Which key points are described, and their descriptors: intp (N,) and uint8 (N, size)."""
    data = np.frombuffer(bytes(message.data), np.uint8)
    return np.array(message.key_point, np.intp), data.reshape(-1, message.size)


def vins_point_cloud(message: Tracks) -> PointCloud:
    """Tracks as the estimator of VINS-Mono reads them.

    `process` in its vins_estimator/src/estimator_node.cpp takes for each point: x and y, undistorted and normalised,
    with a z of exactly 1; channels[0] the id (times the number of cameras, which is one here), 1 and 2 the pixel u and
    v, 3 and 4 the velocity of x and y per second. A track that is new has no velocity yet and is left out, and the
    frame_id is `world`, which the estimator hands on to its point clouds: both as VINS-Mono's own front end does it
    (feature_tracker/src/feature_tracker_node.cpp). Ids are taken modulo 2^24, for they travel as float32.

    Raises
    ------
    ValueError
        When the message has no rays: the node that sends it has no calibration.
    """
    if len(message.id) and not len(message.ray_x):
        raise ValueError('these tracks have no rays; VINS-Mono wants undistorted normalised coordinates, so the '
                         'feature_detector needs a camera_info')
    seen = np.array(message.age, np.uint32) > 0
    fields = {name: np.array(getattr(message, name), np.float32)[seen]
              for name in ('ray_x', 'ray_y', 'x', 'y', 'ray_velocity_x', 'ray_velocity_y')}
    ids = (np.array(message.id, np.uint64)[seen] % np.uint64(IDS_OF_A_FLOAT)).astype(np.float32)
    channels = {'id_of_point': ids, 'u_of_point': fields['x'], 'v_of_point': fields['y'],
                'velocity_x_of_point': fields['ray_velocity_x'], 'velocity_y_of_point': fields['ray_velocity_y']}
    header = Header(seq=message.header.seq, stamp=message.header.stamp, frame_id='world')
    return PointCloud(header=header,
                      points=[Point32(x, y, 1.0) for x, y in zip(fields['ray_x'].tolist(), fields['ray_y'].tolist())],
                      channels=[ChannelFloat32(name, values) for name, values in channels.items()])


def _structured(message: Any, dtype: np.dtype) -> np.ndarray:
    names = dtype.names or ()
    array = np.zeros(len(getattr(message, names[0])), dtype)
    for name in names:
        array[name] = getattr(message, name)
    return array


def _positions(points: np.ndarray) -> np.ndarray:
    return np.column_stack((points['x'], points['y'])).astype(np.float64)
