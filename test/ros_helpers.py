"""What the rostests share: images to send, and waiting for what comes back, without sleeps."""

import threading

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image

from rvc_features.image_transport.messages import to_image_message

SECONDS = 20.0   # far more than anything here takes


class Inbox:
    """The messages of a topic, and a way to wait for one."""

    def __init__(self, topic, message_class):
        self.messages = []
        self._changed = threading.Condition()
        self.subscriber = rospy.Subscriber(topic, message_class, self._add, queue_size=1000)

    def _add(self, message):
        with self._changed:
            self.messages.append(message)
            self._changed.notify_all()

    def wait_for(self, wanted, what='a message'):
        """The first message, past or future, for which `wanted` is true."""
        found = []

        def look():
            found[:] = [message for message in self.messages if wanted(message)]
            return found

        with self._changed:
            assert self._changed.wait_for(look, SECONDS), f'{what}: none of {len(self.messages)} messages is it'
        return found[0]

    def wait_a_moment(self):
        """Until there is a message, but not long."""
        with self._changed:
            self._changed.wait_for(lambda: self.messages, 0.2)

    def close(self):
        self.subscriber.unregister()


def exchange_until(camera, image, inboxes):
    """Send an image until every inbox has got something: topics connect when they connect."""
    deadline = rospy.get_time() + SECONDS
    while not all(inbox.messages for inbox in inboxes):
        assert rospy.get_time() < deadline, 'no answer'
        camera.send(image)
        for inbox in inboxes:
            inbox.wait_a_moment()
    for inbox in inboxes:
        inbox.messages.clear()


class Camera:
    """Publishes images, each with a stamp of its own, once somebody listens."""

    def __init__(self, topic):
        self._connected = threading.Event()
        self.publisher = rospy.Publisher(topic, Image, _Listener(self._connected), queue_size=100)
        self.count = 0

    def wait_for_listener(self):
        assert self._connected.wait(SECONDS), 'nobody listens to the camera'

    def send(self, image, as_encoding=None, **changes):
        """Publish an array as an image message with `changes` to its fields; returns the stamp."""
        self.wait_for_listener()
        self.count += 1
        message = to_image_message(image, as_encoding or ('mono8' if image.ndim == 2 else 'bgr8'))
        message.header.stamp = rospy.Time(1000 + self.count)
        message.header.frame_id = 'camera_optical'
        for name, value in changes.items():
            setattr(message, name, value)
        self.publisher.publish(message)
        return message.header.stamp


class _Listener(rospy.SubscribeListener):
    def __init__(self, connected):
        super().__init__()
        self._connected = connected

    def peer_subscribe(self, topic_name, topic_publish, peer_publish):
        self._connected.set()

    def peer_unsubscribe(self, topic_name, num_peers):
        if num_peers == 0:
            self._connected.clear()


class Diagnostics(Inbox):
    """The status of one node."""

    def __init__(self, node):
        super().__init__('/diagnostics', DiagnosticArray)
        self.node = node

    def wait_for_values(self, wanted, what):
        """The values, as a dict of texts, of the first status for which `wanted(values)` is true."""
        message = self.wait_for(lambda message: self._values(message) and wanted(self._values(message)), what)
        return self._values(message)

    def _values(self, message):
        for status in message.status:
            if status.name.startswith(self.node):
                return {**{pair.key: pair.value for pair in status.values},
                        'level': status.level, 'message': status.message}
        return {}


def square(size=160, low=60, high=99, value=200):
    """A bright square on black; its corners are the pixels (low, low) ... (high, high)."""
    image = np.zeros((size, size), np.uint8)
    image[low:high + 1, low:high + 1] = value
    return image


def texture(shape=(240, 320), seed=0):
    """Random grey blocks of eight pixels: corners of all strengths."""
    blocks = np.random.default_rng(seed).integers(0, 256, (shape[0] // 8, shape[1] // 8), np.uint8)
    return np.kron(blocks, np.ones((8, 8), np.uint8))
