"""Images as messages and as arrays: the one place where they are checked, decoded, encoded and converted.

cv_bridge says what an encoding's type and channels are, and no more: in Python it ignores `step`, takes whatever it
decompresses for bgr8, and converts colours in four to nine times the time of cv2.cvtColor, with other threads waiting.
"""

from __future__ import annotations

import re
import struct
import sys
from typing import Any

import cv2
import genpy
import numpy as np
import sensor_msgs.msg
from cv_bridge import CvBridge, CvBridgeError
from std_msgs.msg import Header

COMPRESSED_FORMATS = ('jpeg', 'png')


class ImageError(ValueError):
    """An image that can't be used; the text says what is wrong with it."""


def to_array(message: Any, encoding: str = 'bgr8', writable: bool = False) -> np.ndarray:
    """The pixels of an image message.

    Parameters
    ----------
    message : sensor_msgs/Image or sensor_msgs/CompressedImage
    encoding : {'bgr8', 'mono8', 'passthrough'}
        What to convert to; 'passthrough' leaves the pixels as they are (`unpack` also tells how that is).
    writable : bool
        Whether the caller is going to draw on the result.

    Returns
    -------
    ndarray, shape (H, W) or (H, W, channels), in the machine's byte order and with rows next to each other
        For 'bgr8' and 'mono8' of dtype uint8. Where nothing had to be converted it is a view of the message's data,
        read-only as a rule; `writable=True` makes a copy in that case.

    Raises
    ------
    ImageError
        When anything about the message is wrong or unknown.

    Notes
    -----
    16-bit grey, colour and Bayer images keep their upper 8 bits. Other types (16UC1, 32FC1, ...) have no agreed white;
    they are stretched: the least valid value becomes 1, the greatest 255, and what is not valid 0. NaN and infinity
    are not valid, nor is 0 in integer types, which in a depth image says that nothing was measured (REP 118).
    """
    if encoding not in ('bgr8', 'mono8', 'passthrough'):
        raise ValueError(f'encoding must be bgr8, mono8 or passthrough; got {encoding!r}')
    array, stored = _decompressed(message, encoding) if hasattr(message, 'format') else _view(message)
    if encoding != 'passthrough':
        array = _converted(array, stored, encoding)
    return array.copy() if writable and not array.flags.writeable else array


def unpack(message: Any) -> tuple[np.ndarray, str]:
    """The pixels of an image message as they are, and their encoding; otherwise as `to_array`."""
    return _decompressed(message, 'passthrough') if hasattr(message, 'format') else _view(message)


def to_image_message(array: np.ndarray, encoding: str, header: Header | None = None) -> Image:
    """An image message of an array, without a copy where rows lie next to each other.

    Parameters
    ----------
    array : ndarray, shape (H, W) or (H, W, channels)
        Of the type and channels that the encoding says.
    encoding : str
        One of sensor_msgs/image_encodings.h.
    header : std_msgs/Header, optional

    Raises
    ------
    ImageError
        When array and encoding do not belong together.
    """
    array = _fitting(array, encoding)
    height, width = array.shape[:2]
    return Image(Header() if header is None else header, height, width, encoding, int(sys.byteorder == 'big'),
                 array.nbytes // height, array.data.cast('B'))


def to_compressed_message(array: np.ndarray, encoding: str, header: Header | None = None, format: str = 'jpeg',
                          jpeg_quality: int = 80, jpeg_progressive: bool = False, jpeg_optimize: bool = False,
                          png_level: int = 9) -> sensor_msgs.msg.CompressedImage:
    """A compressed image message of an array, with format string and pixels as the C++ transport writes them.

    Parameters
    ----------
    array, encoding, header
        As for `to_image_message`; 8 or 16 bits per channel.
    format : {'jpeg', 'png'}
        Images of 16 bits become PNG in any case, as JPEG has 8; where JPEG was wanted, quickly: of level 1.
    jpeg_quality : int, 1 to 100
    jpeg_progressive, jpeg_optimize : bool
    png_level : int, 1 to 9
        Higher is smaller and slower.

    Raises
    ------
    ImageError
        When array and encoding do not belong together or can't be compressed.
    """
    if format not in COMPRESSED_FORMATS:
        raise ValueError(f'format must be one of {", ".join(COMPRESSED_FORMATS)}; got {format!r}')
    array = _fitting(array, encoding)
    if array.dtype not in (np.uint8, np.uint16):
        raise ImageError(f'{encoding} images can not be compressed, only those of 8 or 16 unsigned bits')
    if encoding in _YUV:
        array, encoding = _converted(array, encoding, 'bgr8'), 'bgr8'
    encoding = _COLOUR_OF_FOUR.get(encoding, encoding)
    bits, target = 8 * array.dtype.itemsize, ''
    if _letters(encoding) in _COLOURS:
        target = f'bgr{bits}'
        array = _recoloured(array, encoding, target)
    if bits == 16 and format == 'jpeg':
        format, png_level = 'png', 1
    if format == 'jpeg':
        parameters = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality, cv2.IMWRITE_JPEG_PROGRESSIVE, int(jpeg_progressive),
                      cv2.IMWRITE_JPEG_OPTIMIZE, int(jpeg_optimize)]
    else:
        parameters = [cv2.IMWRITE_PNG_COMPRESSION, png_level]
    try:
        done, data = cv2.imencode('.jpg' if format == 'jpeg' else '.png', array, parameters)
    except cv2.error as error:
        raise ImageError(f'{array.shape} {encoding} image can not become {format}: {error.err}') from None
    if not done:
        raise ImageError(f'{array.shape} {encoding} image can not become {format}')
    return sensor_msgs.msg.CompressedImage(Header() if header is None else header,
                                           f'{encoding}; {format} compressed {target}', data.tobytes())


