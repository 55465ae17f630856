"""An advertised image topic, in all its transports."""

from __future__ import annotations

import threading
from typing import Any, Callable

import numpy as np
import rospy
import sensor_msgs.msg
from std_msgs.msg import Header

from rvc_features.brief import reporter
from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.messages import Image, to_image_message
from rvc_features.image_transport.transports import Transport
from rvc_features.image_transport.whole_writes import TopicPublisher, num_connections


class Publisher:
    """An advertised image topic; made by `ImageTransport.advertise`.

    An image is encoded at most once for each transport, and only for those that somebody listens to.
    """

    def __init__(self, base_topic: str, transports: list[Transport], queue_size: int, latch: bool,
                 subscriber_connected: Callable[[], Any] | None,
                 subscriber_disconnected: Callable[[], Any] | None) -> None:
        self._base_topic = base_topic
        self._latch = latch
        self._outlets = [
            _Outlet(transport, base_topic, queue_size, latch, subscriber_connected, subscriber_disconnected)
            for transport in transports]

    @property
    def errors(self) -> int:
        """How many images could not be encoded."""
        return sum(outlet.errors for outlet in self._outlets)

    @property
    def last_error(self) -> str:
        """Why the last one could not; empty if all could."""
        return next((outlet.last_error for outlet in self._outlets if outlet.last_error), '')

    def publish(self, message: sensor_msgs.msg.Image) -> None:
        """Send an image to whoever listens."""
        if getattr(message, '_type', None) != Image._type:
            raise TypeError(f'publish takes a {Image._type}, publish_array an array; got {type(message).__name__}')
        for outlet in self._outlets:
            outlet.publish(message)

    def publish_array(self, array: np.ndarray, encoding: str, header: Header | None = None) -> None:
        """Send an array as an image, without a copy that isn't needed; it may be changed afterwards.

        Raises
        ------
        ImageError
            When array and encoding do not belong together.
        """
        if self._latch:
            array = array.copy()
        if self._latch or self.get_num_subscribers() > 0:
            self.publish(to_image_message(array, encoding, header))

    def get_num_subscribers(self) -> int:
        """How many subscribers there are, in all transports together."""
        return sum(num_connections(outlet.publisher) for outlet in self._outlets)

    def get_topic(self) -> str:
        """The resolved base topic."""
        return self._base_topic

    def shutdown(self) -> None:
        """Withdraw the topic in all its transports."""
        outlets, self._outlets = self._outlets, []
        for outlet in outlets:
            outlet.shutdown()


class _Outlet(rospy.SubscribeListener):
    """One transport of a publisher."""

    def __init__(self, transport: Transport, base_topic: str, queue_size: int, latch: bool,
                 subscriber_connected: Callable[[], Any] | None,
                 subscriber_disconnected: Callable[[], Any] | None) -> None:
        super().__init__()
        self.errors, self.last_error = 0, ''
        self._transport = transport
        self._latch = latch
        self._last: sensor_msgs.msg.Image | None = None      # latched
        self._last_encoded: tuple[Any, Any] = (None, None)   # an image and what it was encoded to
        self._connected, self._disconnected = subscriber_connected, subscriber_disconnected
        self._sending = threading.Lock()   # rospy has none for sending to a single subscriber
        self._topic = transport.topic(base_topic)
        transport.start_publishing(self._topic)
        # Latching is ours and only announced by the header: rospy's would want each image encoded in advance.
        self.publisher = TopicPublisher(self._topic, transport.message_class, self, queue_size,
                                        headers={'latching': '1'} if latch else None)

    def publish(self, image: sensor_msgs.msg.Image) -> None:
        if self._latch:
            self._last = image   # before looking for subscribers: one that comes in between finds it
        if num_connections(self.publisher) > 0:
            message = self._encoded(image)
            if message is not None:
                with self._sending:
                    self.publisher.publish(message)

    def shutdown(self) -> None:
        with self._sending:
            self._last = None
            unregister(self.publisher)
        self._transport.stop_publishing()

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        """Called by rospy, in the thread that accepts connections."""
        last = self._last
        message = None if last is None else self._encoded(last)
        if message is not None:
            with self._sending:
                if self._last is last:   # or else a newer one comes to this subscriber as to all
                    peer_publish(message)
        if self._connected is not None:
            self._connected()

    def peer_unsubscribe(self, topic_name: str, num_peers: int) -> None:
        """Called by rospy with its locks held."""
        if self._disconnected is not None:
            self._disconnected()

    def _encoded(self, image: sensor_msgs.msg.Image) -> Any:
        """The transport's message; None where there is none, which is counted and reported."""
        source, message = self._last_encoded
        if source is image:
            return message
        try:
            message = self._transport.encode(image)
        except ImageError as error:
            self.errors, self.last_error = self.errors + 1, str(error)
            reporter().say(rospy.logwarn, f'sending {self._topic}',
                           f'{self._topic}: image not sent, {self.errors} so far: {error}')
            return None
        if self._latch:
            self._last_encoded = image, message
        return message


def unregister(topic: rospy.topics.Topic) -> None:
    """Unregister a publisher or subscriber, and close the poller that rospy leaves to the collector (ros_comm#2373)."""
    implementation = topic.impl
    topic.unregister()
    if implementation is not None and implementation.closed:   # else others in this node use it too
        close = getattr(implementation.connection_poll.poller, 'close', None)
        if close is not None:   # of epoll and kqueue
            close()
