"""Messages to arrays and back: colours of four quadrants through every encoding, and every way to be wrong."""

import copy
import io
import pickle
import struct
import subprocess
import sys
import zlib

import cv2
import numpy as np
import pytest
from quadrant_images import COLOURS, ENCODINGS, GREYS, SHAPE, centres, corners, quadrants

sensor_msgs = pytest.importorskip('sensor_msgs.msg')   # needs ROS's messages, though no master
std_msgs = pytest.importorskip('std_msgs.msg')

from rvc_features.image_transport import encodings  # noqa: E402
from rvc_features.image_transport.compressed import to_compressed_message  # noqa: E402
from rvc_features.image_transport.encodings import ImageError  # noqa: E402
from rvc_features.image_transport.messages import Image, to_array, to_image_message, unpack  # noqa: E402

HEADER = std_msgs.Header(7, None, 'camera')


def raw(array, encoding, padding=0, big_endian=False):
    """A plain sensor_msgs/Image, made by hand."""
    if big_endian:
        array = array.byteswap()
    rows = array.reshape(array.shape[0], -1).view(np.uint8)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=99)
    return sensor_msgs.Image(HEADER, array.shape[0], array.shape[1], encoding, int(big_endian), rows.shape[1],
                             rows.tobytes())


def compressed(array, format_text, extension, *parameters):
    """A CompressedImage as the C++ plugin or another writer makes it; `array` is what goes into the encoder."""
    return sensor_msgs.CompressedImage(HEADER, format_text, cv2.imencode(extension, array, parameters)[1].tobytes())


def as_the_plugin_writes(encoding, kind):
    """The C++ plugin's message: colours in the order BGR without alpha, everything else as it is."""
    array, target = quadrants(encoding), ''
    if encoding in ('bgr8', 'rgb8', 'bgra8', 'rgba8'):
        array, target = quadrants('bgr8'), 'bgr8'
    return compressed(array, f'{encoding}; {kind} compressed {target}', {'jpeg': '.jpg', 'png': '.png'}[kind])


LOSSLESS = [(encoding, 'png') for encoding in ENCODINGS]
LOSSY = [(encoding, 'jpeg') for encoding in ENCODINGS if encoding not in ('mono16', 'bayer_rggb8')]