class Image(sensor_msgs.msg.Image):
    """sensor_msgs/Image whose pixels are copied neither when it arrives nor before it is sent.

    `data` is a memoryview where it was received, and may be any C-contiguous buffer where it is sent; that halves the
    time which large images spend in rospy.
    """

    def serialize(self, buff: Any) -> None:
        if isinstance(self.data, (bytes, list, tuple)):
            super().serialize(buff)
            return
        pixels = memoryview(self.data).cast('B')
        sensor_msgs.msg.Image(self.header, self.height, self.width, self.encoding, self.is_bigendian, self.step,
                              b'').serialize(buff)
        buff.seek(-4, 1)   # the length, 0 up to here
        buff.write(struct.pack('<I', pixels.nbytes))
        buff.write(pixels)

    def deserialize(self, buff: bytes | memoryview) -> Image:
        try:
            frame_id_length, = struct.unpack_from('<I', buff, 12)
            encoding_length, = struct.unpack_from('<I', buff, 24 + frame_id_length)
            start = 37 + frame_id_length + encoding_length
            length, = struct.unpack_from('<I', buff, start - 4)
        except struct.error as error:
            raise genpy.DeserializationError(error) from error
        super().deserialize(bytes(buff[:start - 4]) + bytes(4))
        self.data = memoryview(buff)[start:start + length]
        return self

    def __getstate__(self) -> list:
        # A memoryview can be neither copied with copy.deepcopy nor pickled.
        return [bytes(value) if isinstance(value, memoryview) else value for value in super().__getstate__()]


# Encodings --------------------------------------------------------------------------------------------------------

_YUV = {'yuv422': 'UYVY', 'yuv422_yuy2': 'YUY2'}   # OpenCV's names
_BAYER = {'bayer_rggb': 'BayerBG', 'bayer_bggr': 'BayerRG', 'bayer_gbrg': 'BayerGR', 'bayer_grbg': 'BayerGB'}
_COLOURS = ('bgr', 'rgb', 'bgra', 'rgba')
_OF_CHANNELS = {1: 'mono', 3: 'bgr', 4: 'bgra'}   # how OpenCV has images, and what generic encodings are taken for
_COLOUR_OF_FOUR = {'8UC4': 'bgra8', '16UC4': 'bgra16'}   # the fourth channel isn't compressed: a name brings it back
_GENERIC = re.compile(r'\d+[USF]C\d+')   # a type and a number of channels, but no word of what they mean
_bridge = CvBridge()


def _layout(encoding: str) -> tuple[np.dtype, int]:
    """Type and number of channels of an encoding."""
    try:
        dtype, channels = _bridge.encoding_to_dtype_with_channels('yuv422' if encoding in _YUV else encoding)
        if _GENERIC.fullmatch(encoding) and not encoding.endswith(f'C{channels}'):   # 8UC0, 8UC513
            raise CvBridgeError
    except CvBridgeError:
        raise ImageError(f'unknown encoding {encoding!r}') from None
    return np.dtype(dtype), channels


def _fitting(array: np.ndarray, encoding: str) -> np.ndarray:
    """The array in the machine's byte order and without gaps; ImageError where it isn't one of that encoding."""
    dtype, channels = _layout(encoding)
    shape = array.shape if array.ndim == 3 else (*array.shape, 1)
    if array.dtype.newbyteorder('=') != dtype or len(shape) != 3 or shape[2] != channels or array.size == 0:
        raise ImageError(f'{encoding} wants a non-empty {dtype} array of shape (height, width'
                         f'{f", {channels}" if channels > 1 else ""}); got {array.dtype} {array.shape}')
    return np.ascontiguousarray(array, dtype)


