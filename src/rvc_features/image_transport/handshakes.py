"""How the node's port answers: one that says nothing, or rubbish, holds up nobody.

rospy reads what a new connection asks for in the thread that accepts connections, for as long as that takes, and
writes a traceback for each that asks for nothing there is. Here each is read in a thread of its own, with a limit in
time, and answered in turn.
"""

from __future__ import annotations

import contextlib
import errno
import socket
import struct
import threading
import time
from typing import Any, Callable

import rospy
import rospy.impl.tcpros_base
from rosgraph.network import decode_ros_handshake_header, write_ros_handshake_header
from rospy.impl.registration import get_service_manager, get_topic_manager

from rvc_features.brief import reporter, shown
from rvc_features.image_transport import requests

_SECONDS = 5.0         # that a connection has to say what it wants
_PAUSE = 0.5           # until descriptors are looked for again
_MOST_WAITING = 100    # connections that haven't yet; one more, and the oldest is closed
_MOST_BYTES = 1 << 16  # of a header; with it comes the definition of the message


class Handshakes:
    """What rospy's server hands each new connection to.

    Parameters
    ----------
    server : rospy.impl.tcpros_base.TCPROSServer
        Has the handlers for topics and services.
    most_bytes : callable
        How many a request to a service may have.
    """

    def __init__(self, server: Any, most_bytes: Callable[[], int]) -> None:
        self._server, self._most_bytes = server, most_bytes
        self._waiting: list[socket.socket] = []
        self._change = threading.Lock()
        self._turn = threading.Lock()   # rospy's handlers know only one thread
        self._refused = 0

    def __call__(self, connection: socket.socket, address: tuple) -> None:
        with self._change:
            self._waiting.append(connection)
            if len(self._waiting) > _MOST_WAITING:
                _shut(self._waiting.pop(0))
        try:
            threading.Thread(target=self._answer, args=(connection, address), name='handshake', daemon=True).start()
        except RuntimeError as error:   # no more threads; what is raised here ends the thread that accepts
            connection.close()
            self._report(address, str(error))

    def _answer(self, connection: socket.socket, address: tuple) -> None:
        ordinary = False
        try:
            header = _read_header(connection)
            with self._turn:
                ordinary = _is_withdrawn(header)
                problem = self._accept(connection, address, header)
            if problem:
                write_ros_handshake_header(connection, {'error': problem})
        except EOFError as error:   # who connects, and ends before it says anything, is no trouble
            problem, ordinary = str(error), True
        except Exception as error:   # whatever the other side, or what it sent, leads to
            problem = str(error) or type(error).__name__
        finally:
            with self._change:
                if connection in self._waiting:
                    self._waiting.remove(connection)
        if problem:
            connection.close()
            if not ordinary:
                self._report(address, problem)

    def _accept(self, connection: socket.socket, address: tuple, header: dict[str, str]) -> str | None:
        """rospy's answer: nothing, or why not."""
        if 'topic' in header:
            return self._server.topic_connection_handler(connection, address, header)
        if 'service' in header:
            service = get_service_manager().get_service(header['service'])
            if service is not None:
                requests.guard(service, self._most_bytes)
            return self._server.service_connection_handler(connection, address, header)
        return 'no topic or service name detected'

    def _report(self, address: tuple, problem: str) -> None:
        if rospy.core.is_shutdown_requested():
            return
        self._refused += 1
        reporter().say(rospy.logwarn, 'handshakes',
                       f'connection from {address[0]} refused, {self._refused} so far: {shown(problem)}')


def limit_handshakes(most_bytes: Callable[[], int]) -> None:
    """Have this process's port answered like that; the node must be initialised.

    Parameters
    ----------
    most_bytes : callable
        How many a request to a service may have.
    """
    rospy.impl.tcpros_base.start_tcpros_server()   # does nothing where it runs
    server = rospy.impl.tcpros_base._tcpros_server
    if not isinstance(server.tcp_ros_server.inbound_handler, Handshakes):
        server.tcp_ros_server.inbound_handler = Handshakes(server, most_bytes)
        server.tcp_ros_server.server_sock.listen(_MOST_WAITING)   # rospy lets 5 wait; one more is put off by a second
        server.tcp_ros_server.server_sock = _Door(server.tcp_ros_server.server_sock)
        address = rospy.impl.tcpros_base.get_tcpros_server_address()
        with contextlib.suppress(OSError), socket.create_connection(address, _SECONDS):
            pass   # so that who waits at the old door goes to the new one


class _Door:
    """The socket that connections are accepted from; without descriptors it waits for some, where rospy gives up."""

    def __init__(self, listening: socket.socket) -> None:
        self._listening = listening

    def accept(self) -> tuple[socket.socket, Any]:
        while True:
            try:
                return self._listening.accept()
            except OSError as error:
                if error.errno not in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM):
                    raise
                reporter().say(rospy.logerr, 'descriptors', f'no connection can be accepted: {error.strerror}')
                time.sleep(_PAUSE)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._listening, name)


def _read_header(connection: socket.socket) -> dict[str, str]:
    """What the other side wants; TimeoutError, EOFError or ValueError where it doesn't say."""
    deadline = time.monotonic() + _SECONDS
    start = _read(connection, 4, deadline)
    size, = struct.unpack('<I', start)
    if size > _MOST_BYTES:
        raise ValueError(f'header of {size} bytes')
    header = decode_ros_handshake_header(start + _read(connection, size, deadline))
    connection.settimeout(None)
    return header


def _read(connection: socket.socket, size: int, deadline: float) -> bytes:
    data = b''
    while len(data) < size:
        connection.settimeout(max(deadline - time.monotonic(), 0.001))
        portion = connection.recv(size - len(data))
        if not portion:
            raise EOFError('closed before it said what it wants')
        data += portion
    return data


def _is_withdrawn(header: dict[str, str]) -> bool:
    """Whether a topic or service is asked for that isn't there: most likely it was, a moment ago."""
    if 'topic' in header:
        topic = get_topic_manager().get_publisher_impl(header['topic'])
        return topic is None or topic.closed
    return 'service' in header and get_service_manager().get_service(header['service']) is None


def _shut(connection: socket.socket) -> None:
    """Wake whoever reads from it."""
    with contextlib.suppress(OSError):   # closed by the other side already
        connection.shutdown(socket.SHUT_RDWR)