class TestQuadrants:
    @pytest.mark.parametrize('padding', [0, 6])
    @pytest.mark.parametrize('encoding', ENCODINGS)
    def test_raw_keeps_pixels_and_has_the_colours(self, encoding, padding):
        array = quadrants(encoding)
        message = raw(array, encoding, padding)
        np.testing.assert_array_equal(to_array(message, 'passthrough'), array)
        bgr, grey = to_array(message, 'bgr8'), to_array(message, 'mono8')
        assert bgr.dtype == grey.dtype == np.uint8
        assert bgr.shape == (*SHAPE, 3)
        np.testing.assert_allclose(corners(grey), GREYS, atol=1)
        grey_only = encoding.startswith('mono')
        np.testing.assert_array_equal(corners(bgr), np.repeat(corners(grey)[:, None], 3, 1) if grey_only else COLOURS)

    @pytest.mark.parametrize('encoding', ['bayer_bggr8', 'bayer_gbrg8', 'bayer_grbg8', 'bayer_rggb8'])
    def test_every_bayer_pattern_has_its_own_colours(self, encoding):
        np.testing.assert_array_equal(corners(to_array(raw(quadrants(encoding), encoding))), COLOURS)

    @pytest.mark.parametrize(('encoding', 'kind'), LOSSLESS)
    def test_png_of_the_plugin_is_read_without_loss(self, encoding, kind):
        array, found = unpack(as_the_plugin_writes(encoding, kind))
        assert found == encoding
        np.testing.assert_array_equal(array, quadrants(encoding))

    @pytest.mark.parametrize(('encoding', 'kind'), LOSSY)
    def test_jpeg_of_the_plugin_is_read_with_its_colours(self, encoding, kind):
        array, found = unpack(as_the_plugin_writes(encoding, kind))
        assert found == encoding
        assert array.dtype == np.uint8
        np.testing.assert_allclose(corners(array), corners(quadrants(encoding)), atol=3)

    def test_bayer_jpeg_is_demosaiced_after_decoding(self):
        message = as_the_plugin_writes('bayer_rggb8', 'jpeg')
        assert unpack(message)[1] == 'bayer_rggb8'
        np.testing.assert_allclose(centres(to_array(message, 'bgr8')), COLOURS, atol=30)
        np.testing.assert_allclose(centres(to_array(message, 'mono8')), GREYS, atol=20)

    @pytest.mark.parametrize(('encoding', 'kind'), LOSSLESS + LOSSY)
    def test_what_we_write_is_what_the_plugin_writes(self, encoding, kind):
        ours = to_compressed_message(quadrants(encoding), encoding, HEADER, kind)
        theirs = as_the_plugin_writes(encoding, kind)
        assert ours.format == theirs.format
        assert ours.header is HEADER
        np.testing.assert_allclose(*(cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
                                     .astype(int) for message in (ours, theirs)), atol=80 if kind == 'jpeg' else 0)

    @pytest.mark.parametrize(('encoding', 'kind'), LOSSLESS + LOSSY)
    def test_through_compression_to_bgr_and_grey(self, encoding, kind):
        message = to_compressed_message(quadrants(encoding), encoding, HEADER, kind)
        np.testing.assert_allclose(corners(to_array(message, 'mono8')), GREYS, atol=3)
        if not encoding.startswith('mono'):
            np.testing.assert_allclose(corners(to_array(message, 'bgr8')), COLOURS, atol=3)

    @pytest.mark.parametrize('encoding', ENCODINGS)
    def test_to_message_and_back(self, encoding):
        array = quadrants(encoding)
        message = to_image_message(array, encoding, HEADER)
        assert (message.encoding, message.header, message.width, message.height) == (encoding, HEADER, 96, 64)
        assert message.step * message.height == len(message.data)
        np.testing.assert_array_equal(unpack(message)[0], array)

    @pytest.mark.parametrize(('encoding', 'code'), [('yuv422', (1, 0)), ('yuv422_yuy2', (0, 1))])
    def test_yuv422(self, encoding, code):
        bgr = quadrants('bgr8')
        yuv = cv2.cvtColor(bgr, cv2.COLOR_BGR2YUV)
        array = np.empty((*SHAPE, 2), np.uint8)
        luminance, colour = code
        array[..., luminance] = 16 + yuv[..., 0] * (219 / 255)
        # YCbCr of BT.601 in the range of video, by its definition
        b, g, r = (bgr[..., i] / 255 for i in range(3))
        array[:, 0::2, colour] = (128 - 37.797 * r - 74.203 * g + 112 * b)[:, 0::2]
        array[:, 1::2, colour] = (128 + 112 * r - 93.786 * g - 18.214 * b)[:, 0::2]
        message = raw(array, encoding)
        np.testing.assert_allclose(corners(to_array(message, 'bgr8')), COLOURS, atol=3)
        assert (np.diff(corners(to_array(message, 'mono8'))[[0, 2, 1, 3]]) > 20).all()
        sent = to_compressed_message(array, encoding)
        assert sent.format == 'bgr8; jpeg compressed bgr8'
        np.testing.assert_allclose(corners(to_array(sent)), COLOURS, atol=5)