def _letters(encoding: str) -> str:
    return encoding.rstrip('0123456789')


def _converted(array: np.ndarray, encoding: str, target: str) -> np.ndarray:
    """Pixels of any encoding as bgr8 or mono8."""
    if _GENERIC.fullmatch(encoding):
        channels = 1 if array.ndim == 2 else array.shape[2]
        if channels not in _OF_CHANNELS:
            raise ImageError(f'{encoding} images have no conversion to {target}')
        array, encoding = array if array.dtype == np.uint8 else _stretched(array), f'{_OF_CHANNELS[channels]}8'
    elif array.dtype == np.uint16:
        array, encoding = (array >> 8).astype(np.uint8), f'{_letters(encoding)}8'
    return _recoloured(array, encoding, target)


def _recoloured(array: np.ndarray, encoding: str, target: str) -> np.ndarray:
    """Pixels of a named encoding as another one of the same depth."""
    if encoding == target:
        return array
    source, goal = _letters(encoding), _letters(target).upper().replace('MONO', 'GRAY')
    if encoding in _YUV:
        name = f'YUV2{goal}_{_YUV[encoding]}'
    else:
        name = f'{_BAYER.get(source) or source.upper().replace("MONO", "GRAY")}2{goal}'
    try:
        return cv2.cvtColor(array, getattr(cv2, f'COLOR_{name}'))
    except cv2.error as error:
        raise ImageError(f'{array.shape} {encoding} image can not become {target}: {error.err}') from None


def _stretched(array: np.ndarray) -> np.ndarray:
    """8-bit pixels of any others: valid values stretched over 1 to 255, the others 0."""
    flat = array.reshape(array.shape[0], -1)
    valid = np.isfinite(flat) if flat.dtype.kind == 'f' else flat != 0
    if not valid.any():
        return np.zeros(array.shape, np.uint8)
    stretched = np.zeros(flat.shape, np.uint8)
    cv2.normalize(flat, stretched, 1, 255, cv2.NORM_MINMAX, cv2.CV_8U, valid.astype(np.uint8))
    return stretched.reshape(array.shape)


# sensor_msgs/Image ------------------------------------------------------------------------------------------------

def _view(message: Any) -> tuple[np.ndarray, str]:
    """The pixels of a sensor_msgs/Image, checked, and their encoding."""
    dtype, channels = _layout(message.encoding)
    height, width, step = message.height, message.width, message.step
    row = width * channels * dtype.itemsize
    if height == 0 or width == 0:
        raise ImageError(f'image without pixels: {width} x {height}')
    if message.encoding in _YUV and width % 2:
        raise ImageError(f'{message.encoding} has pixels in pairs; got a width of {width}')
    if step < row:
        raise ImageError(f'step is {step}, but {width} pixels of {message.encoding} take {row} bytes')
    data = _buffer(message.data)
    if len(data) != height * step:
        raise ImageError(f'data has {len(data)} bytes, but {height} rows of {step} bytes make {height * step}')
    dtype = dtype.newbyteorder('>' if message.is_bigendian else '<')
    array: np.ndarray = np.ndarray((height, width, channels), dtype, data,
                                   strides=(step, channels * dtype.itemsize, dtype.itemsize))
    array = np.ascontiguousarray(array, dtype.newbyteorder('='))
    return array[:, :, 0] if channels == 1 else array, message.encoding


def _buffer(data: Any) -> memoryview:
    try:
        return memoryview(bytes(data) if isinstance(data, (list, tuple)) else data).cast('B')
    except (TypeError, ValueError) as error:
        raise ImageError(f'data must be bytes; got {type(data).__name__}: {error}') from None


# sensor_msgs/CompressedImage --------------------------------------------------------------------------------------

_JPEG, _PNG = b'\xff\xd8\xff', b'\x89PNG\r\n\x1a\n'   # first bytes
_MOST_PIXELS = 1 << 27   # above every camera, below what a corrupt header must not make the decoder allocate


