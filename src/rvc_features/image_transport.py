"""image_transport for Python: images over topics, raw or compressed, exchangeable with C++ nodes.

    transport = ImageTransport()
    publisher = transport.advertise('camera/image')             # also camera/image/compressed
    publisher.publish(message)                                  # or publish_array(array, 'bgr8', header)
    subscriber = transport.subscribe('camera/image', callback)  # raw, or what ~image_transport says

Names, parameters and behaviour are those of the C++ package, in Python's spelling: docs/image_transport.md lists them.
"""

from __future__ import annotations

import dataclasses
import threading
from abc import ABC, abstractmethod
from typing import Any, Callable, ClassVar, Iterable

import numpy as np
import rosgraph.names
import rospy
import sensor_msgs.msg
from std_msgs.msg import Header

from rvc_features.cfg import CompressedPublisherConfig
from rvc_features.image_messages import (
    COMPRESSED_FORMATS,
    Image,
    ImageError,
    to_compressed_message,
    to_image_message,
    unpack,
)
from rvc_features.reconfigure import ReconfigureServer
from rvc_features.whole_reads import FIRST_READ, read_whole_messages

_WARNING_PERIOD = 5.0   # seconds between two reports of the same trouble

# How much rospy reads at once: more than a message, or old frames wait in the socket although queue_size is 1. Raw
# images for callbacks that only store are read whole instead.
_LARGE_BUFFER = 1 << 24   # bytes


@dataclasses.dataclass(frozen=True)
class TransportHints:
    """Which transport a subscriber uses.

    Parameters
    ----------
    transport : str
        The one to use unless the parameter says otherwise.
    parameter_name, parameter_namespace : str
        The parameter that overrules it; default: ~image_transport.
    tcp_nodelay : bool
        Ask the publisher to send at once instead of waiting to fill a packet.
    """

    transport: str = 'raw'
    parameter_name: str = 'image_transport'
    parameter_namespace: str = '~'
    tcp_nodelay: bool = True

    def get_transport(self) -> str:
        return rospy.get_param(rosgraph.names.ns_join(self.parameter_namespace, self.parameter_name), self.transport)


class ImageTransport:
    """Advertises and subscribes to image topics; the node must be initialised."""

    def advertise(self, base_topic: str, queue_size: int = 1, latch: bool = False,
                  subscriber_connected: Callable[[], Any] | None = None,
                  subscriber_disconnected: Callable[[], Any] | None = None,
                  transports: Iterable[str] | None = None) -> Publisher:
        """Announce an image topic, in every transport that is not turned off.

        Parameters
        ----------
        base_topic : str
        queue_size : int
            How many messages may wait for a slow subscriber before the oldest is dropped; 0 for any number.
        latch : bool
            Keep the last image for those who subscribe later.
        subscriber_connected, subscriber_disconnected : callable, optional
            Called with no arguments, in threads of rospy that hold its locks: setting an event is all they should do.
        transports : iterable of str, optional
            Only these; default: all but those in the parameter <base_topic>/disable_pub_plugins.

        Raises
        ------
        ValueError
            When a transport is unknown, or `queue_size` is not a number (rospy would send synchronously).
        """
        if not isinstance(queue_size, int) or queue_size < 0:
            raise ValueError(f'queue_size must be an integer of at least 0; got {queue_size!r}')
        base_topic = rospy.resolve_name(base_topic)
        names = _enabled_transports(base_topic) if transports is None else transports
        return Publisher(base_topic, [_transport(name) for name in names], queue_size, latch, subscriber_connected,
                         subscriber_disconnected)

    def subscribe(self, base_topic: str, callback: Callable[[Any], Any], queue_size: int = 1,
                  transport_hints: TransportHints | str | None = None, decode: bool = True) -> Subscriber:
        """Have `callback` called with each image that arrives.

        Parameters
        ----------
        base_topic : str
            Without the transport's name: that is appended after the name has been resolved.
        callback : callable
            Takes a sensor_msgs/Image, whatever the transport is.
        queue_size : int
            How many messages may wait for the callback before the oldest is dropped; 0 for any number.
        transport_hints : TransportHints or str, optional
            A string is the transport's name.
        decode : bool
            False: `callback` takes the transport's own message untouched, and should only put it where a thread of
            the caller's finds the newest; `image_messages.to_array` decodes it there.

        Raises
        ------
        ValueError
            When the transport is unknown.
        """
        hints = transport_hints or TransportHints()
        if isinstance(hints, str):
            hints = TransportHints(hints)
        return Subscriber(rospy.resolve_name(base_topic), callback, queue_size, _transport(hints.get_transport()),
                          hints.tcp_nodelay, decode)

    def get_declared_transports(self) -> list[str]:
        """Names of all transports."""
        return sorted(TRANSPORTS)


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
        return sum(outlet.get_num_subscribers() for outlet in self._outlets)

    def get_topic(self) -> str:
        """The resolved base topic."""
        return self._base_topic

    def shutdown(self) -> None:
        """Withdraw the topic in all its transports."""
        outlets, self._outlets = self._outlets, []
        for outlet in outlets:
            outlet.shutdown()