class TestFormatStrings:
    @pytest.mark.parametrize('text', ['jpeg', 'jpg', 'JPEG', 'png', '', 'jpeg; whatever', 'bgr8; jpeg',
                                      'bgr8; jpeg compressed bgr8', 'bgr8;jpeg compressed bgr8',
                                      'bgr8; jpeg compressed ', 'bgr8; png compressed bgr8'])
    @pytest.mark.parametrize('extension', ['.jpg', '.png'])
    def test_colour_whatever_the_text_says_of_the_kind(self, text, extension):
        array, encoding = unpack(compressed(quadrants('bgr8'), text, extension))
        assert encoding == 'bgr8'
        np.testing.assert_allclose(corners(array), COLOURS, atol=3)

    @pytest.mark.parametrize('text', ['jpeg', 'png', '', 'mono8; jpeg compressed ', 'mono8; png compressed '])
    def test_grey(self, text):
        array, encoding = unpack(compressed(quadrants('mono8'), text, '.jpg'))
        assert encoding == 'mono8'
        np.testing.assert_allclose(corners(array), GREYS, atol=3)
        np.testing.assert_allclose(corners(to_array(compressed(quadrants('mono8'), text, '.jpg'), 'bgr8')),
                                   np.repeat(np.array(GREYS)[:, None], 3, 1), atol=3)

    def test_bare_png_keeps_its_alpha_and_its_bits(self):
        assert unpack(compressed(quadrants('bgra8'), 'png', '.png'))[1] == 'bgra8'
        assert unpack(compressed(quadrants('mono16'), 'png', '.png'))[1] == 'mono16'

    @pytest.mark.parametrize('encoding', ['bgr8', 'rgb8', 'bgra8', 'rgba8'])
    @pytest.mark.parametrize('kind', ['jpeg', 'png'])
    def test_red_first_in_the_encoder(self, encoding, kind):
        message = compressed(quadrants('rgb8'), f'{encoding}; {kind} compressed rgb8', '.jpg')
        array, found = unpack(message)
        assert found == encoding
        np.testing.assert_allclose(corners(array), corners(quadrants(encoding)), atol=3)
        np.testing.assert_allclose(corners(to_array(message, 'mono8')), GREYS, atol=3)

    @pytest.mark.parametrize(('encoding', 'stored'), [('bgr16', 'bgr8'), ('rgb16', 'rgb8'), ('bgra16', 'bgra8')])
    def test_a_jpeg_of_16_bits_as_the_cpp_plugin_writes_it(self, encoding, stored):
        """It has 8, and the second half of the text says so."""
        message = compressed(quadrants('bgr8'), f'{encoding}; jpeg compressed bgr8', '.jpg')
        array, found = unpack(message)
        assert (found, array.dtype) == (stored, np.uint8)
        np.testing.assert_allclose(corners(array), corners(quadrants(stored)), atol=3)
        np.testing.assert_allclose(corners(to_array(message, 'bgr8')), COLOURS, atol=3)

    def test_alpha_in_the_png_itself(self):
        array = quadrants('bgra8')
        array[..., 3] = 40
        message = compressed(array, 'rgba8; png compressed bgra8', '.png')
        np.testing.assert_array_equal(unpack(message)[0], array[..., [2, 1, 0, 3]])

    @pytest.mark.parametrize(('encoding', 'kind', 'text'), [
        ('8UC1', 'jpeg', '8UC1; jpeg compressed '), ('8UC3', 'jpeg', '8UC3; jpeg compressed '),
        ('8UC4', 'jpeg', 'bgra8; jpeg compressed bgr8'), ('8UC4', 'png', '8UC4; png compressed '),
        ('16UC4', 'jpeg', '16UC4; png compressed '), ('16UC1', 'png', '16UC1; png compressed '),
        ('bgr16', 'png', 'bgr16; png compressed bgr16'), ('rgba16', 'jpeg', 'rgba16; png compressed bgr16'),
        ('mono16', 'jpeg', 'mono16; png compressed ')])
    def test_written_for_rarer_encodings(self, encoding, kind, text):
        channels = {'bgr16': 3, 'rgba16': 4, 'mono16': 1}.get(encoding) or int(encoding[-1])
        array = np.full((16, 24, channels), 65535 if '16' in encoding else 255,
                        np.uint16 if '16' in encoding else np.uint8)
        array[:8] = np.arange(10, 10 * channels + 1, 10)[:channels] if channels < 4 else (10, 20, 30, array.max())
        if '4; png' in text:
            array[:8, :, 3] = 40   # a channel that colours would do without
        message = to_compressed_message(array, encoding, format=kind)
        assert message.format == text
        found, found_encoding = unpack(message)
        assert found_encoding == text.partition(';')[0]
        expected = array[..., 0] if channels == 1 else array
        np.testing.assert_allclose(found[[2, -3]].astype(int), expected[[2, -3]].astype(int),
                                   atol=0 if '16' in encoding else 4)

    def test_parameters_of_the_encoder_have_their_effect(self):
        picture = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (128, 128, 3), np.uint8), (0, 0), 2)

        def size(**parameters):
            return len(to_compressed_message(picture, 'bgr8', **parameters).data)

        assert size(jpeg_quality=10) < size(jpeg_quality=50) < size(jpeg_quality=95)
        assert size(jpeg_optimize=True) < size()
        assert size(format='png', png_level=9) < size(format='png', png_level=1)
        assert to_compressed_message(picture, 'bgr8', jpeg_restart_interval=4).data.count(b'\xff\xd3') == 2
        progressive = to_compressed_message(picture, 'bgr8', jpeg_progressive=True).data
        assert b'\xff\xc2' in progressive
        assert b'\xff\xc2' not in to_compressed_message(picture, 'bgr8').data[:1000]

    def test_orientation_in_exif_does_not_turn_the_image(self):
        message = compressed(quadrants('bgr8'), 'jpeg', '.jpg')
        exif = b'Exif\0\0MM\0*\0\0\0\x08' + struct.pack('>HHHIHHI', 1, 0x112, 3, 1, 6, 0, 0)
        message.data = message.data[:2] + b'\xff\xe1' + struct.pack('>H', 2 + len(exif)) + exif + message.data[2:]
        for encoding, expected in (('bgr8', COLOURS), ('mono8', GREYS)):
            array = to_array(message, encoding)
            assert array.shape[:2] == SHAPE
            np.testing.assert_allclose(corners(array), expected, atol=3)