def _decompressed(message: Any, wanted: str) -> tuple[np.ndarray, str]:
    """The pixels of a sensor_msgs/CompressedImage and their encoding.

    For 'passthrough' that is the encoding which the format string declares; else one from which `wanted` is made at
    the least expense.
    """
    data = message.data if isinstance(message.data, bytes) else bytes(_buffer(message.data))
    declared, is_rgb = _declared(message.format)
    if data.startswith(_JPEG):
        stored, encoding = _reconciled(message.format, declared, is_rgb, np.dtype(np.uint8), _jpeg_channels(data))
        if wanted == 'mono8' and stored == 'bgr8':
            # The luminance is what JPEG has at hand; IGNORE, as messages carry no other orientation than the sensor's.
            return _decoded(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION), 'mono8'
        array = _decoded(data, cv2.IMREAD_UNCHANGED)
    elif data.startswith(_PNG):
        _check_png(data)
        array = _decoded(data, cv2.IMREAD_UNCHANGED)
        channels = 1 if array.ndim == 2 else array.shape[2]
        stored, encoding = _reconciled(message.format, declared, is_rgb, array.dtype, channels)
    else:
        raise ImageError(f'neither JPEG nor PNG ({len(data)} bytes that begin with {data[:8].hex() or "nothing"}, '
                         f'format {message.format!r})')
    return (array, stored) if wanted != 'passthrough' else (_recoloured(array, stored, encoding), encoding)


def _declared(format_text: str) -> tuple[str | None, bool]:
    """The encoding that a format string declares, if it does, and whether what was compressed had red first.

    `bgr8; jpeg compressed bgr8` is today's form, `jpeg` the old one. Without `rgb` in so many words blue comes first.
    """
    encoding, separator, rest = format_text.partition(';')
    encoding = encoding.strip()
    if not separator or encoding.lower() in ('jpeg', 'jpg', 'png', ''):
        return None, False
    return _COLOUR_OF_FOUR.get(encoding, encoding), 'compressed rgb' in rest


def _reconciled(text: str, declared: str | None, is_rgb: bool, dtype: np.dtype, channels: int) -> tuple[str, str]:
    """Encoding of what was decoded, and that of the message; ImageError where the format string lies about it."""
    bits = 8 * dtype.itemsize
    stored = f'{_OF_CHANNELS[channels]}{bits}'
    if declared is None:
        return stored, stored
    if is_rgb:
        stored = stored.replace('bgr', 'rgb')
    declared_dtype, declared_channels = _layout(declared)
    lies = f'format {text!r} does not fit the data: {channels} channels of {bits} bits'
    if dtype != declared_dtype:
        raise ImageError(lies)
    if channels != 1 and declared in _YUV:
        return stored, stored   # YUV is never what was compressed
    if channels != 1 and _letters(declared) in _COLOURS:
        return stored, declared
    if channels != declared_channels:
        raise ImageError(lies)
    return declared, declared


def _decoded(data: bytes, flags: int) -> np.ndarray:
    try:
        array = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise ImageError(f'corrupt image data: {error.err}') from None
    if array is None:
        raise ImageError(f'corrupt image data ({len(data)} bytes)')
    return array


def _jpeg_channels(data: bytes) -> int:
    """Channels that the decoder makes of a JPEG; ImageError where it isn't complete or not of 8 bits.

    Only what the decoder would pass over is looked at: it fills up a file that breaks off with grey.
    """
    position, channels = 2, 0
    try:
        while data[position + 1] != 0xDA:   # start of the pixels
            marker, length = struct.unpack_from('>HH', data, position)
            if marker < 0xFFC0 or marker == 0xFFFF:
                position += 1   # fill bytes are allowed
                continue
            if 0xFFC0 <= marker <= 0xFFCF and marker not in (0xFFC4, 0xFFC8, 0xFFCC):   # frame header
                bits, height, width, components = struct.unpack_from('>BHHB', data, position + 4)
                if bits != 8:
                    raise ImageError(f'JPEG of {bits} bits; only 8 can be read, PNG has 16')
                _check_size(width, height)
                channels = 1 if components == 1 else 3
            position += 2 + length
    except (IndexError, struct.error):
        raise ImageError(f'corrupt JPEG: no image in its {len(data)} bytes') from None
    if channels == 0:
        raise ImageError('corrupt JPEG: pixels without a frame header')
    if data.rfind(b'\xff\xd9') < position:
        raise ImageError(f'truncated JPEG: no end after {len(data)} bytes')
    return channels


def _check_png(data: bytes) -> None:
    """ImageError for a PNG that breaks off: some decoders fill it up with black."""
    position, kind = len(_PNG), b''
    if len(data) >= 24:
        _check_size(*struct.unpack_from('>II', data, 16))
    while kind != b'IEND':
        if position + 12 > len(data):
            raise ImageError(f'truncated PNG: no end after {len(data)} bytes')
        length, kind = struct.unpack_from('>I4s', data, position)
        position += 12 + length


def _check_size(width: int, height: int) -> None:
    if width * height > _MOST_PIXELS:
        raise ImageError(f'corrupt image data: {width} x {height} pixels')