class Subscriber:
    """A subscription to an image topic; made by `ImageTransport.subscribe`."""

    def __init__(self, base_topic: str, callback: Callable[[Any], Any], queue_size: int, transport: Transport,
                 tcp_nodelay: bool, decode: bool) -> None:
        self.errors = 0   # messages that could not be decoded
        self._base_topic = base_topic
        self._transport = transport
        self._callback: Callable[[Any], Any] | None = callback
        self._decode = decode
        _warn_of_transport_in(self._base_topic)
        whole = not decode and self._transport.message_class is Image
        self._subscriber = rospy.Subscriber(
            self._transport.topic(self._base_topic), self._transport.message_class, self._receive,
            queue_size=queue_size or None, buff_size=FIRST_READ if whole else _LARGE_BUFFER, tcp_nodelay=tcp_nodelay)
        if whole:
            read_whole_messages(self._subscriber)

    def get_num_publishers(self) -> int:
        """How many publishers the subscriber is connected to."""
        return _num_connections(self._subscriber)

    def get_topic(self) -> str:
        """The resolved base topic; that of the transport may be another one."""
        return self._base_topic

    def get_transport(self) -> str:
        """Name of the transport in use."""
        return self._transport.name

    def shutdown(self) -> None:
        """Unsubscribe; a callback that has begun may still be running afterwards, but none begins."""
        self._callback = None
        self._subscriber.unregister()

    def _receive(self, message: Any) -> None:
        callback = self._callback
        if callback is None:
            return
        try:
            image = self._transport.decode(message) if self._decode else message
        except ImageError as error:
            self.errors += 1
            rospy.logwarn_throttle(_WARNING_PERIOD, f'{self._transport.topic(self._base_topic)}: image skipped, '
                                                    f'{self.errors} so far: {error}')
            return
        callback(image)


class Transport(ABC):
    """A way for images to travel. To add one, derive a class and enter it in TRANSPORTS under its name.

    There is one instance for each publisher and each subscriber; those of publishers may have parameters.
    """

    name: ClassVar[str]
    message_class: ClassVar[type]

    def topic(self, base_topic: str) -> str:
        """Name of the transport's topic; `base_topic` is resolved."""
        return f'{base_topic}/{self.name}'

    def start_publishing(self, topic: str) -> None:   # noqa: B027  (many transports need none)
        """Called once before the first `encode`; parameters belong under `topic`."""

    def stop_publishing(self) -> None:   # noqa: B027
        """Called once after the last `encode`."""

    @abstractmethod
    def encode(self, image: sensor_msgs.msg.Image) -> Any:
        """The message to send for an image; ImageError where there is none."""

    @abstractmethod
    def decode(self, message: Any) -> sensor_msgs.msg.Image:
        """The image that a message holds; ImageError where there is none."""


class RawTransport(Transport):
    """The image as it is."""

    name = 'raw'
    message_class = Image

    def topic(self, base_topic: str) -> str:
        return base_topic

    def encode(self, image: sensor_msgs.msg.Image) -> sensor_msgs.msg.Image:
        return image

    def decode(self, message: sensor_msgs.msg.Image) -> sensor_msgs.msg.Image:
        return message


class CompressedTransport(Transport):
    """JPEG or PNG, with the parameters of cfg/CompressedPublisher.cfg under the topic."""

    name = 'compressed'
    message_class = sensor_msgs.msg.CompressedImage

    def start_publishing(self, topic: str) -> None:
        self._parameters = dict(CompressedPublisherConfig.defaults)
        self._server: ReconfigureServer | None = None
        try:
            self._server = ReconfigureServer(CompressedPublisherConfig, self.update_config, topic)
        except rospy.service.ServiceException:
            rospy.logwarn(f'{topic} is advertised twice in this node; only the parameters of the first can be changed')

    def stop_publishing(self) -> None:
        if self._server is not None:
            self._server.set_service.shutdown('image topic withdrawn')
            self._server.descr_topic.unregister()
            self._server.update_topic.unregister()

    def update_config(self, config: Any, level: int) -> Any:
        """Callback of dynamic_reconfigure, which has checked the numbers."""
        if config['format'] not in COMPRESSED_FORMATS:
            rospy.logwarn(f'format must be one of {", ".join(COMPRESSED_FORMATS)}; got {config["format"]!r}, '
                          f'{self._parameters["format"]!r} stays')
            config['format'] = self._parameters['format']
        self._parameters = {name: config[name] for name in self._parameters}
        return config

    def encode(self, image: sensor_msgs.msg.Image) -> sensor_msgs.msg.CompressedImage:
        return to_compressed_message(*unpack(image), image.header, **self._parameters)

    def decode(self, message: sensor_msgs.msg.CompressedImage) -> sensor_msgs.msg.Image:
        return to_image_message(*unpack(message), message.header)