def damaged(message, **changes):
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def jpeg(array=None):
    return compressed(quadrants('bgr8') if array is None else array, 'bgr8; jpeg compressed bgr8', '.jpg')


def png():
    return compressed(quadrants('bgr8'), 'bgr8; png compressed bgr8', '.png')


def in_twelve_bits(data):
    frame = data.index(b'\xff\xc0')
    return data[:frame + 4] + b'\x0c' + data[frame + 5:]


def enormous_jpeg():
    data = jpeg().data
    frame = data.index(b'\xff\xc0')
    return data[:frame + 5] + struct.pack('>HH', 32000, 32000) + data[frame + 9:]


def enormous_png():
    header = struct.pack('>4sIIBBBBB', b'IHDR', 2**31 - 1, 2**31 - 1, 8, 2, 0, 0, 0)
    chunks = b''.join(struct.pack('>I', len(chunk) - 4) + chunk + struct.pack('>I', zlib.crc32(chunk))
                      for chunk in (header, b'IDAT' + zlib.compress(bytes(100)), b'IEND'))
    return b'\x89PNG\r\n\x1a\n' + chunks


BAD = {
    'empty payload': (lambda: damaged(jpeg(), data=b''), '0 bytes'),
    'text': (lambda: damaged(jpeg(), data=b'not an image'), 'neither JPEG nor PNG'),
    'JPEG cut in the pixels': (lambda: damaged(jpeg(), data=jpeg().data[:-20]), 'truncated JPEG'),
    'JPEG cut in the header': (lambda: damaged(jpeg(), data=jpeg().data[:100]), 'truncated JPEG'),
    'JPEG of three bytes': (lambda: damaged(jpeg(), data=jpeg().data[:3]), 'truncated JPEG'),
    'JPEG of noise': (lambda: damaged(jpeg(), data=b'\xff\xd8\xff' + bytes(range(256)) * 9 + b'\xff\xd9'), 'JPEG'),
    'JPEG with its tables zeroed': (
        lambda: damaged(jpeg(), data=jpeg().data[:20] + bytes(300) + jpeg().data[320:]), 'JPEG|corrupt'),
    'JPEG of 12 bits': (lambda: damaged(jpeg(), data=in_twelve_bits(jpeg().data)), '12 bits'),
    'JPEG said to be of 16 bits': (
        lambda: damaged(jpeg(quadrants('mono8')), format='mono16; jpeg compressed '),
        'does not fit.*dynparam set TOPIC/compressed format png'),
    'PNG cut': (lambda: damaged(png(), data=png().data[:-30]), 'truncated PNG'),
    'PNG cut in the signature': (lambda: damaged(png(), data=png().data[:8]), 'truncated PNG'),
    'PNG with changed pixels': (
        lambda: damaged(png(), data=png().data[:60] + b'\0\1\2\3' + png().data[64:]), 'corrupt'),
    'PNG of four exabytes': (lambda: damaged(png(), data=enormous_png()), '2147483647 x 2147483647 pixels'),
    'JPEG of three gigabytes': (lambda: damaged(jpeg(), data=enormous_jpeg()), '32000 x 32000 pixels'),
    'colour said to be grey': (lambda: damaged(jpeg(), format='mono8; jpeg compressed '), 'does not fit'),
    'grey said to be colour': (lambda: damaged(jpeg(quadrants('mono8'))), 'does not fit'),
    '8 bits said to be 16': (lambda: damaged(png(), format='bgr16; png compressed bgr16'), 'does not fit'),
    'colour said to be a mosaic': (lambda: damaged(jpeg(), format='bayer_rggb8; jpeg compressed '), 'does not fit'),
    'encoding that is none': (lambda: damaged(jpeg(), format='beige8; jpeg compressed bgr8'), "unknown.*'beige8'"),
    'depth of compressedDepth': (
        lambda: damaged(png(), format='16UC1; compressedDepth', data=bytes(12) + png().data), 'neither JPEG nor PNG'),
    'list of floats for data': (lambda: damaged(jpeg(), data=[1.5, 2.5]), 'must be bytes'),
    'raw: unknown encoding': (lambda: raw(quadrants('mono8'), 'mono9'), "unknown.*'mono9'"),
    'raw: empty encoding': (lambda: raw(quadrants('mono8'), ''), "unknown.*''"),
    'raw: 8UC0': (lambda: raw(quadrants('mono8'), '8UC0'), 'unknown'),
    'raw: no height': (lambda: damaged(raw(quadrants('mono8'), 'mono8'), height=0, data=b''), '96 x 0'),
    'raw: no width': (lambda: damaged(raw(quadrants('mono8'), 'mono8'), width=0, step=0, data=b''), '0 x 64'),
    'raw: data too short': (lambda: damaged(raw(quadrants('bgr8'), 'bgr8'), data=bytes(1000)), '1000 bytes'),
    'raw: data too long': (lambda: damaged(raw(quadrants('mono8'), 'mono8'), data=bytes(96 * 64 + 1)), '6145 bytes'),
    'raw: no data': (lambda: damaged(raw(quadrants('mono8'), 'mono8'), data=b''), '0 bytes'),
    'raw: step too short': (
        lambda: damaged(raw(quadrants('bgr8'), 'bgr8'), step=96, data=bytes(96 * 64)), 'step is 96'),
    'raw: no step': (lambda: damaged(raw(quadrants('bgr8'), 'bgr8'), step=0), 'step is 0'),
    'raw: as large as can be said': (
        lambda: damaged(raw(quadrants('bgr8'), 'bgr8'), width=2**32 - 1, height=2**32 - 1), 'step'),
    'raw: huge and empty': (
        lambda: damaged(raw(quadrants('mono8'), 'mono8'), width=65535, height=2**32 - 1, step=65535), 'bytes'),
    'raw: yuv422 of odd width': (lambda: raw(np.zeros((2, 3, 2), np.uint8), 'yuv422'), 'width of 3'),
    'raw: two channels': (lambda: raw(np.zeros((2, 3, 2), np.uint8), '8UC2'), 'no conversion'),
}


