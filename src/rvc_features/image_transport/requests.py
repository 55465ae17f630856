"""How requests to the node's services are read: one that can't be is refused, and costs a line of the log at most.

rospy lets the thread end in a traceback, of which there are then three, writes another for each client that has gone
before the answer, and keeps however much a client sends.
"""

from __future__ import annotations

import functools
import socket
import struct
from io import BytesIO
from typing import Any, Callable

import rospy
from rospy.exceptions import TransportException

from rvc_features.brief import reporter


def guard(service: Any, most_bytes: Callable[[], int]) -> None:
    """Have a service's requests read like that.

    Parameters
    ----------
    service : rospy.Service
    most_bytes : callable
        How many a request may have; asked for once.
    """
    if not isinstance(service.handle, functools.partial):
        service.protocol.read_messages = functools.partial(_read_request, service.protocol.recv_data_class,
                                                           most_bytes())
        service.error_handler = functools.partial(_failed, service.resolved_name)
        service.handle = functools.partial(_handle, service)


def _handle(service: Any, transport: Any, header: dict[str, str]) -> None:
    """In place of service.handle, in a thread for each connection."""
    try:
        if header.get('probe') == '1':
            return
        persistent = header.get('persistent', '').lower() in ('1', 'true')
        while True:
            for request in transport.receive_once():
                service._handle_request(transport, request)
            if not persistent:
                return
    except rospy.ServiceException as error:
        reporter().say(rospy.logwarn, 'requests', f'{service.resolved_name}: request refused: {error}')
        _answer(service, transport, str(error))
    except (TransportException, ConnectionError):
        return   # who asked has gone
    finally:
        transport.close()


def _answer(service: Any, transport: Any, problem: str) -> None:
    try:
        service._write_service_error(transport, problem)
    except (TransportException, ConnectionError):
        return   # who asked has gone


def _failed(name: str, error: Exception, *_: Any) -> None:
    """Called by rospy with what the service itself raised, or the sending of its answer."""
    if not isinstance(error, (TransportException, ConnectionError)):   # who asked has gone
        reporter().say(rospy.logerr, 'services', f'{name}: {type(error).__name__}: {error}')


def _read_request(message_class: type, most_bytes: int, begun: BytesIO, messages: list[Any],
                  connection: socket.socket) -> None:
    """What rospy calls when `begun` has at least four bytes: appends the request, if it is whole."""
    end = begun.tell()
    begun.seek(0)
    size, = struct.unpack('<I', begun.read(4))
    if size > most_bytes:
        raise rospy.ServiceException(f'{size} bytes, where {most_bytes} are the most')
    if end < 4 + size:
        begun.seek(end)
        return
    data, following = begun.read(size), begun.read(end - 4 - size)
    begun.seek(0)
    begun.truncate(0)
    begun.write(following)
    try:
        messages.append(message_class().deserialize(data))
    except Exception as error:   # whatever the bytes lead the generated code to
        raise rospy.ServiceException(f'{size} bytes that can not be deserialized: {error}') from None
