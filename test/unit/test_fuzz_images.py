"""Images that nobody made: whatever is sent, there are pixels or one ImageError, in good time, and never a crash.

The decoders run in a process of their own, so that a crash is a finding. More than the few examples of each run:
RVC_FEATURES_EXAMPLES=20000 python3 -m pytest test/unit/test_fuzz_images.py
"""

import io
import os
import struct
import zlib

import cv2
import hostile_images as hostile
import numpy as np
import pytest

hypothesis = pytest.importorskip('hypothesis')
pytest.importorskip('sensor_msgs.msg')   # needs ROS's messages, though no master

import sensor_msgs.msg  # noqa: E402
from decoder_process import DecoderProcess  # noqa: E402
from hypothesis import given  # noqa: E402
from hypothesis import strategies as some  # noqa: E402

from rvc_features.image_transport.compressed import to_compressed_message  # noqa: E402
from rvc_features.image_transport.encodings import ImageError  # noqa: E402
from rvc_features.image_transport.messages import to_array, unpack  # noqa: E402
from rvc_features.image_transport.whole_reads import received  # noqa: E402

EXAMPLES = int(os.environ.get('RVC_FEATURES_EXAMPLES', '60'))
MOST_SECONDS, MOST_MEGABYTES = 3.0, 1500.0   # for one message of up to 10 MB
settings = hypothesis.settings(max_examples=EXAMPLES, deadline=None, database=None,
                               derandomize='RVC_FEATURES_EXAMPLES' not in os.environ,
                               suppress_health_check=list(hypothesis.HealthCheck))

PICTURE = cv2.resize(np.random.default_rng(0).integers(0, 256, (6, 8, 3), np.uint8), (96, 64))
WHOLE = [cv2.imencode(kind, PICTURE, parameters)[1].tobytes() for kind, parameters in (
    ('.jpg', ()), ('.jpg', (cv2.IMWRITE_JPEG_PROGRESSIVE, 1)), ('.jpg', (cv2.IMWRITE_JPEG_RST_INTERVAL, 2)),
    ('.png', ()))] + [hostile.animated_png(), hostile.png(9, 7, 16, 6),
                      hostile.png(9, 7, 2, 3, hostile.chunk(b'PLTE', bytes(12)))]

CHUNKS = [b'PLTE', b'tRNS', b'acTL', b'fcTL', b'fdAT', b'IDAT', b'IHDR', b'gAMA', b'iCCP', b'ABCD']


@pytest.fixture(scope='module')
def decoder():
    with DecoderProcess() as process:
        process.outcome(WHOLE[0])   # imports done
        yield process


@pytest.mark.parametrize('data', [
    hostile.png(5000, 5000, 8, 6), hostile.png(4082, 4082, 16, 2), hostile.flat_jpeg(5000, 5000, (0x11,) * 4),
    hostile.progressive_jpeg(3333, 3333, 36, hostile.COLOUR)],
    ids=['PNG with alpha', 'PNG of 48 bits', 'JPEG of four inks', 'JPEG of 36 scans'])
def test_the_largest_images_take_no_more_than_is_promised(data):
    """Each in a fresh process, as memory is its peak."""
    with DecoderProcess() as process:
        _, _, _, before = process.outcome(WHOLE[0])
        outcome, text, seconds, megabytes = process.outcome(data)
    assert outcome == 'ok', text
    assert seconds < MOST_SECONDS
    assert megabytes - before < MOST_MEGABYTES


@pytest.mark.parametrize('data', [
    hostile.png(100, 100, pixels=zlib.compress(bytes(1 << 28), 9)), hostile.png(6000, 6000, 16, 2),
    hostile.progressive_jpeg(640, 480, 1500),
    hostile.flat_jpeg(30000, 30000, before=b'\xff\xd0' + hostile.frame(8, 8)),
    hostile.flat_jpeg(8, 8, before=hostile.segment(0xFE, b'') * 500_000),
    hostile.png(8, 8, before=hostile.chunk(b'IDAT') * 500_000)],
    ids=['inflates to 256 MB', 'too large', '1,500 scans', 'two sizes', 'half a million comments', 'and chunks'])
def test_known_bombs_are_refused_at_once(decoder, data):
    outcome, text, seconds, megabytes = decoder.outcome(data)
    assert outcome == 'refused', text
    assert seconds < 1
    assert megabytes < 500


@pytest.mark.parametrize('region', [(1, 1, 0, 10000), (5000, 1, 2**32 - 4, 1), (4, 4, 0, 0), (0, 0, 0, 0)])
def test_animations_crash_nothing(decoder, region):
    """Each of the first two ended the process with OpenCV 4.11."""
    assert decoder.outcome(hostile.animated_png(region))[:2] == ('ok', '4 x 4')