@pytest.mark.parametrize('wanted', ['bgr8', 'mono8'])
@pytest.mark.parametrize('name', BAD)
def test_bad_image(name, wanted, capfd):
    make, text = BAD[name]
    with pytest.raises(ImageError, match=text):
        to_array(make(), wanted)


def test_values_from_outside_are_cut_before_they_are_shown():
    long = 'x' * 20_000_000
    for message in (raw(quadrants('mono8'), long), damaged(jpeg(), format=long),
                    damaged(jpeg(), format=f'{long}; jpeg'), damaged(png(), format=f'mono8;{long}'),
                    damaged(png(), format=long, data=b'')):
        refused = []
        try:
            to_array(message)
        except ImageError as error:
            refused.append(str(error))
        assert len(''.join(refused)) < 300


def test_a_lie_about_png_or_jpeg_is_harmless():
    message = damaged(png(), format='bgr8; jpeg compressed bgr8')
    np.testing.assert_array_equal(to_array(message), quadrants('bgr8'))


class TestDepth:
    def test_float_depth_is_stretched_over_its_finite_values(self):
        depth = np.array([[np.nan, 1.0, 2.0], [3.0, np.inf, -np.inf]], np.float32)
        np.testing.assert_array_equal(to_array(raw(depth, '32FC1'), 'mono8'), [[0, 1, 128], [255, 0, 0]])
        np.testing.assert_array_equal(to_array(raw(depth, '32FC1'), 'bgr8')[1, 0], [255, 255, 255])

    def test_in_integer_depth_zero_is_not_a_value(self):
        depth = np.array([[0, 1000, 2000], [3000, 0, 1000]], np.uint16)
        np.testing.assert_array_equal(to_array(raw(depth, '16UC1'), 'mono8'), [[0, 1, 128], [255, 0, 1]])

    @pytest.mark.parametrize('depth', [np.full((3, 4), np.nan, np.float32), np.full((3, 4), np.inf, np.float32)])
    def test_nothing_measured_is_black(self, depth):
        assert not to_array(raw(depth, '32FC1'), 'mono8').any()

    @pytest.mark.parametrize(('value', 'dtype', 'encoding'), [(3.0, np.float32, '32FC1'), (9, np.uint16, '16UC1')])
    def test_one_distance_everywhere_is_one_grey(self, value, dtype, encoding):
        assert len(np.unique(to_array(raw(np.full((3, 4), value, dtype), encoding), 'mono8'))) == 1

    def test_passthrough_is_untouched(self):
        depth = np.array([[np.nan, 1.0], [np.inf, 3.0]], np.float32)
        np.testing.assert_array_equal(to_array(raw(depth, '32FC1'), 'passthrough'), depth)

    @pytest.mark.parametrize(('encoding', 'dtype'), [('8SC1', np.int8), ('16SC1', np.int16), ('32SC1', np.int32),
                                                     ('64FC1', np.float64)])
    def test_other_types(self, encoding, dtype):
        array = np.array([[-5, 15], [10, 35]], dtype)
        np.testing.assert_array_equal(to_array(raw(array, encoding), 'mono8'), [[1, 128], [96, 255]])

    def test_mono16_keeps_its_upper_bits(self):
        array = np.array([[0, 255, 256], [0x7FFF, 0xFF00, 0xFFFF]], np.uint16)
        np.testing.assert_array_equal(to_array(raw(array, 'mono16'), 'mono8'), [[0, 0, 1], [127, 255, 255]])


