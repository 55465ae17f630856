"""A running node, fed with images and watched on its topics and its dynamic_reconfigure server."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any, Mapping, Sequence

import cv2
import numpy as np
import rosgraph
import rospy
from dynamic_reconfigure.client import Client
from roslib.message import get_message_class
from sensor_msgs.msg import Image

from rvc_features import key_points
from rvc_features.exercise.drawings import is_grey, points_drawn
from rvc_features.exercise.questions import PARAMETERS, Probe
from rvc_features.exercise.subject import Answer, CannotRunError
from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.messages import to_array, to_image_message

_FRAME = 'check_exercise_camera'


@dataclass(frozen=True)
class Reply:
    """What came of one image: the picture as BGR, or why it can't be read; key points where there are any."""

    stamp_kept: bool
    frame_kept: bool
    encoding: str
    picture: np.ndarray | None
    unreadable: str
    points: np.ndarray | None


class NodeSubject:
    """Between the topics of a node.

    Parameters
    ----------
    topics : mapping
        in and image, and perhaps key_points.
    seconds : float
        Limit for the answer to one image.

    Raises
    ------
    CannotRunError
        When there is no master, or nothing comes of the images.
    """

    def __init__(self, topics: Mapping[str, str], seconds: float) -> None:
        if not rosgraph.is_master_online():
            raise CannotRunError('there is no ROS master; start the node first')
        rospy.init_node('check_exercise', anonymous=True, disable_signals=True)
        self.name = f'node from {topics["in"]} to {topics["image"]}'
        self.printed = ''
        self.seconds = seconds
        self._arrived = threading.Condition()
        self._pictures: list[Any] = []
        self._points: list[Any] = []
        self._count = 0
        self._camera = rospy.Publisher(topics['in'], Image, queue_size=10)
        self._listeners = [rospy.Subscriber(topics['image'], Image, self._keep(self._pictures), queue_size=50)]
        self.has_points = 'key_points' in topics
        if self.has_points:
            self._listeners.append(rospy.Subscriber(topics['key_points'], rospy.AnyMsg, self._keep(self._points),
                                                    queue_size=50))
        self._connect(topics)
        self.client = self._server(topics['image'])
        described = self.client.get_parameter_descriptions(timeout=seconds) if self.client else []
        known = {entry['name'].lower(): entry['name'] for entry in described}
        self.takes: Mapping[str, str] = {name: known[name] for name in PARAMETERS if name in known}
        kinds = {entry['name']: entry['type'] for entry in described}
        self.whole_threshold = kinds.get(self.takes.get('threshold', '')) == 'int'
        if self.whole_threshold:
            name = self.takes['threshold']      # not a share of H_max
            self.takes = {one: own for one, own in self.takes.items() if one != 'threshold'}
            entry = next(entry for entry in described if entry['name'] == name)
            self.threshold_name, self.threshold_range = name, (entry['min'], entry['max'])
        self.configuration = self._present()

    def exchange(self, image: np.ndarray, encoding: str = '') -> Reply | None:
        """Send an image, and wait for what comes of it; None where nothing does."""
        message = to_image_message(image, encoding or ('mono8' if image.ndim == 2 else 'bgr8'))
        self._count += 1
        message.header.stamp, message.header.frame_id = rospy.Time(1000 + self._count, self._count), _FRAME
        with self._arrived:
            self._pictures.clear()
            self._points.clear()
        self._camera.publish(message)
        deadline = time.monotonic() + self.seconds
        with self._arrived:
            while not (self._pictures and (self._points or not self.has_points)):
                left = deadline - time.monotonic()
                if left <= 0 or not self._arrived.wait(left):
                    break
            if not self._pictures:
                return None
            picture, points = self._pictures[0], self._points[0] if self._points else None
        try:
            pixels, unreadable = to_array(picture, 'bgr8', writable=True), ''
        except ImageError as error:
            pixels, unreadable = None, str(error)
        return Reply(picture.header.stamp == message.header.stamp, picture.header.frame_id == _FRAME,
                     picture.encoding, pixels, unreadable, None if points is None else _points_in(points))

    def configure(self, values: Mapping[str, Any]) -> None:
        """Set parameters by the sheet's names, those that the server has."""
        if self.client is not None:
            self.client.update_configuration({self.takes[name]: value for name, value in values.items()
                                              if name in self.takes})

    def set_threshold(self, value: int) -> None:
        """Set a threshold that is a whole number."""
        if self.client is not None:
            self.client.update_configuration({self.threshold_name: value})

    def answer(self, probe: Probe, before: Sequence[np.ndarray] = ()) -> Answer:
        """What the node finds in the probe's image."""
        if probe.scene.mask is not None:
            return Answer(None, no_mask=True)
        self.configure(probe.parameters)
        for image in (*before, probe.scene.image):
            reply = self.exchange(self.lifted(image))
        if reply is None:
            return Answer(None, f'it hangs: nothing came of an image in {self.seconds:g} s')
        points = self.points(reply, self.lifted(probe.scene.image))
        if points is None:
            return Answer(None, reply.unreadable or 'the picture is not the one that came in')
        return Answer(points)

    def points(self, reply: Reply | None, image: np.ndarray) -> np.ndarray | None:
        """The key points that came of an image, from their topic or else from the drawing."""
        if reply is None or reply.points is not None:
            return None if reply is None else reply.points
        if reply.picture is None:
            return None
        grey_of_colour = image.ndim == 3 and is_grey(reply.picture)
        return points_drawn(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if grey_of_colour else image, reply.picture)

    def lifted(self, image: np.ndarray) -> np.ndarray:
        """The image as it is sent: where points are found in the drawing, so bright that black circles can be seen."""
        return image if self.has_points else (image * 0.7 + 60).astype(np.uint8)

    def close(self) -> None:
        """Leave the node as it was."""
        if self.client is not None:
            self.client.update_configuration(self.configuration)
            self.client.close()
        for listener in self._listeners:
            listener.unregister()
        self._camera.unregister()

    def _keep(self, where: list[Any]) -> Any:
        def keep(message: Any) -> None:
            with self._arrived:
                where.append(message)
                self._arrived.notify_all()
        return keep

    def _connect(self, topics: Mapping[str, str]) -> None:
        """Send images until something comes of one: topics connect when they connect."""
        deadline = time.monotonic() + max(10.0, self.seconds)
        image = np.zeros((64, 64, 3), np.uint8)
        image[20:40, 20:40] = 200
        limit, self.seconds = self.seconds, 0.3
        while self.exchange(image) is None:
            if time.monotonic() > deadline:
                listening = self._camera.get_num_connections() > 0
                raise CannotRunError(f'nothing came on {topics["image"]}; ' + (
                    f'somebody listens to {topics["in"]}' if listening else f'nobody listens to {topics["in"]}'))
        self.seconds = limit
        time.sleep(0.3)      # what else comes of those images
        self.exchange(image)

    def _server(self, topic: str) -> Client | None:
        """The dynamic_reconfigure server of the node that publishes the picture: the one with most of the names."""
        publishers, _, services = rosgraph.Master(rospy.get_name()).getSystemState()
        owners = {node for name, nodes in publishers if name == rospy.resolve_name(topic) for node in nodes}
        clients = []
        for service, nodes in services:
            if service.endswith('/set_parameters') and owners & set(nodes):
                clients.append(Client(service[:-len('/set_parameters')], timeout=self.seconds))
        clients.sort(key=lambda client: -sum(entry['name'].lower() in PARAMETERS for entry in
                                             client.get_parameter_descriptions(timeout=self.seconds)))
        for client in clients[1:]:
            client.close()
        return clients[0] if clients else None

    def _present(self) -> dict[str, Any]:
        if self.client is None:
            return {}
        present = self.client.get_configuration(timeout=self.seconds)
        return {name: value for name, value in present.items() if name != 'groups'}


def _points_in(message: Any) -> np.ndarray:
    """Key points of whatever message has them: arrays x and y, or a list of points."""
    kind = get_message_class(message._connection_header['type'])
    if kind is None:
        raise CannotRunError(f'{message._connection_header["type"]} is not installed here')
    read: Any = kind().deserialize(message._buff)
    if hasattr(read, 'x') and hasattr(read, 'y'):
        found = key_points.empty(len(read.x))
        for name in key_points.NAMES:
            if len(getattr(read, name, ())) == len(found):
                found[name] = getattr(read, name)
        return found
    for name in read.__slots__:
        values = getattr(read, name)
        if isinstance(values, (list, tuple)):
            places: list[Any] = [getattr(value, 'pt', value) for value in values]
            if all(hasattr(place, 'x') and hasattr(place, 'y') for place in places):
                found = key_points.empty(len(places))
                found['x'], found['y'] = [place.x for place in places], [place.y for place in places]
                return found
    raise CannotRunError(f'{message._connection_header["type"]} has no key points that are known here: arrays x and y, '
                         'or a list of points')
