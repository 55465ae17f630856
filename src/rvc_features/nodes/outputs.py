"""What the node publishes of an image, and how it learns that somebody listens."""

from __future__ import annotations

import threading
from typing import Any

import rospy
from sensor_msgs.msg import Image

from rvc_features.image_transport import ImageTransport
from rvc_features.image_transport.whole_writes import TopicPublisher
from rvc_features.msg import KeyPoints


class Publishers:
    """The picture, the key points and the response map."""

    def __init__(self, changed: threading.Event) -> None:
        listener = Listener(changed)
        self.image = ImageTransport().advertise('image', queue_size=1, subscriber_connected=changed.set,
                                                subscriber_disconnected=changed.set)
        self.key_points = TopicPublisher('key_points', KeyPoints, listener)
        self.response = TopicPublisher('response', Image, listener)

    def listeners(self) -> int:
        return (self.image.get_num_subscribers() + self.key_points.get_num_connections()
                + self.response.get_num_connections())


class Listener(rospy.SubscribeListener):
    """Sets an event when somebody begins or ceases to listen."""

    def __init__(self, changed: threading.Event) -> None:
        super().__init__()
        self._changed = changed

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        self._changed.set()

    def peer_unsubscribe(self, topic_name: str, num_peers: int) -> None:
        self._changed.set()
