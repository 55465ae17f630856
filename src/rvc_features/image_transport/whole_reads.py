"""How image messages are read from the socket: large ones whole, too large ones not at all, damaged ones as such.

rospy reads in portions, joins them in a buffer that grows, and copies the message out of it: three copies, and a turn
of Python's lock for each portion. Here it is one copy and one turn, by the hook that rospy's connections have for how
messages are read. A size that is larger than any image is passed over without being stored; a message that can't be
deserialized, for which rospy would write a traceback and drop the connection, arrives with its `problem`.
"""

from __future__ import annotations

import functools
import logging
import socket
import struct
from io import BytesIO
from typing import Any, Callable

import numpy as np
import rospy
from rospy.exceptions import TransportTerminated

from rvc_features.brief import reporter
from rvc_features.still_images import most_bytes

FIRST_READ = 4096      # bytes, for rospy.Subscriber's buff_size: enough to learn how much there is to come
_LENGTH = struct.Struct('<I')
_PORTION = 1 << 16     # bytes of a message that is passed over
_ROOM = 1 << 16        # bytes beside the pixels


@functools.lru_cache(maxsize=64)
def received(message_class: type, limit: float) -> type:
    """The class that a subscription to `message_class` gets: what can't be deserialized or is too large is told.

    Attributes
    ----------
    problem : str
        Why this is no image; empty otherwise.
    megapixels : float
        How large an image may be.
    most_bytes : int
        How large a message may be.
    """
    class Received(message_class):   # type: ignore[valid-type,misc]
        problem = ''
        megapixels = limit
        most_bytes = most_message_bytes(limit)

        def deserialize(self, data: Any) -> Any:
            try:
                return super().deserialize(data)
            except Exception as error:   # whatever the bytes lead the generated code to
                unreadable = type(self)()
                unreadable.problem = f'message of {len(data)} bytes that can not be deserialized: {error}'
                return unreadable

    Received.__name__ = message_class.__name__
    return Received


def subscribe(topic: str, message_class: type, callback: Callable[[Any], Any], megapixels: float,
              **options: Any) -> rospy.Subscriber:
    """A rospy.Subscriber like that, of any kind of message: a bad one is reported, and does not end the connection."""
    def take(message: Any) -> None:
        if message.problem:
            reporter().say(rospy.logwarn, f'reading {topic}', f'{rospy.resolve_name(topic)}: {message.problem}')
        else:
            callback(message)

    subscriber = rospy.Subscriber(topic, received(message_class, megapixels), take, **options)
    read_messages(subscriber, whole=False)
    return subscriber


def read_messages(subscriber: rospy.Subscriber, whole: bool) -> None:
    """Have all connections of a subscriber read like that, those there are and those to come.

    Parameters
    ----------
    subscriber : rospy.Subscriber
        Of a class made by `received`.
    whole : bool
        Whether messages are read straight into the memory that they stay in. Their class must deserialize any buffer,
        and may keep it. The callback should only put the message where another thread takes the newest: behind a slow
        one old messages wait in the socket, whatever queue_size says.
    """
    implementation = subscriber.impl
    add_connection = implementation.add_connection

    def convert_and_add(connection: Any) -> Any:
        _convert(connection, whole)
        return add_connection(connection)

    implementation.add_connection = convert_and_add   # before the next line, so that none slips through
    for connection in implementation.connections:
        _convert(connection, whole)


def most_message_bytes(megapixels: float) -> int:
    """What a message may have if images may be that large."""
    return most_bytes(megapixels) + _ROOM


def _convert(connection: Any, whole: bool) -> None:
    protocol: Any = getattr(connection, 'protocol', None)
    if not hasattr(protocol, 'read_messages') or not hasattr(connection, 'receive_once'):
        logging.getLogger('rvc_features').warning('%s has no hook for reading: rospy reads in portions', connection)
    elif not isinstance(protocol.read_messages, functools.partial):
        protocol.read_messages = functools.partial(_read_messages, connection, protocol.read_messages, whole)
        connection.receive_once = _forgetting(connection.receive_once)


def _forgetting(receive_once: Callable[[], list[Any]]) -> Callable[[], list[Any]]:
    """rospy's receive_once, without its keeping the last messages for as long as no other comes."""
    messages: list[Any] = []

    def receive() -> list[Any]:
        nonlocal messages
        messages.clear()   # the list in the hands of rospy, which is through with it
        messages = receive_once()
        return messages

    return receive


def _read_messages(connection: Any, read_in_portions: Callable[..., None], whole: bool, begun: BytesIO,
                   messages: list[Any], sock: socket.socket) -> None:
    """What rospy calls when `begun` has at least four bytes: appends the next message, and waits for the rest of it."""
    message_class = connection.protocol.recv_data_class
    end = begun.tell()
    have = begun.getvalue()
    size, = _LENGTH.unpack_from(have)
    if size > message_class.most_bytes:
        message = message_class()
        message.problem = (f'message of {size} bytes passed over unread: more than {message_class.megapixels:g} '
                           'megapixels (parameter ~most_megapixels)')
        _pass_over(connection, begun, end, size, sock)
        messages.append(message)
    elif not whole or end >= 4 + size:
        read_in_portions(begun, messages, sock)
    else:
        data = np.empty(size, np.uint8).data
        done = end - 4
        data[:done] = have[4:end]
        begun.seek(0)
        begun.truncate(0)
        while done < size:
            count = sock.recv_into(data[done:], 0, socket.MSG_WAITALL)
            _count(connection, count)
            done += count
        messages.append(message_class().deserialize(data))


def _pass_over(connection: Any, begun: BytesIO, end: int, size: int, sock: socket.socket) -> None:
    """Read as many bytes as the message has, and keep what follows it."""
    begun.seek(min(end, 4 + size))
    following = begun.read(end - begun.tell())
    left = size - (end - 4)
    portion = memoryview(bytearray(_PORTION))
    while left > 0:
        count = sock.recv_into(portion[:min(left, _PORTION)])
        _count(connection, count)
        left -= count
    begun.seek(0)
    begun.truncate(0)
    begun.write(following)


def _count(connection: Any, received_bytes: int) -> None:
    if received_bytes == 0:
        raise TransportTerminated('the publisher has closed the connection')
    connection.stat_bytes += received_bytes
