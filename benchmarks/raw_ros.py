"""A ROS peer on bare sockets: sends prepared images and reads answers, at next to no cost of its own.

A client library's own (de)serialisation would take as long as the nodes that are to be timed.
"""

from __future__ import annotations

import socket
import struct
import threading
import xmlrpc.client
from io import BytesIO
from types import TracebackType
from typing import Any
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import genpy
from sensor_msgs.msg import Image

_SECONDS = 20.0   # to wait for anything at the most


class ImagePeer:
    """Publishes on one image topic and subscribes to another.

    Parameters
    ----------
    master_uri : str
    name : str
        Of this peer in the ROS graph, with a leading slash.
    topic_in, topic_out : str
        Where the node under test takes its images from, and where it publishes its own.
    answer : message type
        Of what it publishes there.
    """

    def __init__(self, master_uri: str, name: str, topic_in: str, topic_out: str, answer: Any = Image) -> None:
        self._answer = answer
        self._master, self._name = xmlrpc.client.ServerProxy(master_uri), name
        self._topic_in, self._topic_out = topic_in, topic_out
        self._listener = socket.create_server(('localhost', 0))
        self._slave = SimpleXMLRPCServer(('localhost', 0), SimpleXMLRPCRequestHandler, logRequests=False)
        self._slave.register_function(self._request_topic, 'requestTopic')
        self._slave.register_function(self._publisher_update, 'publisherUpdate')
        self._uri = f'http://localhost:{self._slave.server_address[1]}/'
        self._publishers: list[str] = []
        self._announced = threading.Event()
        self._buffer = bytearray(0)

    def __enter__(self) -> ImagePeer:
        threading.Thread(target=self._slave.serve_forever, daemon=True).start()
        publishers = self._master.registerSubscriber(self._name, self._topic_out, self._answer._type, self._uri)[2]
        if publishers:
            self._publisher_update('', '', publishers)
        if not self._announced.wait(_SECONDS):
            raise TimeoutError(f'nobody publishes {self._topic_out}')
        self._answers = self._subscribe(self._publishers[0])
        # Only now, as some nodes subscribe to their input only when somebody listens to their output.
        self._master.registerPublisher(self._name, self._topic_in, Image._type, self._uri)
        self._listener.settimeout(_SECONDS)
        self._images, _ = self._listener.accept()
        self._images.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._greet(self._images)
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._master.unregisterPublisher(self._name, self._topic_in, self._uri)
        self._master.unregisterSubscriber(self._name, self._topic_out, self._uri)
        self._slave.shutdown()
        self._slave.server_close()
        for connection in (self._images, self._answers, self._listener):
            connection.close()

    def round_trip(self, packet: bytes) -> memoryview:
        """Send a packet made by `packed` and wait for the next answer; its bytes are valid until the next call."""
        self._images.sendall(packet)
        return self._receive(self._answers)

    def _receive(self, connection: socket.socket) -> memoryview:
        length, = struct.unpack('<I', _read(connection, memoryview(bytearray(4))))
        if len(self._buffer) < length:
            self._buffer = bytearray(length)
        return _read(connection, memoryview(self._buffer)[:length])

    def _request_topic(self, caller: str, topic: str, protocols: list) -> list:
        return [1, '', ['TCPROS', 'localhost', self._listener.getsockname()[1]]]

    def _publisher_update(self, caller: str, topic: str, publishers: list[str]) -> list:
        if publishers:
            self._publishers = publishers
            self._announced.set()
        return [1, '', 0]

    def _subscribe(self, publisher: str) -> socket.socket:
        slave = xmlrpc.client.ServerProxy(publisher)
        _, _, (_, host, port) = slave.requestTopic(self._name, self._topic_out, [['TCPROS']])
        connection = socket.create_connection((host, port), _SECONDS)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.sendall(_header(callerid=self._name, topic=self._topic_out, type=self._answer._type,
                                   md5sum=self._answer._md5sum, tcp_nodelay='1'))
        self._receive(connection)
        return connection

    def _greet(self, connection: socket.socket) -> None:
        connection.settimeout(_SECONDS)
        self._receive(connection)
        connection.sendall(_header(callerid=self._name, type=Image._type, md5sum=Image._md5sum, latching='0',
                                   message_definition=Image._full_text, topic=self._topic_in))


def packed(image: Image, stamp: int) -> bytes:
    """An image message as it travels."""
    image.header.stamp = genpy.Time(stamp)
    buffer = BytesIO()
    image.serialize(buffer)
    return struct.pack('<I', buffer.tell()) + buffer.getvalue()


def stamp_of(answer: memoryview) -> int:
    """Seconds of the stamp in an answer's header."""
    return struct.unpack_from('<I', answer, 4)[0]


def _header(**fields: str) -> bytes:
    entries = b''.join(struct.pack('<I', len(entry)) + entry
                       for entry in (f'{name}={value}'.encode() for name, value in fields.items()))
    return struct.pack('<I', len(entries)) + entries


def _read(connection: socket.socket, into: memoryview) -> memoryview:
    read = 0
    while read < len(into):
        count = connection.recv_into(into[read:])
        if count == 0:
            raise ConnectionError('the node has closed the connection')
        read += count
    return into