class TestBytes:
    @pytest.mark.parametrize(('encoding', 'dtype'), [('mono16', np.uint16), ('16UC1', np.uint16),
                                                     ('32FC1', np.float32)])
    def test_byte_order(self, encoding, dtype):
        array = np.arange(1, 13).reshape(3, 4).astype(dtype)
        found = to_array(raw(array, encoding, 2 if dtype == np.uint16 else 4, big_endian=True), 'passthrough')
        assert found.dtype.isnative
        np.testing.assert_array_equal(found, array)

    def test_byte_order_means_nothing_for_bytes(self):
        message = damaged(raw(quadrants('bgr8'), 'bgr8'), is_bigendian=1)
        np.testing.assert_array_equal(to_array(message), quadrants('bgr8'))

    @pytest.mark.parametrize('kind', [bytes, bytearray, memoryview, list, tuple,
                                      lambda data: np.frombuffer(data, np.uint8)])
    def test_kinds_of_data(self, kind):
        message = raw(quadrants('bgr8'), 'bgr8')
        message.data = kind(message.data)
        np.testing.assert_array_equal(to_array(message), quadrants('bgr8'))
        message = png()
        message.data = kind(message.data)
        np.testing.assert_array_equal(to_array(message), quadrants('bgr8'))

    def test_no_copy_where_none_is_needed(self):
        message = raw(quadrants('bgr8'), 'bgr8')
        for encoding in ('bgr8', 'passthrough'):
            array = to_array(message, encoding)
            assert np.shares_memory(array, np.frombuffer(message.data, np.uint8))
            assert not array.flags.writeable
        array = quadrants('bgr8')
        assert np.shares_memory(np.frombuffer(to_image_message(array, 'bgr8').data, np.uint8), array)

    def test_writable_does_not_write_into_the_message(self):
        message = raw(quadrants('bgr8'), 'bgr8')
        array = to_array(message, writable=True)
        array[:] = 1
        np.testing.assert_array_equal(to_array(message), quadrants('bgr8'))

    @pytest.mark.parametrize('make', [lambda: raw(quadrants('rgb8'), 'rgb8'), jpeg])
    def test_what_was_converted_is_writable_without_another_copy(self, make):
        assert to_array(make(), 'bgr8').flags.writeable

    def test_array_with_gaps_becomes_a_message(self):
        wide = np.zeros((64, 200, 3), np.uint8)
        wide[:, :96] = quadrants('bgr8')
        np.testing.assert_array_equal(to_array(to_image_message(wide[:, :96], 'bgr8')), quadrants('bgr8'))

    @pytest.mark.parametrize(('array', 'encoding'), [
        (np.zeros((4, 4), np.uint8), 'bgr8'), (np.zeros((4, 4, 3), np.uint8), 'mono8'),
        (np.zeros((4, 4), np.float32), 'mono8'), (np.zeros((0, 4), np.uint8), 'mono8'),
        (np.zeros(4, np.uint8), 'mono8'), (np.zeros((4, 4), np.uint8), 'sepia8')])
    def test_array_that_is_not_of_the_encoding(self, array, encoding):
        for convert in (to_image_message, to_compressed_message):
            with pytest.raises(ImageError, match=encoding):
                convert(array, encoding)

    @pytest.mark.parametrize(('array', 'encoding'), [
        (np.zeros((4, 4), np.float32), '32FC1'), (np.zeros((4, 4), np.int8), '8SC1'),
        (np.zeros((4, 4, 2), np.uint8), '8UC2'), (np.zeros((2, 70000), np.uint8), 'mono8')])
    def test_array_that_can_not_be_compressed(self, array, encoding, capfd):
        with pytest.raises(ImageError, match=encoding):
            to_compressed_message(array, encoding)

    def test_unknown_target(self):
        with pytest.raises(ValueError, match='hsv8'):
            to_array(png(), 'hsv8')


