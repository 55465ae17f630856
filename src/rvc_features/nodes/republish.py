"""Carry images from one transport into another, as `image_transport republish` does, with `compressed` at hand.

    rosrun rvc_features republish IN_TRANSPORT in:=TOPIC [OUT_TRANSPORT] out:=TOPIC

A camera driver without image_transport becomes fit for a network that way:

    rosrun rvc_features republish raw in:=/camera/image_raw compressed out:=/camera/image

Without OUT_TRANSPORT all of them are offered. The parameter ~image_transport wins over IN_TRANSPORT, as in C++. `in` is
subscribed to only while somebody listens to `out`. On /diagnostics comes once a second what feature_detector has there,
too: what is wrong, images received, sent on, dropped and refused.
"""

from __future__ import annotations

import argparse
import threading
import time
from typing import Any, Callable

import rospy
import sensor_msgs.msg

from rvc_features.brief import shown
from rvc_features.heap import FrameHeap
from rvc_features.image_transport import TRANSPORTS, ImageError, ImageTransport, Subscriber, TransportHints
from rvc_features.nodes.lazy_input import LazyInput
from rvc_features.nodes.newest_worker import NewestWorker
from rvc_features.nodes.spin import spin
from rvc_features.nodes.supervision import Supervision

BAD_ARGUMENT = 2   # exit status


class Republisher:
    """Between the topics `in` and `out`."""

    def __init__(self, in_transport: str, out_transport: str | None = None) -> None:
        self._decode: Callable[[Any], sensor_msgs.msg.Image]
        self._hints, self._subscribed = TransportHints(in_transport), threading.Lock()
        self.heap = FrameHeap()
        self.worker = NewestWorker(lambda item: self.process(*item), lambda error: self.supervision.frame_failed(error),
                                   'republish')
        self.input = LazyInput(self._subscribe, lambda: self.publisher.get_num_subscribers())
        self.supervision = Supervision('republished images', lambda: 'republish', self.worker, self.input, 'out',
                                       house_work=self.heap.tidy)
        self.supervision.transport = self._hints.get_transport()
        changed = self.input.changed.set
        self.publisher = ImageTransport().advertise(
            'out', subscriber_connected=changed, subscriber_disconnected=changed,
            transports=None if out_transport is None else [out_transport])
        self.supervision.start()
        self.supervision.started()

    def image_message_callback(self, message: Any) -> None:
        """Called for each image: only keeps it, for the worker to take the newest."""
        self.worker.put((message, self.supervision.frame_arrived(message)))

    def process(self, message: Any, arrived: float) -> None:
        """One image from transport to transport, in the worker's thread; a bad one is reported and skipped."""
        start = time.monotonic()
        self.heap.note(len(message.data))
        with self._subscribed:   # the first image may come before it is known who can decode it
            decode = self._decode
        unsent = self.publisher.errors
        try:
            image = decode(message)
            self.publisher.publish(image)
            if self.publisher.errors > unsent:
                raise ImageError(self.publisher.last_error)
        except ImageError as error:
            self.supervision.frame_refused(error)
        else:
            self.supervision.frame_processed((image.height, image.width), start, arrived)

    def _subscribe(self) -> Subscriber:
        self.supervision.statistics.waiting()
        with self._subscribed:
            subscriber = ImageTransport().subscribe('in', self.image_message_callback, transport_hints=self._hints,
                                                    decode=False)
            self._decode = subscriber.decode
        return subscriber


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
    Republisher(in_transport, out_transport)
    return 0
