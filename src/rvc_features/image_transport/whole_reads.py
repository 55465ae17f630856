"""Large messages read from the socket straight into the memory they stay in.

rospy reads in portions, joins them in a buffer that grows, and copies the message out of it: three copies, and a turn
of Python's lock for each portion. Here it is one copy and one turn, by the hook that rospy's connections have for how
messages are read.
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

FIRST_READ = 4096    # bytes, for rospy.Subscriber's buff_size: enough to learn how much there is to come
_LARGEST = 1 << 28   # bytes; a message that claims more is left to rospy, which allocates only for what has come


def read_whole_messages(subscriber: rospy.Subscriber) -> None:
    """Have all connections of a subscriber read like that, those there are and those to come.

    The message class must deserialize any buffer, and may keep it. The callback should only put the message where
    another thread takes the newest: behind a slow one old messages wait in the socket, whatever queue_size says.
    """
    implementation = subscriber.impl
    add_connection = implementation.add_connection

    def convert_and_add(connection: Any) -> Any:
        _convert(connection)
        return add_connection(connection)

    implementation.add_connection = convert_and_add   # before the next line, so that none slips through
    for connection in implementation.connections:
        _convert(connection)


def _convert(connection: Any) -> None:
    protocol: Any = getattr(connection, 'protocol', None)
    if not hasattr(protocol, 'read_messages'):
        logging.getLogger('rvc_features').warning('%s has no hook for reading: rospy reads in portions', connection)
    elif not isinstance(protocol.read_messages, functools.partial):
        protocol.read_messages = functools.partial(_read_messages, connection, protocol.read_messages)


def _read_messages(connection: Any, read_in_portions: Callable[..., None], begun: BytesIO, messages: list[Any],
                   sock: socket.socket) -> None:
    """What rospy calls when `begun` has at least four bytes: appends the next message, and waits for the rest of it."""
    end = begun.tell()
    begun.seek(0)
    size, = struct.unpack('<I', begun.read(4))
    if end >= 4 + size or size > _LARGEST:
        begun.seek(end)
        read_in_portions(begun, messages, sock)
        return
    data = np.empty(size, np.uint8).data
    done = begun.readinto(data[:end - 4])
    begun.seek(0)
    begun.truncate(0)
    while done < size:
        count = sock.recv_into(data[done:], 0, socket.MSG_WAITALL)
        if count == 0:
            raise TransportTerminated('the publisher has closed the connection')
        done += count
        connection.stat_bytes += count
    messages.append(connection.protocol.recv_data_class().deserialize(data))