def test_usual_encodings_are_what_cv_bridge_says():
    for encoding in encodings._USUAL:
        assert encodings.layout(encoding) == encodings._layout_of_cv_bridge(encoding)


def test_usual_images_do_not_load_cv_bridge():
    code = ('import sys, numpy; from rvc_features.image_transport import messages\n'
            'for encoding in ("bgr8", "mono8"):\n'
            '    image = numpy.ones((4, 5, 3) if encoding == "bgr8" else (4, 5), numpy.uint8)\n'
            '    messages.to_array(messages.to_image_message(image, encoding), "bgr8")\n'
            'assert "cv_bridge" not in sys.modules')
    subprocess.run([sys.executable, '-c', code], check=True)


class TestLeanImage:
    def wire(self, message):
        buffer = io.BytesIO()
        message.serialize(buffer)
        return buffer.getvalue()

    @pytest.mark.parametrize('frame', ['', 'camera', 'kämera'])
    def test_same_bytes_as_the_original(self, frame):
        plain = raw(quadrants('rgb8'), 'rgb8', padding=4)
        plain.header.frame_id = frame
        lean = Image(*(getattr(plain, name) for name in plain.__slots__))
        expected = self.wire(plain)
        assert self.wire(lean) == expected
        for kind in (memoryview, bytearray, list, lambda data: np.frombuffer(data, np.uint8)):
            lean.data = kind(plain.data)
            assert self.wire(lean) == expected
        read = Image().deserialize(expected)
        assert isinstance(read.data, memoryview)
        assert [bytes(value) if isinstance(value, memoryview) else value
                for value in (getattr(read, name) for name in plain.__slots__)] == \
            [getattr(plain, name) for name in plain.__slots__]
        assert (read._md5sum, read._type) == (plain._md5sum, plain._type)

    def test_copies(self):
        message = Image().deserialize(self.wire(raw(quadrants('bgr8'), 'bgr8')))
        for copied in (copy.deepcopy(message), pickle.loads(pickle.dumps(message))):
            np.testing.assert_array_equal(to_array(copied), quadrants('bgr8'))

    @pytest.mark.parametrize('length', [0, 3, 11, 20, 30, 45])
    def test_cut_off(self, length):
        genpy = pytest.importorskip('genpy')
        data = self.wire(raw(quadrants('bgr8'), 'bgr8'))
        with pytest.raises(genpy.DeserializationError):
            Image().deserialize(data[:length])