TRANSPORTS: dict[str, type[Transport]] = {'raw': RawTransport, 'compressed': CompressedTransport}


def known_transport(reject: Callable[[str], None] = rospy.logwarn) -> TransportHints:
    """What ~image_transport says; where there is no such transport, raw, and a sentence to `reject`."""
    asked = str(TransportHints().get_transport())
    if asked not in TRANSPORTS:
        reject(f"~image_transport must be one of {', '.join(sorted(TRANSPORTS))}; got {asked!r}, 'raw' is used")
        asked = 'raw'
    return TransportHints(asked, parameter_name='image_transport_in_use')


class _Outlet(rospy.SubscribeListener):
    """One transport of a publisher."""

    def __init__(self, transport: Transport, base_topic: str, queue_size: int, latch: bool,
                 subscriber_connected: Callable[[], Any] | None,
                 subscriber_disconnected: Callable[[], Any] | None) -> None:
        super().__init__()
        self.errors = 0
        self._transport = transport
        self._latch = latch
        self._last: sensor_msgs.msg.Image | None = None      # latched
        self._last_encoded: tuple[Any, Any] = (None, None)   # an image and what it was encoded to
        self._connected, self._disconnected = subscriber_connected, subscriber_disconnected
        self._sending = threading.Lock()   # rospy has none for sending to a single subscriber
        self._topic = transport.topic(base_topic)
        transport.start_publishing(self._topic)
        # Latching is ours and only announced by the header: rospy's would want each image encoded in advance.
        self._publisher = rospy.Publisher(
            self._topic, transport.message_class, subscriber_listener=self, tcp_nodelay=True, queue_size=queue_size,
            headers={'latching': '1'} if latch else None)

    def publish(self, image: sensor_msgs.msg.Image) -> None:
        if self._latch:
            self._last = image   # before looking for subscribers: one that comes in between finds it
        if self.get_num_subscribers() > 0:
            message = self._encoded(image)
            if message is not None:
                with self._sending:
                    if self._publisher.impl is not None:   # not shut down by another thread meanwhile
                        self._publisher.publish(message)

    def get_num_subscribers(self) -> int:
        return _num_connections(self._publisher)

    def shutdown(self) -> None:
        with self._sending:
            self._last = None
            self._publisher.unregister()
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
            self.errors += 1
            rospy.logwarn_throttle(_WARNING_PERIOD, f'{self._topic}: image not sent, {self.errors} so far: {error}')
            return None
        if self._latch:
            self._last_encoded = image, message
        return message


def _num_connections(topic: rospy.topics.Topic) -> int:
    """As topic.get_num_connections, without its lock, which rospy also holds while it announces that one has left."""
    implementation = topic.impl   # None after unregister
    return 0 if implementation is None else len(implementation.connections)


def _transport(name: Any) -> Transport:
    if not isinstance(name, str) or name not in TRANSPORTS:
        raise ValueError(f'unknown image transport {name!r}; there are {", ".join(sorted(TRANSPORTS))}')
    return TRANSPORTS[name]()


def _enabled_transports(base_topic: str) -> list[str]:
    """All but those that <base_topic>/disable_pub_plugins lists, by names like image_transport/compressed."""
    parameter = f'{base_topic}/disable_pub_plugins'
    disabled = rospy.get_param(parameter, [])
    if not isinstance(disabled, list):
        rospy.logwarn(f'{parameter} must be a list such as [image_transport/compressed]; got {disabled!r}')
        disabled = []
    return [name for name in TRANSPORTS if f'image_transport/{name}' not in disabled]


def _warn_of_transport_in(base_topic: str) -> None:
    parent, _, last = base_topic.rpartition('/')
    if last in TRANSPORTS:
        rospy.logwarn(f'{base_topic} looks like the topic of one transport. Subscribe to the image topic {parent} '
                      f'instead, with parameter ~image_transport set to {last} (_image_transport:={last})')
