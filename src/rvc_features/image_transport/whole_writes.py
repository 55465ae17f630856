"""How messages are written to sockets: by the thread that publishes, from where they lie, and without waiting.

rospy copies a message into a buffer that grows, and has a thread for each subscriber that wakes up to send it. Here the
socket takes the message's pieces at once, in the thread that publishes. What it has no room for, because it is much or
because a subscriber reads slowly or not at all, is left to a thread, as rospy leaves everything to one: nobody waits
for a subscriber.
"""

from __future__ import annotations

import functools
import logging
import socket
import struct
import threading
from io import BytesIO
from typing import Any, Callable, Iterable, Union

import rospy
from rospy.exceptions import TransportTerminated

Piece = Union[bytes, memoryview]

_DONT_WAIT = getattr(socket, 'MSG_DONTWAIT', 0)
_LENGTH = struct.Struct('<I')
HEADER = struct.Struct('<4I')   # of a message, as it travels: seq, stamp, length of the frame_id


class TopicPublisher(rospy.Publisher):
    """A rospy.Publisher like that.

    Parameters
    ----------
    name : str
        Of the topic.
    message_class : type
        Its messages may have a member function `pieces`: the bytes of the message, one after the other. What of them
        is read-only must never change; the rest may, once `publish` has returned.
    listener : rospy.SubscribeListener
    queue_size : int
        How many messages may wait for a slow subscriber before the oldest is dropped; 0 for any number.
    options
        Others of rospy.Publisher.
    """

    def __init__(self, name: str, message_class: type, listener: rospy.SubscribeListener, queue_size: int = 1,
                 **options: Any) -> None:
        super().__init__(name, message_class, listener, tcp_nodelay=True, queue_size=queue_size, **options)
        write_at_once(self.impl, queue_size)

    def publish(self, message: Any) -> None:
        """Send a message to whoever listens; returns at once, whatever they do."""
        implementation = self.impl
        lock = None if implementation is None else implementation.publock
        if lock is None:   # unregistered, or closed because the node ends
            return
        with lock:
            if not implementation.connections:
                return
            implementation.seq += 1
            if message._has_header:
                message.header.seq = implementation.seq
            pieces = framed(message)
            for connection in implementation.connections:
                try:
                    if isinstance(connection, _Connection):
                        connection.write(pieces)
                    else:   # rospy's own, from before this publisher was through with its constructor
                        connection.write_data(b''.join(pieces))
                except (OSError, TransportTerminated) as error:
                    logging.getLogger('rospy.tcpros').debug('%s: connection closed: %s', self.resolved_name, error)
                    connection.close()
            implementation.message_data_sent += _size(pieces)

    def get_num_connections(self) -> int:
        """How many subscribers there are."""
        return num_connections(self)


def num_connections(topic: rospy.topics.Topic) -> int:
    """As rospy's get_num_connections, without its lock, which rospy also holds while it announces that one has left."""
    implementation = topic.impl   # None after unregister
    return 0 if implementation is None else len(implementation.connections)


def framed(message: Any) -> list[Piece]:
    """A message as it travels: its length, and its pieces."""
    if hasattr(message, 'pieces'):
        pieces = message.pieces()
    else:
        buffer = BytesIO()
        message.serialize(buffer)
        pieces = [buffer.getvalue()]
    return [_LENGTH.pack(_size(pieces)), *pieces]


def header_bytes(header: Any) -> bytes:
    """A std_msgs/Header as it travels."""
    stamp, frame_id = header.stamp, (header.frame_id or '').encode()
    return HEADER.pack(header.seq, stamp.secs, stamp.nsecs, len(frame_id)) + frame_id


def write_at_once(implementation: Any, queue_size: int) -> None:
    """Have all connections to come of rospy's implementation of a publisher write like that."""
    add_connection = implementation.add_connection
    if not isinstance(add_connection, functools.partial):   # as it is where the node has another publisher of the topic
        # Before the next line, so that no connection is left without a queue.
        implementation.add_connection = functools.partial(_wrap_and_add, add_connection, queue_size)
    implementation.set_queue_size(None)   # or rospy wraps them, too


def _wrap_and_add(add_connection: Callable[[Any], Any], queue_size: int, connection: Any) -> Any:
    return add_connection(_Connection(connection, queue_size))


class _Connection:
    """Takes the place of rospy's queue before the connection to one subscriber."""

    def __init__(self, connection: Any, queue_size: int) -> None:
        self._connection, self._queue_size = connection, queue_size
        self._changed = threading.Condition(threading.Lock())
        self._thread: threading.Thread | None = None   # most subscribers never need one
        self._begun: list[Piece] = []                  # what is left of a message
        self._waiting: list[list[Piece]] = []          # whole messages
        self._is_behind = False                        # the thread has something to send
        self._error: Exception | None = None           # that the thread has met
        connection.set_cleanup_callback(self._closed)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)

    def write_data(self, data: bytes) -> bool:
        """What rospy calls to send to one subscriber."""
        self.write([data])
        return True

    def write(self, pieces: list[Piece]) -> None:
        """Send a message, or leave what can't be sent at once to the thread; OSError where the connection is broken."""
        with self._changed:
            if self._error is not None:
                raise self._error
            if self._is_behind:
                if self._queue_size > 0 and len(self._waiting) >= self._queue_size:
                    del self._waiting[0]
                self._waiting.append(_lasting(pieces))
                return
            left = self._sent_at_once(pieces)
            if left:
                self._begun, self._is_behind = _lasting(left), True
                self._wake_thread()

    def _sent_at_once(self, pieces: list[Piece]) -> list[Piece]:
        """Send what the socket takes without waiting; what is left."""
        connection = self._connection
        if connection.socket is None:
            raise TransportTerminated('connection closed')
        try:
            sent = connection.socket.sendmsg(pieces, (), _DONT_WAIT)
        except BlockingIOError:
            sent = 0
        connection.stat_bytes += sent
        if sent == _size(pieces):
            connection.stat_num_msg += 1
            return []
        left = list(pieces)
        while sent >= len(left[0]):
            sent -= len(left.pop(0))
        left[0] = memoryview(left[0])[sent:]
        return left

    def _wake_thread(self) -> None:
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name='slow subscriber', daemon=True)
            self._thread.start()
        else:
            self._changed.notify()

    def _closed(self, connection: Any) -> None:
        with self._changed:
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                while not (self._begun or self._waiting or self._connection.done):
                    self._is_behind = False
                    self._changed.wait()
                if self._connection.done:
                    return
                pieces, self._begun = self._begun or self._waiting.pop(0), []
            try:
                for piece in pieces:
                    self._connection.socket.sendall(piece)
                    self._connection.stat_bytes += len(piece)
                self._connection.stat_num_msg += 1
            except Exception as error:   # broken, or closed meanwhile and without a socket
                with self._changed:
                    self._error = TransportTerminated(str(error))
                return


def _lasting(pieces: list[Piece]) -> list[Piece]:
    """Pieces that stay as they are, whatever their owner does with his memory."""
    return [piece if isinstance(piece, bytes) or piece.readonly else bytes(piece) for piece in pieces]


def _size(pieces: Iterable[Piece]) -> int:
    return sum(map(len, pieces))