@settings
@given(data=some.data())
def test_changed_images(decoder, data):
    image = bytearray(data.draw(some.sampled_from(WHOLE)))
    for _ in range(data.draw(some.integers(1, 4))):
        place = data.draw(some.integers(0, max(len(image) - 1, 0)))
        what = data.draw(some.sampled_from(['byte', 'cut', 'repeat', 'insert', 'marker', 'large']))
        if what == 'byte':
            image[place:place + 1] = bytes([data.draw(some.integers(0, 255))])
        elif what == 'cut':
            del image[place:place + data.draw(some.integers(1, 300))]
        elif what == 'repeat':
            image[place:place] = image[place:place + data.draw(some.integers(1, 300))]
        elif what == 'insert':
            image[place:place] = data.draw(some.binary(max_size=20))
        elif what == 'marker':
            image[place:place] = bytes([0xFF, data.draw(some.integers(0xC0, 0xFF))])
        else:
            image[place:place + 4] = data.draw(some.sampled_from([b'\xff\xff\xff\xff', b'\x7f\xff\xff\xff', bytes(4)]))
    _examine(decoder, bytes(image))


@settings
@given(sizes=some.tuples(some.integers(0, 65535), some.integers(0, 65535)),
       components=some.lists(some.integers(0, 0x55), min_size=0, max_size=5),
       segments=some.lists(some.tuples(some.integers(0xC0, 0xFE), some.binary(max_size=40)), max_size=5),
       pixels=some.binary(max_size=300), marker=some.sampled_from([0xC0, 0xC1, 0xC2, 0xC3, 0xC9]))
def test_made_up_jpegs(decoder, sizes, components, segments, pixels, marker):
    _examine(decoder, hostile.START + b''.join(hostile.segment(*each) for each in segments) + hostile.tables()
             + hostile.frame(*sizes, components, marker) + hostile.scan(range(1, len(components) + 1)) + pixels
             + hostile.END)


@settings
@given(header=some.tuples(some.integers(0, 2**32 - 1) | some.integers(0, 70), some.integers(0, 70),
                          *[some.sampled_from(values) for values in ([1, 2, 4, 8, 16, 3], [0, 2, 3, 4, 6, 1], [0, 1],
                                                                     [0, 1], [0, 1, 2])]),
       chunks=some.lists(some.tuples(some.sampled_from(CHUNKS), some.binary(max_size=60)), max_size=6),
       pixels=some.binary(max_size=100).map(zlib.compress)
       | some.integers(0, 9000).map(lambda count: zlib.compress(bytes(count))))
def test_made_up_pngs(decoder, header, chunks, pixels):
    _examine(decoder, hostile.PNG_SIGNATURE + hostile.chunk(b'IHDR', struct.pack('>IIBBBBB', *header))
             + b''.join(hostile.chunk(*each) for each in chunks) + hostile.chunk(b'IDAT', pixels)
             + hostile.chunk(b'IEND'))


def _examine(decoder, data):
    outcome, text, seconds, _ = decoder.outcome(data)
    assert outcome in ('ok', 'refused'), text
    assert seconds < MOST_SECONDS


# ---- Messages: pure Python and NumPy, in this process ----

BYTES = {'mono8': 1, 'bgr8': 3, 'rgba8': 4, 'mono16': 2, '16UC1': 2, '32FC1': 4, '64FC4': 32, '8SC2': 2,
         'bayer_rggb8': 1, 'yuv422': 2, '8UC512': 512, 'beige': 1, '': 1}   # of a pixel


@settings
@given(encoding=some.sampled_from(list(BYTES)), height=some.integers(0, 40), width=some.integers(0, 40),
       padding=some.integers(-3, 3), big_endian=some.integers(0, 255), data=some.binary(max_size=64),
       cut=some.integers(-1, 1))
def test_raw_messages(encoding, height, width, padding, big_endian, data, cut):
    step = max(width * BYTES[encoding] + padding, 0)
    size = max(height * step + cut, 0)
    message = sensor_msgs.msg.Image(height=height, width=width, encoding=encoding, is_bigendian=big_endian, step=step,
                                    data=(data * (size // max(len(data), 1) + 1))[:size])
    for wanted in ('bgr8', 'mono8', 'passthrough'):
        try:
            array = to_array(message, wanted)
        except ImageError:
            continue
        assert array.shape[:2] == (height, width)
        assert wanted == 'passthrough' or array.dtype == np.uint8
        assert cut in (0, -1) or not data


@settings
@given(data=some.binary(max_size=200), message_class=some.sampled_from(['Image', 'CompressedImage']))
def test_bytes_in_place_of_a_message(data, message_class):
    message = received(getattr(sensor_msgs.msg, message_class), 1.0)().deserialize(data)
    with pytest.raises(ImageError):
        to_array(message)


@settings
@given(format_text=some.text(max_size=40) | some.sampled_from(list(BYTES)).map('{}; jpeg compressed bgr8'.format),
       image=some.sampled_from(WHOLE[:4]))
def test_format_strings(format_text, image):
    try:
        array, encoding = unpack(sensor_msgs.msg.CompressedImage(format=format_text, data=image))
    except ImageError as error:
        text = str(error)
        assert len(text) < 300
    else:
        assert array.shape[:2] == (64, 96)
        again = unpack(to_compressed_message(array, encoding, format='png'))[0]
        np.testing.assert_array_equal(again, array)


def test_messages_serialized_and_back():
    """What a message of ours says on the wire is what it says after."""
    message = to_compressed_message(PICTURE, 'bgr8')
    wire = io.BytesIO()
    message.serialize(wire)
    read = received(sensor_msgs.msg.CompressedImage, 1.0)().deserialize(wire.getvalue())
    assert (read.problem, read.format, read.data) == ('', message.format, message.data)
