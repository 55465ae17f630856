"""Carry images from one transport into another, as `image_transport republish` does, with `compressed` at hand.

    rosrun rvc_features republish IN_TRANSPORT in:=TOPIC [OUT_TRANSPORT] out:=TOPIC

A camera driver without image_transport becomes fit for a network that way:

    rosrun rvc_features republish raw in:=/camera/image_raw compressed out:=/camera/image

Without OUT_TRANSPORT all of them are offered. `in` is subscribed to only while somebody listens to `out`.
"""

from __future__ import annotations

import argparse
import threading

import rospy

from rvc_features.image_transport import TRANSPORTS, ImageTransport, Subscriber, TransportHints

_PATIENCE = 1.0   # seconds until the node notices that it has been told to end


class Republisher:
    """Between the topics `in` and `out`."""

    def __init__(self, in_transport: str, out_transport: str | None = None) -> None:
        self._transport = ImageTransport()
        self._hints = TransportHints(in_transport)
        self._listeners_changed = threading.Event()
        changed = self._listeners_changed.set
        self.subscriber: Subscriber | None = None
        self.publisher = self._transport.advertise(
            'out', subscriber_connected=changed, subscriber_disconnected=changed,
            transports=None if out_transport is None else [out_transport])

    def run(self) -> None:
        """Subscribe while somebody listens; returns when the node is told to end."""
        while not rospy.is_shutdown():
            wanted = self.publisher.get_num_subscribers() > 0
            if wanted and self.subscriber is None:
                self.subscriber = self._transport.subscribe('in', self.publisher.publish, transport_hints=self._hints)
            elif not wanted and self.subscriber is not None:
                self.subscriber.shutdown()
                self.subscriber = None
            self._listeners_changed.wait(_PATIENCE)
            self._listeners_changed.clear()


def main() -> None:
    """Run the node until it is told to end."""
    parser = argparse.ArgumentParser(prog='republish', description=__doc__.partition('\n')[0])
    parser.add_argument('in_transport', choices=sorted(TRANSPORTS))
    parser.add_argument('out_transport', choices=sorted(TRANSPORTS), nargs='?')
    arguments = parser.parse_args(rospy.myargv()[1:])
    rospy.init_node('republish', anonymous=True)
    Republisher(arguments.in_transport, arguments.out_transport).run()
