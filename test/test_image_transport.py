#!/usr/bin/env python3
"""The transport among real ROS connections: with itself, with C++, and with subscribers that come, stall and leave."""

import contextlib
import errno
import gc
import http.server
import io
import logging
import os
import queue
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import unittest.mock
import urllib.parse
import weakref
import xmlrpc.client
from pathlib import Path
from types import SimpleNamespace

import cv2
import dynamic_reconfigure.client
import numpy as np
import rosbag
import rospy
import rostest
from rospy.exceptions import TransportTerminated
from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_pubsub import TCPROSPub, TCPROSSub
from rvc_features.msg import KeyPoints
from sensor_msgs.msg import CompressedImage
from sensor_msgs.msg import Image as PlainImage
from std_msgs.msg import Header
from std_srvs.srv import SetBool

sys.path.insert(0, str(Path(__file__).resolve().parent / 'unit'))

import pytest
from quadrant_images import ENCODINGS, corners, quadrants
from ros_helpers import Diagnostics, Inbox

from rvc_features import image_transport
from rvc_features.image_transport import (
    ImageTransport,
    RawTransport,
    Transport,
    TransportHints,
    messages,
    whole_reads,
    whole_writes,
)
from rvc_features.image_transport.messages import to_array, to_image_message, unpack

JPEG, PNG = (cv2.imencode(kind, quadrants('bgr8'))[1].tobytes() for kind in ('.jpg', '.png'))
BAD = [('jpeg', b''), ('jpeg', b'\xff\xd8\xff' + bytes(500)), ('jpeg', JPEG[:-100]), ('png', PNG[:-40]),
       ('mono16; jpeg compressed ', cv2.imencode('.jpg', quadrants('mono8'))[1].tobytes()),
       ('mono8; jpeg compressed ', JPEG), ('nonsense; jpeg compressed', JPEG)]

PATIENCE = 20   # seconds after which something that should happen is taken not to happen
COMPRESSED = TransportHints('compressed')


def wait_until(condition, what, patience=PATIENCE):
    """Wait for a state that rospy has no event for."""
    end = time.monotonic() + patience
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f'in {patience} s not: {what}')
        time.sleep(0.01)


def reading(sock, whole=True, megapixels=25.0, message_class=messages.Image):
    """A subscriber's connection as rospy makes it, over that socket, read as ours are."""
    message_class = whole_reads.received(message_class, megapixels)
    connection = TCPROSTransport(TCPROSSub('/topic', message_class, buff_size=1000), '/topic')
    connection.set_socket(sock, 'test')
    whole_reads.read_messages(SimpleNamespace(impl=SimpleNamespace(add_connection=None, connections=[connection])),
                              whole)
    return connection


def writing(sock, queue_size):
    """The connection to a subscriber as a publisher of ours has it."""
    connections = []
    implementation = SimpleNamespace(add_connection=connections.append, set_queue_size=lambda size: None)
    whole_writes.write_at_once(implementation, queue_size)
    transport = TCPROSTransport(TCPROSPub('/topic', messages.Image), '/topic')
    transport.set_socket(sock, 'test')
    implementation.add_connection(transport)
    return connections[0]


def on_the_wire_as_header(*fields):
    """What a connection begins with, of fields such as topic=/camera."""
    body = b''.join(struct.pack('<I', len(field)) + field for field in (text.encode('latin1') for text in fields))
    return struct.pack('<I', len(body)) + body


def on_the_wire(*images):
    """The bytes of messages one after another, as a publisher sends them."""
    buffer = io.BytesIO()
    for number, image in enumerate(images):
        rospy.msg.serialize_message(buffer, number, image)
    return buffer.getvalue()


class CountingTransport(Transport):
    """A plug-in as a user writes it: counts what it is asked to encode."""

    name = 'counting'
    message_class = PlainImage
    encoded: list = []   # noqa: RUF012

    def encode(self, image):
        self.encoded.append(image)
        return image

    def decode(self, message):
        return message


class BrokenHeader(Header):
    """A message that breaks off if it says so."""

    def serialize(self, buff):
        if self.frame_id == 'broken':
            buff.write(b'\0\0')
        else:
            super().serialize(buff)


class Warnings(logging.Handler):
    """What the node logs as warning or worse, while it is in use as a context."""

    def __enter__(self):
        self.texts = []
        logging.getLogger('rosout').addHandler(self)
        return self.texts

    def __exit__(self, *_):
        logging.getLogger('rosout').removeHandler(self)

    def emit(self, record):
        if record.levelno >= logging.WARNING:
            self.texts.append(record.getMessage())


