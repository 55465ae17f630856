"""The way in: `ImageTransport` advertises and subscribes, `TransportHints` says by which transport."""

from __future__ import annotations

import dataclasses
from typing import Any, Callable, Iterable

import rosgraph.names
import rospy

from rvc_features.brief import shown
from rvc_features.image_transport import transports as known
from rvc_features.image_transport.attempts import limit_attempts
from rvc_features.image_transport.handshakes import limit_handshakes
from rvc_features.image_transport.publisher import Publisher
from rvc_features.image_transport.remote_calls import limit_remote_calls
from rvc_features.image_transport.subscriber import Subscriber
from rvc_features.image_transport.transports import TRANSPORTS
from rvc_features.image_transport.whole_reads import most_message_bytes
from rvc_features.still_images import MEGAPIXELS

_MOST_MEGAPIXELS = 10_000.0


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
    """Advertises and subscribes to image topics; the node must be initialised.

    From the first on, the node's port gives no connection more than five seconds to say what it wants.
    """

    def __init__(self) -> None:
        limit_attempts()
        limit_remote_calls()
        limit_handshakes(lambda: most_message_bytes(most_megapixels()))

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
        return Publisher(base_topic, [known.create(name) for name in names], queue_size, latch, subscriber_connected,
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
            the caller's finds the newest; `messages.to_array` decodes it there.

        Raises
        ------
        ValueError
            When the transport is unknown.
        """
        hints = transport_hints or TransportHints()
        if isinstance(hints, str):
            hints = TransportHints(hints)
        transport = known.create(hints.get_transport())
        transport.start_subscribing(rosgraph.names.ns_join(hints.parameter_namespace, transport.name))
        return Subscriber(rospy.resolve_name(base_topic), callback, queue_size, transport, hints.tcp_nodelay, decode,
                          most_megapixels())

    def get_declared_transports(self) -> list[str]:
        """Names of all transports."""
        return sorted(TRANSPORTS)


def most_megapixels() -> float:
    """What ~most_megapixels says, as a limit for the images that are read; a warning where it makes no sense."""
    asked = rospy.get_param('~most_megapixels', MEGAPIXELS)
    if isinstance(asked, (int, float)) and not isinstance(asked, bool) and 0 < asked <= _MOST_MEGAPIXELS:
        return float(asked)
    rospy.logwarn(f'~most_megapixels must be a number above 0 and up to {_MOST_MEGAPIXELS:g}; got {shown(asked)}, '
                  f'{MEGAPIXELS:g} is used')
    return MEGAPIXELS


def known_transport(reject: Callable[[str], None] = rospy.logwarn) -> TransportHints:
    """What ~image_transport says; where there is no such transport, raw, and a sentence to `reject`."""
    asked = str(TransportHints().get_transport())
    if asked not in TRANSPORTS:
        reject(f"~image_transport must be one of {', '.join(sorted(TRANSPORTS))}; got {shown(asked)}, 'raw' is used")
        asked = 'raw'
    return TransportHints(asked, parameter_name='image_transport_in_use')


def _enabled_transports(base_topic: str) -> list[str]:
    """All but those that <base_topic>/disable_pub_plugins lists, by names like image_transport/compressed."""
    parameter = f'{base_topic}/disable_pub_plugins'
    disabled = rospy.get_param(parameter, [])
    if not isinstance(disabled, list):
        rospy.logwarn(f'{parameter} must be a list such as [image_transport/compressed]; got {shown(disabled)}')
        disabled = []
    return [name for name in TRANSPORTS if f'image_transport/{name}' not in disabled]
