"""Carry images from one transport into another, as `image_transport republish` does, with `compressed` at hand.

    rosrun rvc_features republish IN_TRANSPORT in:=TOPIC [OUT_TRANSPORT] out:=TOPIC

A camera driver without image_transport becomes fit for a network that way:

    rosrun rvc_features republish raw in:=/camera/image_raw compressed out:=/camera/image

Without OUT_TRANSPORT all of them are offered. The parameter ~image_transport wins over IN_TRANSPORT, as in C++. `in` is
subscribed to only while somebody listens to `out`.
"""

from __future__ import annotations

import argparse

import rospy

from rvc_features.brief import shown
from rvc_features.image_transport import TRANSPORTS, ImageTransport, TransportHints
from rvc_features.nodes.lazy_input import LazyInput
from rvc_features.nodes.spin import spin

BAD_ARGUMENT = 2   # exit status
_PATIENCE = 1.0   # seconds until the node notices that it has been told to end


class Republisher:
    """Between the topics `in` and `out`."""

    def __init__(self, in_transport: str, out_transport: str | None = None) -> None:
        transport, hints = ImageTransport(), TransportHints(in_transport)
        self.input = LazyInput(lambda: transport.subscribe('in', self.publisher.publish, transport_hints=hints),
                               lambda: self.publisher.get_num_subscribers())
        changed = self.input.changed.set
        self.publisher = transport.advertise(
            'out', subscriber_connected=changed, subscriber_disconnected=changed,
            transports=None if out_transport is None else [out_transport])

    def run(self) -> None:
        """Subscribe while somebody listens; returns when the node is told to end."""
        while not rospy.is_shutdown():
            self.input.update()
            self.input.wait(_PATIENCE)


def main() -> int:
    """Run the node until it is told to end; the exit status."""
    parser = argparse.ArgumentParser(prog='republish', description=__doc__.partition('\n')[0])
    parser.add_argument('in_transport', choices=sorted(TRANSPORTS))
    parser.add_argument('out_transport', choices=sorted(TRANSPORTS), nargs='?')
    arguments = parser.parse_args(rospy.myargv()[1:])
    return spin('republish', lambda: _run(arguments.in_transport, arguments.out_transport), anonymous=True)


def _run(in_transport: str, out_transport: str | None) -> int:
    asked = TransportHints(in_transport).get_transport()
    if asked not in sorted(TRANSPORTS):
        rospy.logfatal(f'~image_transport must be one of {", ".join(sorted(TRANSPORTS))}; got {shown(asked)}')
        return BAD_ARGUMENT
    Republisher(in_transport, out_transport).run()
    return 0
