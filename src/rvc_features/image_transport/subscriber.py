"""A subscription to an image topic, by one of its transports."""

from __future__ import annotations

from typing import Any, Callable

import rospy
import sensor_msgs.msg

from rvc_features.brief import reporter
from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.messages import Image, whole
from rvc_features.image_transport.publisher import unregister
from rvc_features.image_transport.transports import TRANSPORTS, Transport
from rvc_features.image_transport.whole_reads import FIRST_READ, read_messages, received
from rvc_features.image_transport.whole_writes import num_connections

# How much rospy reads at once: more than a message, or old frames wait in the socket although queue_size is 1. Raw
# images for callbacks that only store are read whole instead.
_LARGE_BUFFER = 1 << 24   # bytes


class Subscriber:
    """A subscription to an image topic; made by `ImageTransport.subscribe`."""

    def __init__(self, base_topic: str, callback: Callable[[Any], Any], queue_size: int, transport: Transport,
                 tcp_nodelay: bool, decode: bool, megapixels: float) -> None:
        self.errors = 0   # messages that could not be decoded
        self._base_topic = base_topic
        self._transport = transport
        self._callback: Callable[[Any], Any] | None = callback
        self._decode = decode
        _warn_of_transport_in(self._base_topic)
        at_once = not decode and self._transport.message_class is Image
        self._subscriber = rospy.Subscriber(
            self.get_topic(), received(self._transport.message_class, megapixels), self._receive,
            queue_size=queue_size or None, buff_size=FIRST_READ if at_once else _LARGE_BUFFER, tcp_nodelay=tcp_nodelay)
        read_messages(self._subscriber, at_once)

    def get_num_publishers(self) -> int:
        """How many publishers the subscriber is connected to."""
        return num_connections(self._subscriber)

    def get_topic(self) -> str:
        """The topic that messages come on: that of the transport, such as /camera/image/compressed."""
        return self._transport.topic(self._base_topic)

    def get_transport(self) -> str:
        """Name of the transport in use."""
        return self._transport.name

    def decode(self, message: Any) -> sensor_msgs.msg.Image:
        """The image in a message that the callback got undecoded; ImageError where there is none."""
        return self._transport.decode(whole(message))

    def shutdown(self) -> None:
        """Unsubscribe; a callback that has begun may still be running afterwards, but none begins."""
        self._callback = None
        unregister(self._subscriber)

    def _receive(self, message: Any) -> None:
        callback = self._callback
        if callback is None:
            return
        try:
            image = self.decode(message) if self._decode else message
        except ImageError as error:
            self.errors += 1
            topic = self.get_topic()
            reporter().say(rospy.logwarn, f'reading {topic}', f'{topic}: image skipped, {self.errors} so far: {error}')
            return
        callback(image)


def _warn_of_transport_in(base_topic: str) -> None:
    parent, _, last = base_topic.rpartition('/')
    if last in TRANSPORTS:
        rospy.logwarn(f'{base_topic} looks like the topic of one transport. Subscribe to the image topic {parent} '
                      f'instead, with parameter ~image_transport set to {last} (_image_transport:={last})')