class ImageTransportTest(unittest.TestCase):
    def setUp(self):
        self.transport = ImageTransport()

    def advertise(self, *arguments, **keywords):
        publisher = self.transport.advertise(*arguments, **keywords)
        self.addCleanup(publisher.shutdown)
        return publisher

    def subscribe(self, topic, *arguments, **keywords):
        """A subscriber and the queue of what it gets."""
        messages = queue.Queue()
        subscriber = self.transport.subscribe(topic, messages.put, *arguments, **keywords)
        self.addCleanup(subscriber.shutdown)
        return subscriber, messages

    def plain_publisher(self, topic, message_class):
        publisher = rospy.Publisher(topic, message_class, queue_size=10)
        self.addCleanup(publisher.unregister)
        return publisher

    # Colours ------------------------------------------------------------------------------------------------------

    def test_quadrants_from_us_to_us(self):
        publisher = self.advertise('to_us')
        for transport, kind, encodings, tolerance in (
                ('raw', 'jpeg', ENCODINGS, 0), ('compressed', 'png', ENCODINGS, 0),
                ('compressed', 'jpeg', [name for name in ENCODINGS if not name.startswith('bayer')], 3)):
            rospy.set_param('~image_transport', transport)
            self.addCleanup(rospy.delete_param, '~image_transport') if transport == 'raw' else None
            if kind == 'png':
                client = dynamic_reconfigure.client.Client('to_us/compressed', timeout=PATIENCE)
                self.addCleanup(client.close)
            if transport == 'compressed':
                assert client.update_configuration({'format': kind})['format'] == kind
            subscriber, messages = self.subscribe('to_us')
            assert subscriber.get_transport() == transport
            wait_until(lambda: publisher.get_num_subscribers() == 1, 'connected')
            for encoding in encodings:
                with self.subTest(transport=transport, kind=kind, encoding=encoding):
                    array, header = quadrants(encoding), Header(0, rospy.Time(12, 34), 'lens')
                    publisher.publish_array(array, encoding, header)
                    message = messages.get(timeout=PATIENCE)
                    assert isinstance(message, PlainImage)
                    assert message.encoding == encoding
                    assert (message.header.stamp, message.header.frame_id) == (header.stamp, 'lens')
                    found = to_array(message, 'passthrough')
                    assert (found.shape, found.dtype) == (array.shape, array.dtype)
                    np.testing.assert_allclose(corners(found), corners(array), atol=tolerance)
            subscriber.shutdown()
            wait_until(lambda: publisher.get_num_subscribers() == 0, 'gone')

    def test_quadrants_from_us_to_cpp_to_us(self):
        _, messages = self.subscribe('from_cpp')
        publisher = self.advertise('to_cpp')
        wait_until(lambda: publisher.get_num_subscribers() == 1, 'C++ connected')
        for encoding in ENCODINGS:
            with self.subTest(encoding=encoding):
                array = quadrants(encoding)
                publisher.publish_array(array, encoding, Header(0, rospy.Time(12, 34), 'lens'))
                message = messages.get(timeout=PATIENCE)
                assert (message.encoding, message.header.frame_id) == (encoding, 'lens')
                np.testing.assert_array_equal(to_array(message, 'passthrough'), array)

    def test_quadrants_as_the_cpp_plugin_writes_them(self):
        _, messages = self.subscribe('plugin', transport_hints=COMPRESSED)
        publisher = self.plain_publisher('plugin/compressed', CompressedImage)
        wait_until(lambda: publisher.get_num_connections() == 1, 'connected')
        for extension, kind in (('.jpg', 'jpeg'), ('.png', 'png')):
            for encoding in ENCODINGS:
                if kind == 'jpeg' and encoding in ('mono16', 'bayer_rggb8'):
                    continue
                with self.subTest(kind=kind, encoding=encoding):
                    colour = encoding in ('bgr8', 'rgb8', 'bgra8', 'rgba8')
                    data = cv2.imencode(extension, quadrants('bgr8' if colour else encoding))[1].tobytes()
                    publisher.publish(Header(), f'{encoding}; {kind} compressed {"bgr8" if colour else ""}', data)
                    message = messages.get(timeout=PATIENCE)
                    assert message.encoding == encoding
                    np.testing.assert_allclose(corners(to_array(message, 'passthrough')), corners(quadrants(encoding)),
                                               atol=3 if kind == 'jpeg' else 0)

    def test_undecoded_messages_on_request(self):
        publisher = self.advertise('undecoded')
        for transport, kind in (('raw', PlainImage), ('compressed', CompressedImage)):
            subscriber, messages = self.subscribe('undecoded', transport_hints=TransportHints(transport), decode=False)
            wait_until(lambda: publisher.get_num_subscribers() == 1, 'connected')
            publisher.publish_array(quadrants('rgb8'), 'rgb8')
            message = messages.get(timeout=PATIENCE)
            assert isinstance(message, kind)
            assert unpack(message)[1] == 'rgb8'
            subscriber.shutdown()
            wait_until(lambda: publisher.get_num_subscribers() == 0, 'gone')

    def test_messages_are_read_whole_however_they_come(self):
        images = [to_image_message(np.full((height, 50, 3), height % 256, np.uint8), 'bgr8')
                  for height in (1, 400, 30, 2000)]
        sent = on_the_wire(*images)
        first = 4 + struct.unpack_from('<I', sent)[0]
        for cuts in ([], [1], [4], [5, 6, 7], [first], [first + 2], [first + 4, 50_000], [*range(900, 99_999, 900)]):
            ours, theirs = socket.socketpair()
            connection = reading(ours)

            def send(portions=cuts, theirs=theirs):
                with theirs:
                    for begin, end in zip([0, *portions], [*portions, None]):
                        theirs.sendall(sent[begin:end])

            sender = threading.Thread(target=send)
            sender.start()
            with contextlib.closing(connection):
                received = []
                while len(received) < len(images):
                    received += connection.receive_once()
                for image, original in zip(received, images):
                    np.testing.assert_array_equal(to_array(image), to_array(original))
                sender.join()
                self.assertEqual(connection.stat_bytes, len(sent))
                with self.assertRaises(TransportTerminated):
                    connection.receive_once()

    def test_who_publishes_sends_what_the_socket_takes_and_a_thread_the_rest_in_order_and_whole(self):
        for queue_size, expected in ((1, [1, 2, 6, 7]), (2, [1, 2, 5, 6, 7]), (0, [1, 2, 3, 4, 5, 6, 7])):
            ours, theirs = socket.socketpair()
            connection = writing(ours, queue_size)
            picture = bytearray(500_000)   # more than sockets take

            def write(number, size=500_000, connection=connection, picture=picture):
                picture[:] = bytes([number]) * len(picture)
                connection.write([struct.pack('<I', 1 + size), bytes([number]), memoryview(picture)[:size]])
                picture[:] = bytes(len(picture))   # the caller's memory is the caller's again

            with theirs, contextlib.closing(connection):
                write(1, 100)
                assert not [thread for thread in threading.enumerate() if thread.name == 'slow subscriber']
                for number in (2, 3, 4, 5, 6):
                    write(number)
                stream = theirs.makefile('rb')
                for number in expected:
                    if number == 7:
                        wait_until(lambda: not connection._is_behind, 'all that waited is sent')   # noqa: B023
                        write(7, 100)
                    size, = struct.unpack('<I', stream.read(4))
                    assert stream.read(size) == bytes([number]) * size
                assert connection.stat_num_msg == len(expected)
            wait_until(lambda: not [thread for thread in threading.enumerate() if thread.name == 'slow subscriber'],
                       'the thread has ended with the connection')

    def test_memory_that_never_changes_is_not_copied_for_a_slow_subscriber(self):
        ours, theirs = socket.socketpair()
        connection = writing(ours, 1)
        picture = np.zeros(5_000_000, np.uint8)
        picture.flags.writeable = False
        with theirs, contextlib.closing(connection):
            for _ in range(2):
                connection.write([b'head', picture.data])
            assert [memoryview(piece).obj is picture for piece in connection._waiting[0]] == [False, True]

    def test_a_message_to_a_subscriber_that_has_left_ends_the_connection(self):
        for size in (10, 5_000_000):
            ours, theirs = socket.socketpair()
            connection = writing(ours, 1)
            if size > 10:
                connection.write([bytes(size)])   # the thread has something to send
            theirs.close()

            def write(connection=connection):
                try:
                    connection.write([bytes(10)])
                except (OSError, TransportTerminated):
                    return True
                return False
            wait_until(write, 'told')
            connection.close()
            assert connection.done

    def test_connection_that_ends_within_a_message_is_noticed(self):
        ours, theirs = socket.socketpair()
        connection = reading(ours)
        with theirs:
            theirs.sendall(struct.pack('<I', 10_000) + bytes(500))
        with contextlib.closing(connection), self.assertRaises(TransportTerminated):
            connection.receive_once()

    def test_messages_that_are_no_images_come_as_such_and_hold_up_none_behind_them(self):
        good = to_image_message(quadrants('bgr8'), 'bgr8')
        packed = CompressedImage(Header(), 'bgr8; jpeg compressed bgr8', JPEG)
        rubbish = [b'', bytes(3), b'\xff' * 500, struct.pack('<4I', 0, 0, 0, 2**32 - 1) + bytes(40), os.urandom(5000)]
        for message_class, image in ((messages.Image, good), (CompressedImage, packed)):
            for whole in (True, False) if message_class is messages.Image else (False,):
                ours, theirs = socket.socketpair()
                sent = b''.join(struct.pack('<I', len(data)) + data for data in [*rubbish, bytes(900_000)])
                sender = threading.Thread(target=lambda sent=sent, theirs=theirs, image=image: theirs.sendall(
                    sent + on_the_wire(image)))
                sender.start()
                connection = reading(ours, whole, megapixels=0.2, message_class=message_class)
                with contextlib.closing(connection), theirs, Warnings() as texts:
                    received = []
                    while len(received) < len(rubbish) + 2:
                        received += connection.receive_once()
                    sender.join()
                np.testing.assert_allclose(corners(to_array(received[-1])), corners(quadrants('bgr8')), atol=3)
                for message in received[:-1]:
                    with pytest.raises(image_transport.ImageError):
                        to_array(message)
                with pytest.raises(image_transport.ImageError, match=re.escape(
                        '900000 bytes passed over unread: more than 0.2 megapixels (parameter ~most_megapixels)')):
                    to_array(received[-2])
                assert not re.search('Traceback|File "', ''.join(texts))

    def test_rospy_does_not_keep_a_message_that_has_been_dealt_with(self):
        """It would until the next one of that connection comes, which may be never."""
        for whole in (True, False):
            ours, theirs = socket.socketpair()
            connection, left = reading(ours, whole), []
            loop = threading.Thread(target=connection.receive_loop, daemon=True, args=[
                lambda received, _, left=left: left.append(weakref.ref(received[0]))])
            loop.start()
            with theirs:
                theirs.sendall(on_the_wire(to_image_message(quadrants('bgr8'), 'bgr8')))
                wait_until(lambda left=left: left and left[0]() is None, 'message freed')
            loop.join(PATIENCE)

    def test_limit_of_size(self):
        for value, expected in ((0.001, 0.001), (100, 100.0), (0, 25.0), ('many', 25.0), (True, 25.0), (1e9, 25.0)):
            rospy.set_param('~most_megapixels', value)
            with Warnings() as texts:
                assert image_transport.image_transport.most_megapixels() == expected
            assert ('~most_megapixels must be a number' in ''.join(texts)) == (expected == 25.0), value
        rospy.set_param('~most_megapixels', 0.08)
        self.addCleanup(rospy.delete_param, '~most_megapixels')
        publisher = self.advertise('large')
        _, raw = self.subscribe('large', queue_size=10)
        subscriber, packed = self.subscribe('large', transport_hints=COMPRESSED, queue_size=10)
        wait_until(lambda: publisher.get_num_subscribers() == 2, 'connected')
        publisher.publish_array(np.zeros((300, 270), np.uint8), 'mono8')
        with pytest.raises(image_transport.ImageError, match=re.escape(
                '270 x 300 pixels: more than 0.08 megapixels (parameter ~most_megapixels)')):
            to_array(raw.get(timeout=PATIENCE))
        wait_until(lambda: subscriber.errors == 1, 'refused')
        publisher.publish_array(quadrants('mono8'), 'mono8')
        assert packed.get(timeout=PATIENCE).width == to_array(raw.get(timeout=PATIENCE)).shape[1] == 96

    def test_a_connection_that_says_nothing_or_rubbish_holds_up_nobody(self):
        publisher = self.advertise('besieged', transports=['raw'])
        host, port = rospy.impl.tcpros_base.get_tcpros_server_address()
        silent = [socket.create_connection((host, port)) for _ in range(5)]
        for connection in silent:
            self.addCleanup(connection.close)
        silent[0].sendall(b'\x40')
        begin = time.monotonic()
        _, images = self.subscribe('besieged')
        wait_until(lambda: publisher.get_num_subscribers() == 1, 'connected', patience=3)
        assert time.monotonic() - begin < 3
        publisher.publish_array(quadrants('bgr8'), 'bgr8')
        images.get(timeout=PATIENCE)

        with Warnings() as texts:
            for said in (b'\xff' * 8, b'GET / HTTP/1.0\r\n\r\n', struct.pack('<I', 3) + b'abc', struct.pack('<I', 0),
                         on_the_wire_as_header('topic=/nowhere', 'md5sum=*', 'callerid=/test'),
                         on_the_wire_as_header('topic=/besieged', 'md5sum=*'),
                         on_the_wire_as_header('service=/nowhere', 'md5sum=*', 'callerid=/test'),
                         on_the_wire_as_header('nothing=of use'), on_the_wire_as_header('\xff')):
                for _ in range(10):
                    with socket.create_connection((host, port)) as connection:
                        connection.sendall(said)
                        connection.settimeout(PATIENCE)
                        with contextlib.suppress(ConnectionResetError):   # or ended with something left unread
                            while connection.recv(1000):
                                pass
            _, images = self.subscribe('besieged', transport_hints=TransportHints('raw', 'none'))
            publisher.publish_array(quadrants('bgr8'), 'bgr8')
            images.get(timeout=PATIENCE)
        assert len(texts) <= 1, 'throttled'
        assert not re.search('Traceback|File "', ''.join(texts))
        for connection in silent[1:]:
            connection.settimeout(PATIENCE)
            assert connection.recv(100) == b'', 'ended after some seconds'

    def test_who_asks_for_what_has_been_withdrawn_is_answered_and_not_reported(self):
        """As somebody does whenever a node ends; who says nothing and leaves is no news either."""
        self.advertise('besieged', transports=['raw']).shutdown()
        address = rospy.impl.tcpros_base.get_tcpros_server_address()
        handshakes = rospy.impl.tcpros_base._tcpros_server.tcp_ros_server.inbound_handler
        refused = handshakes._refused
        for said, answer in (
                (on_the_wire_as_header('topic=/besieged', 'md5sum=*', 'callerid=/test'), b'not a publisher of'),
                (on_the_wire_as_header('service=/nowhere', 'md5sum=*', 'callerid=/test'), b'not a provider of'),
                (on_the_wire_as_header('topic=/besieged'), b'Missing required'), (b'', b''), (b'\x40', b'')):
            with socket.create_connection(address, PATIENCE) as connection:
                connection.sendall(said)
                connection.shutdown(socket.SHUT_WR)
                heard = b''.join(iter(lambda connection=connection: connection.recv(1000), b''))
            assert answer in heard, said
        assert handshakes._refused == refused
        with socket.create_connection(address, PATIENCE) as connection:
            connection.sendall(on_the_wire_as_header('nothing=of use'))
            wait_until(lambda: handshakes._refused == refused + 1, 'what makes no sense is reported')

    def test_a_request_that_can_not_be_read_is_refused_and_does_not_end_in_a_traceback(self):
        """Nor do those who ask and leave: there were three tracebacks for each, two of them in the log file."""
        service = rospy.Service('asked', SetBool, lambda request: (request.data, 'well'))
        self.addCleanup(service.shutdown)
        ImageTransport()
        address = rospy.impl.tcpros_base.get_tcpros_server_address()
        header = on_the_wire_as_header('service=/asked', f'md5sum={SetBool._md5sum}', 'callerid=/test')
        with Warnings() as texts, unittest.mock.patch.object(threading, 'excepthook') as died:
            for said, answer in (
                    (struct.pack('<I', 2 ** 32 - 1), b'4294967295 bytes, where'),
                    (struct.pack('<I', 0), b'0 bytes that can not be deserialized'),
                    (struct.pack('<I', 1) + b'\1', b'\1' + struct.pack('<IBI', 9, 1, 4) + b'well'), (b'\0', b'')):
                with socket.create_connection(address, PATIENCE) as connection:
                    connection.sendall(header + said)
                    connection.shutdown(socket.SHUT_WR)
                    heard = b''.join(iter(lambda connection=connection: connection.recv(1000), b''))
                assert answer in heard, said
            assert rospy.ServiceProxy('asked', SetBool)(True).message == 'well'
        assert not died.called
        assert len(texts) <= 1, texts

    def test_calls_that_are_bombs_are_refused_at_once(self):
        """1 kB of XML kept a thread busy for minutes and took hundreds of MB."""
        uri = rospy.core.get_node_uri()
        entities = ''.join(f'<!ENTITY e{n} "{f"&e{n - 1};" * 8}">' for n in range(1, 10))
        bomb = (f'<?xml version="1.0"?><!DOCTYPE bomb [<!ENTITY e0 "0123456789">{entities}]><methodCall><methodName>'
                '&e9;</methodName></methodCall>').encode()
        host, port = urllib.parse.urlparse(uri).netloc.split(':')
        for body, length in ((bomb, len(bomb)), (b'<', 10 ** 10), (b'<', -1)):
            with socket.create_connection((host, int(port)), PATIENCE) as connection:
                connection.sendall(f'POST /RPC2 HTTP/1.0\r\nContent-Length: {length}\r\n\r\n'.encode() + body)
                heard = b''.join(iter(lambda connection=connection: connection.recv(1000), b''))
            assert b'document type' in heard or b' 413 ' in heard or b' 500 ' in heard, heard[:300]
        assert xmlrpc.client.ServerProxy(uri).getPid('/test') == [1, '', os.getpid()]

    def test_publishers_that_can_not_be_reached_are_not_tried_for_ever(self):
        """Each cost a thread for good, and one more each time that somebody subscribed or the list changed."""
        refuses = http.server.HTTPServer(('localhost', 0), http.server.BaseHTTPRequestHandler)   # any POST, with 501
        refuses.RequestHandlerClass.log_message = lambda *_: None
        self.addCleanup(refuses.server_close)
        self.addCleanup(refuses.shutdown)
        threading.Thread(target=refuses.serve_forever, daemon=True).start()
        subscriber, _ = self.subscribe('unreachable')

        def attempts():
            targets = [getattr(thread, '_target', None) for thread in threading.enumerate()]
            return sum(getattr(target, '__name__', '') == '_connect_topic_thread' for target in targets)

        node = xmlrpc.client.ServerProxy(rospy.core.get_node_uri())
        uris = [f'http://localhost:{refuses.server_port}/RPC2?{number}' for number in range(5)]
        for _ in range(3):
            node.publisherUpdate('/master', '/unreachable', uris)
        wait_until(lambda: attempts() == len(uris), 'tried, each once')
        node.publisherUpdate('/master', '/unreachable', uris[:1])
        wait_until(lambda: attempts() == 1, 'only the one that is left')
        subscriber.shutdown()
        wait_until(lambda: attempts() == 0, 'none that nobody wants')

    def test_a_process_without_descriptors_accepts_connections_again_when_it_has_some(self):
        publisher = self.advertise('exhausted', transports=['raw'])
        address = rospy.impl.tcpros_base.get_tcpros_server_address()
        door = rospy.impl.tcpros_base._tcpros_server.tcp_ros_server.server_sock
        full = OSError(errno.EMFILE, 'Too many open files')
        listening = unittest.mock.Mock(accept=unittest.mock.Mock(side_effect=[full, full, ('connection', address)]))
        assert type(door)(listening).accept() == ('connection', address)
        _, images = self.subscribe('exhausted')
        wait_until(lambda: publisher.get_num_subscribers() == 1, 'connected')
        publisher.publish_array(quadrants('bgr8'), 'bgr8')
        images.get(timeout=PATIENCE)

    def test_a_message_of_another_kind_that_can_not_be_read_does_not_end_the_connection(self):
        """As of a mask or a calibration: after one bad message there came none any more."""
        heard = queue.Queue()
        subscriber = whole_reads.subscribe('kinds', Header, heard.put, 1.0)
        self.addCleanup(subscriber.unregister)
        publisher = self.plain_publisher('kinds', BrokenHeader)
        wait_until(lambda: publisher.get_num_connections() == 1, 'connected')
        publisher.publish(BrokenHeader(frame_id='broken'))
        publisher.publish(BrokenHeader(frame_id='whole'))
        assert heard.get(timeout=PATIENCE).frame_id == 'whole'

    def test_a_subscription_that_ends_leaves_no_descriptor_open(self):
        publisher = self.advertise('cycled', transports=['raw'])
        gc.disable()
        self.addCleanup(gc.enable)
        counts = []
        for _ in range(30):
            subscriber, _ = self.subscribe('cycled')
            wait_until(lambda: publisher.get_num_subscribers() == 1, 'connected')
            subscriber.shutdown()
            wait_until(lambda: publisher.get_num_subscribers() == 0, 'gone')
            counts.append(len(os.listdir('/proc/self/fd')))
        assert max(counts) - counts[0] <= 5, counts

    def test_any_tool_recognises_what_we_publish(self):
        publisher = self.advertise('typed', latch=True)
        publisher.publish_array(quadrants('bgr8'), 'bgr8')
        for topic, kind in (('typed', PlainImage), ('typed/compressed', CompressedImage)):
            messages = queue.Queue()
            subscriber = rospy.Subscriber(topic, rospy.AnyMsg, messages.put)
            self.addCleanup(subscriber.unregister)
            message = messages.get(timeout=PATIENCE)
            header = message._connection_header
            assert (header['type'], header['md5sum'], header['latching']) == (kind._type, kind._md5sum, '1')
            assert header['message_definition'] == kind._full_text
            np.testing.assert_allclose(corners(to_array(kind().deserialize(message._buff))),
                                       corners(quadrants('bgr8')), atol=3)

    def test_republish(self):
        _, messages = self.subscribe('packed_again', transport_hints=COMPRESSED)
        publisher = self.advertise('packed', transports=['compressed'])
        wait_until(lambda: publisher.get_num_subscribers() == 1, 'both republishers connected, as somebody listens')
        publisher.publish_array(quadrants('rgb8'), 'rgb8', Header(0, None, 'twice'))
        message = messages.get(timeout=PATIENCE)
        assert (message.encoding, message.header.frame_id) == ('rgb8', 'twice')
        np.testing.assert_allclose(corners(to_array(message, 'passthrough')), corners(quadrants('rgb8')), atol=5)
        diagnostics = Diagnostics('unpack')
        self.addCleanup(diagnostics.close)
        values = diagnostics.wait_for_values(lambda values: values['frames processed'] == '1', 'counted')
        assert values['input'] == '/packed/compressed (compressed)'
        publisher = self.plain_publisher('packed/compressed', CompressedImage)
        publisher.publish(Header(), 'jpeg', b'not a picture')
        values = diagnostics.wait_for_values(lambda values: values['frames rejected'] == '1', 'refused')
        assert values['level'] >= 1
        assert 'images rejected: neither JPEG nor PNG: 13 bytes' in values['message']
        published = dict(rospy.get_published_topics())
        assert {'/unpacked', '/packed', '/packed_again'} & set(published) == {'/unpacked'}

    def test_republish_refuses_a_transport_that_there_is_not(self):
        for arguments, text in (
                (['raw', '_image_transport:=theora'], "~image_transport must be one of compressed, raw; got 'theora'"),
                (['theora'], "invalid choice: 'theora'")):
            result = subprocess.run(['rosrun', 'rvc_features', 'republish', *arguments, 'in:=nowhere', 'out:=there'],
                                    capture_output=True, text=True, timeout=PATIENCE, check=False)
            assert result.returncode == 2
            assert text in result.stderr + result.stdout
            assert 'Traceback' not in result.stderr

    # Names and parameters -----------------------------------------------------------------------------------------

    def test_names_are_resolved_before_anything_is_appended(self):
        publisher = self.advertise('here')   # remapped to /elsewhere/camera
        assert publisher.get_topic() == '/elsewhere/camera'
        published = dict(rospy.get_published_topics())
        assert published['/elsewhere/camera'] == 'sensor_msgs/Image'
        assert published['/elsewhere/camera/compressed'] == 'sensor_msgs/CompressedImage'
        assert rospy.get_param('/elsewhere/camera/compressed/jpeg_quality') == 80
        subscriber, messages = self.subscribe('here', transport_hints=COMPRESSED)
        assert (subscriber.get_topic(), subscriber.get_transport()) == ('/elsewhere/camera/compressed', 'compressed')
        wait_until(lambda: publisher.get_num_subscribers() == subscriber.get_num_publishers() == 1, 'connected')
        publisher.publish_array(quadrants('bgr8'), 'bgr8')
        messages.get(timeout=PATIENCE)

    def test_the_parameter_wins_over_the_hint_and_may_have_another_name(self):
        rospy.set_param('~image_transport', 'compressed')
        rospy.set_param('/left/transport', 'raw')
        self.addCleanup(rospy.delete_param, '~image_transport')
        self.addCleanup(rospy.delete_param, '/left/transport')
        subscriber, _ = self.subscribe('chosen', transport_hints='raw')
        assert subscriber.get_transport() == 'compressed'
        subscriber, _ = self.subscribe('chosen', transport_hints=TransportHints('compressed', 'transport', '/left'))
        assert subscriber.get_transport() == 'raw'

    def test_unknown_transport(self):
        for transport in ('theora', '', 7, ['raw']):
            rospy.set_param('~image_transport', transport)
            with pytest.raises(ValueError, match=re.escape(f'{transport!r}; there are compressed, raw')):
                self.subscribe('unknown')
            with pytest.raises(ValueError, match=re.escape(f'{transport!r}; there are compressed, raw')):
                self.advertise('unknown', transports=[transport])
        rospy.delete_param('~image_transport')

    def test_arguments_that_can_not_be(self):
        for queue_size in (None, -1, 'one'):
            with pytest.raises(ValueError, match='queue_size'):
                self.advertise('unknown', queue_size=queue_size)
        publisher = self.advertise('strict')
        for message in (quadrants('bgr8'), CompressedImage(), None):
            with pytest.raises(TypeError, match=f'sensor_msgs/Image.*{type(message).__name__}'):
                publisher.publish(message)

    def test_warning_for_a_topic_of_one_transport(self):
        with Warnings() as texts:
            self.subscribe('camera/image/compressed')
            self.subscribe('camera/compressed_image')
        assert len(texts) == 1
        assert re.search(r'/camera/image/compressed .* /camera/image .*_image_transport:=compressed', texts[0])

    def test_outputs_can_be_turned_off(self):
        for name, topics in (('only_raw', {''}), ('only_compressed', {'/compressed'}),
                             ('disabled_wrongly', {'', '/compressed'})):
            self.advertise(name)
            found = {topic[len(name) + 1:] for topic, kind in rospy.get_published_topics()
                     if kind.startswith('sensor_msgs/') and topic.startswith(f'/{name}')}
            assert found == topics, name

    def test_parameters_of_compression(self):
        publisher = self.advertise('tuned')
        _, messages = self.subscribe('tuned', transport_hints=COMPRESSED, decode=False)
        wait_until(lambda: publisher.get_num_subscribers() == 1, 'connected')
        client = dynamic_reconfigure.client.Client('tuned/compressed', timeout=PATIENCE)
        self.addCleanup(client.close)
        noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)

        def sent(**parameters):
            in_force = client.update_configuration(parameters)
            publisher.publish_array(noise, 'bgr8')
            return in_force, messages.get(timeout=PATIENCE)

        large, small = sent(jpeg_quality=95)[1], sent(jpeg_quality=5)[1]
        assert len(large.data) > 2 * len(small.data)
        assert sent(format='png')[1].format == 'bgr8; png compressed bgr8'
        assert rospy.get_param('tuned/compressed/format') == 'png'
        for hostile in ({'format': 'tiff'}, {'format': ''}, {'jpeg_quality': 1000}, {'png_level': -5}):
            in_force, message = sent(**hostile)
            assert message.format == 'bgr8; png compressed bgr8', hostile
            assert in_force['jpeg_quality'] in range(1, 101)
            assert in_force['png_level'] in range(1, 10)
        assert sent(format='jpeg')[1].format == 'bgr8; jpeg compressed bgr8'
        assert b'\xff\xd2' in sent(jpeg_restart_interval=4)[1].data
        client.update_configuration({'enable': False})
        publisher.publish_array(noise, 'bgr8')
        sent(enable=True)
        assert messages.empty(), 'one was not sent'
        assert publisher.errors == 0

    def test_refusals_name_the_cure(self):
        publisher = self.advertise('wide')
        self.subscribe('wide', transport_hints=COMPRESSED)
        wait_until(lambda: publisher.get_num_subscribers() == 1, 'connected')
        outlet = publisher._outlets[1]._transport
        for array, encoding, text in (
                (np.zeros((2, 70_000), np.uint8), 'mono8',
                 '(rosrun dynamic_reconfigure dynparam set /wide/compressed format png)'),
                (np.zeros((2, 3), np.float32), '32FC1', 'can not be compressed, only those of 8 or 16 unsigned bits')):
            with pytest.raises(image_transport.ImageError, match=re.escape(text)):
                outlet.encode(to_image_message(array, encoding))

    def test_mode_of_reading(self):
        publisher = self.advertise('coloured')
        for mode, encoding in (('unchanged', 'rgb8'), ('gray', 'mono8'), ('color', 'bgr8'), ('sepia', 'rgb8')):
            rospy.set_param('~compressed/mode', mode)
            with Warnings() as texts:
                subscriber, images = self.subscribe('coloured', transport_hints=COMPRESSED)
            assert [text for text in texts if '~compressed/mode must be one of' in text] == texts
            assert len(texts) == (mode == 'sepia')
            wait_until(lambda: publisher.get_num_subscribers() == 1, 'connected')
            publisher.publish_array(quadrants('rgb8'), 'rgb8')
            image = images.get(timeout=PATIENCE)
            assert image.encoding == encoding, mode
            np.testing.assert_allclose(corners(to_array(image, 'passthrough')), corners(quadrants(encoding)), atol=3)
            subscriber.shutdown()
            wait_until(lambda: publisher.get_num_subscribers() == 0, 'gone')
        rospy.delete_param('~compressed/mode')

    def test_parameters_preset_wrongly(self):
        publisher = self.advertise('preset')
        _, messages = self.subscribe('preset', transport_hints=COMPRESSED)
        wait_until(lambda: publisher.get_num_subscribers() == 1, 'connected')
        publisher.publish_array(quadrants('bgr8'), 'bgr8')
        messages.get(timeout=PATIENCE)
        assert rospy.get_param('preset/compressed') == {
            'format': 'jpeg', 'jpeg_quality': 80, 'png_level': 9, 'jpeg_progressive': True, 'jpeg_optimize': False,
            'jpeg_restart_interval': 0, 'enable': True}

    # Laziness and latching ----------------------------------------------------------------------------------------

    def test_encoding_once_for_each_image_and_only_when_somebody_listens(self):
        image_transport.TRANSPORTS['counting'] = CountingTransport
        self.addCleanup(image_transport.TRANSPORTS.pop, 'counting')
        publisher = self.advertise('lazy')
        _, raw = self.subscribe('lazy')
        wait_until(lambda: publisher.get_num_subscribers() == 1, 'raw connected')
        publisher.publish_array(quadrants('bgr8'), 'bgr8')
        raw.get(timeout=PATIENCE)
        assert CountingTransport.encoded == []

        _, counted = self.subscribe('lazy', transport_hints=TransportHints('counting'))
        other = queue.Queue()
        republisher = subprocess.Popen(['rosrun', 'image_transport', 'republish', 'raw', 'in:=lazy/counting', 'raw',
                                        'out:=lazy_again', '__name:=second_listener'])
        self.addCleanup(self.end, republisher)
        again = rospy.Subscriber('lazy_again', PlainImage, other.put)
        self.addCleanup(again.unregister)
        wait_until(lambda: publisher.get_num_subscribers() == 3, 'two more connected')
        publisher.publish_array(quadrants('bgr8'), 'bgr8')
        for inbox in (raw, counted, other):
            inbox.get(timeout=PATIENCE)
        assert len(CountingTransport.encoded) == 1

    def test_latched_image_for_whoever_comes_late(self):
        for transport in ('raw', 'compressed'):
            publisher = self.advertise('latched', latch=True)
            array = quadrants('bgr8')
            publisher.publish_array(np.zeros_like(array), 'bgr8')
            publisher.publish_array(array, 'bgr8', Header(0, None, 'late'))
            array[:] = 0   # the caller's array is the caller's again
            for _ in range(2):
                subscriber, messages = self.subscribe('latched', transport_hints=TransportHints(transport))
                message = messages.get(timeout=PATIENCE)
                assert message.header.frame_id == 'late'
                np.testing.assert_allclose(corners(to_array(message)), corners(quadrants('bgr8')), atol=3)
                subscriber.shutdown()
                wait_until(lambda publisher=publisher: publisher.get_num_subscribers() == 0, 'gone')
                assert messages.empty(), 'sent twice'
            publisher.shutdown()

    def test_without_latch_nothing_is_kept(self):
        publisher = self.advertise('forgetful')
        publisher.publish_array(quadrants('bgr8'), 'bgr8')
        _, messages = self.subscribe('forgetful')
        wait_until(lambda: publisher.get_num_subscribers() == 1, 'connected')
        publisher.publish_array(quadrants('mono8'), 'mono8')
        assert messages.get(timeout=PATIENCE).encoding == 'mono8'

    def test_news_of_subscribers(self):
        came, left = threading.Event(), threading.Event()
        publisher = self.advertise('observed', subscriber_connected=came.set, subscriber_disconnected=left.set)
        subscriber, _ = self.subscribe('observed', transport_hints=COMPRESSED)
        assert came.wait(PATIENCE)
        assert not left.is_set()
        subscriber.shutdown()
        assert left.wait(PATIENCE)
        wait_until(lambda: publisher.get_num_subscribers() == 0, 'gone')

    # Trouble ------------------------------------------------------------------------------------------------------

    def test_bad_messages_are_counted_reported_and_skipped(self):
        subscriber, messages = self.subscribe('bad', transport_hints=COMPRESSED, queue_size=100)
        publisher = self.plain_publisher('bad/compressed', CompressedImage)
        wait_until(lambda: publisher.get_num_connections() == 1, 'connected')
        with Warnings() as texts:
            for text, data in BAD:
                publisher.publish(Header(), text, data)
            publisher.publish(Header(), 'bgr8; jpeg compressed bgr8', JPEG)
            message = messages.get(timeout=PATIENCE)
        assert message.encoding == 'bgr8'
        assert messages.empty()
        assert subscriber.errors == len(BAD)
        reports = [text for text in texts if 'image skipped' in text]
        assert len(reports) == 1, 'throttled'
        assert '/bad/compressed' in reports[0]

    def test_node_survives_bad_messages_and_counts_them(self):
        diagnostics, points = Diagnostics('remote/remote_detector'), Inbox('remote/key_points', KeyPoints)
        self.addCleanup(diagnostics.close)
        self.addCleanup(points.close)
        publisher = self.plain_publisher('remote_camera/compressed', CompressedImage)
        wait_until(lambda: publisher.get_num_connections() == 1, 'connected, as somebody listens to the points',
                   patience=100)   # a node that starts for the first time compiles its kernels before
        for count, (text, data) in enumerate(BAD, 1):
            publisher.publish(Header(), text, data)   # one at a time: of several only the newest is looked at
            diagnostics.wait_for_values(lambda values, count=count: values['frames rejected'] == str(count), text)
        publisher.publish(Header(0, rospy.Time(56), 'lens'), 'bgr8; jpeg compressed bgr8', JPEG)
        message = points.wait_for(lambda message: message.header.stamp == rospy.Time(56))
        assert (message.width, message.height, message.header.frame_id) == (96, 64, 'lens')

    def test_rosbag_record_of_everything(self):
        publisher = self.advertise('recorded')
        published = 0
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / 'all.bag'
            recorder = subprocess.Popen(['rosbag', 'record', '--all', '--duration=4', '--output-name', str(path)])
            self.addCleanup(self.end, recorder)
            while recorder.poll() is None:
                publisher.publish_array(quadrants('bgr8'), 'bgr8')
                published += 1
                with contextlib.suppress(subprocess.TimeoutExpired):
                    recorder.wait(0.05)
            with rosbag.Bag(str(path)) as bag:
                topics = bag.get_type_and_topic_info().topics
                recorded = {topic: [message for _, message, _ in bag.read_messages(topic)]
                            for topic in ('/recorded', '/recorded/compressed')}
        assert topics['/recorded'].msg_type == 'sensor_msgs/Image'
        assert '/recorded/compressed/parameter_descriptions' in topics
        for recording in recorded.values():
            assert 10 < len(recording) <= published
            for message in recording:
                np.testing.assert_allclose(corners(to_array(message)), corners(quadrants('bgr8')), atol=3)
        assert publisher.errors == 0

    def test_image_that_can_not_be_compressed_still_goes_out_raw(self):
        publisher = self.advertise('depth')
        _, raw = self.subscribe('depth')
        _, none = self.subscribe('depth', transport_hints=COMPRESSED)
        wait_until(lambda: publisher.get_num_subscribers() == 2, 'connected')
        for count in (1, 2):
            publisher.publish_array(np.ones((4, 5), np.float32), '32FC1')
            assert raw.get(timeout=PATIENCE).encoding == '32FC1'
            assert publisher.errors == count
        publisher.publish_array(np.ones((4, 5), np.uint8), 'mono8')
        assert none.get(timeout=PATIENCE).encoding == 'mono8'

    def test_subscriber_that_stops_reading_does_not_stop_the_publisher(self):
        publisher = self.advertise('stalled')
        stalled = subprocess.Popen(['rosrun', 'image_transport', 'republish', 'raw', 'in:=stalled', 'raw',
                                    'out:=stalled_again', '__name:=sleeper'])
        self.addCleanup(self.end, stalled)
        sink = rospy.Subscriber('stalled_again', PlainImage)   # republish is lazy too
        self.addCleanup(sink.unregister)
        wait_until(lambda: publisher.get_num_subscribers() == 1, 'connected')
        stalled.send_signal(signal.SIGSTOP)   # rosrun has become the node itself by now
        frame = np.zeros((1080, 1920, 3), np.uint8)
        publishing = threading.Thread(target=lambda: [publisher.publish_array(frame, 'bgr8') for _ in range(30)],
                                      daemon=True)
        publishing.start()
        publishing.join(PATIENCE)
        assert not publishing.is_alive()
        _, messages = self.subscribe('stalled')
        wait_until(lambda: publisher.get_num_subscribers() == 2, 'another connected')
        publisher.publish_array(quadrants('bgr8'), 'bgr8')
        messages.get(timeout=PATIENCE)

    def test_a_hundred_times_subscribing_and_leaving(self):
        threads_before, files_before = set(threading.enumerate()), len(os.listdir('/proc/self/fd'))
        publisher = self.advertise('hundred', latch=True)
        frame, stop, problems, threads = quadrants('bgr8'), threading.Event(), [], set()

        def film():
            try:
                while not stop.wait(0.002):
                    publisher.publish_array(frame, 'bgr8')
            except Exception as error:   # would end unseen in this thread
                problems.append(error)

        filming = threading.Thread(target=film)
        filming.start()
        self.addCleanup(filming.join)
        self.addCleanup(stop.set)
        for i in range(100):
            arrived = threading.Event()
            subscriber = self.transport.subscribe('hundred', lambda _, arrived=arrived: arrived.set(),
                                                  transport_hints=TransportHints(('raw', 'compressed')[i % 2]))
            assert arrived.wait(PATIENCE)
            threads.update(threading.enumerate())
            subscriber.shutdown()
        assert len(threads - threads_before) > 100, 'each connection has its own'
        wait_until(lambda: publisher.get_num_subscribers() == 0, 'no connection')
        stop.set()
        filming.join()
        assert problems == []
        wait_until(lambda: set(threading.enumerate()) <= threads_before, 'no thread')
        assert not [topic for topic in rospy.topics.get_topic_manager().subs if topic.startswith('/hundred')]
        assert len(os.listdir('/proc/self/fd')) < files_before + 10   # some, for rospy's calls to other nodes

    def test_publisher_that_ends_takes_everything_with_it_and_can_come_back(self):
        for _ in range(2):
            publisher = self.transport.advertise('brief')
            assert '/brief/compressed/parameter_updates' in dict(rospy.get_published_topics())
            publisher.shutdown()
            assert not [topic for topic, _ in rospy.get_published_topics() if topic.startswith('/brief')]
            assert publisher.get_num_subscribers() == 0

    def test_two_publishers_of_one_topic_in_one_node(self):
        first, second = self.advertise('shared'), self.advertise('shared')
        _, messages = self.subscribe('shared')
        wait_until(lambda: first.get_num_subscribers() == second.get_num_subscribers() == 1, 'connected')
        for publisher in (first, second):
            publisher.publish_array(quadrants('bgr8'), 'bgr8')
            messages.get(timeout=PATIENCE)

    def test_table_of_transports(self):
        assert self.transport.get_declared_transports() == ['compressed', 'raw']
        assert image_transport.TRANSPORTS['raw'] is RawTransport

    @staticmethod
    def end(process):
        process.send_signal(signal.SIGCONT)
        process.terminate()
        process.wait(PATIENCE)


if __name__ == '__main__':
    rospy.init_node('test_image_transport')
    rostest.rosrun('rvc_features', 'image_transport', ImageTransportTest)
