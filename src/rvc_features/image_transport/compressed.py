"""JPEG and PNG in sensor_msgs/CompressedImage: checked before decoding, and written as the C++ transport does."""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
import sensor_msgs.msg
from std_msgs.msg import Header

from rvc_features.image_transport.encodings import (
    COLOUR_OF_FOUR,
    COLOURS,
    OF_CHANNELS,
    YUV,
    ImageError,
    buffer,
    converted,
    fitting,
    layout,
    letters,
    recoloured,
)

COMPRESSED_FORMATS = ('jpeg', 'png')


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
    array = fitting(array, encoding)
    if array.dtype not in (np.uint8, np.uint16):
        raise ImageError(f'{encoding} images can not be compressed, only those of 8 or 16 unsigned bits')
    if encoding in YUV:
        array, encoding = converted(array, encoding, 'bgr8'), 'bgr8'
    encoding = COLOUR_OF_FOUR.get(encoding, encoding)
    bits, target = 8 * array.dtype.itemsize, ''
    if letters(encoding) in COLOURS:
        target = f'bgr{bits}'
        array = recoloured(array, encoding, target)
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


_JPEG, _PNG = b'\xff\xd8\xff', b'\x89PNG\r\n\x1a\n'   # first bytes
_MOST_PIXELS = 1 << 27   # above every camera, below what a corrupt header must not make the decoder allocate


def decompressed(message: Any, wanted: str) -> tuple[np.ndarray, str]:
    """The pixels of a sensor_msgs/CompressedImage and their encoding.

    For 'passthrough' that is the encoding which the format string declares; else one from which `wanted` is made at
    the least expense.
    """
    data = message.data if isinstance(message.data, bytes) else bytes(buffer(message.data))
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
    return (array, stored) if wanted != 'passthrough' else (recoloured(array, stored, encoding), encoding)


def _declared(format_text: str) -> tuple[str | None, bool]:
    """The encoding that a format string declares, if it does, and whether what was compressed had red first.

    `bgr8; jpeg compressed bgr8` is today's form, `jpeg` the old one. Without `rgb` in so many words blue comes first.
    """
    encoding, separator, rest = format_text.partition(';')
    encoding = encoding.strip()
    if not separator or encoding.lower() in ('jpeg', 'jpg', 'png', ''):
        return None, False
    return COLOUR_OF_FOUR.get(encoding, encoding), 'compressed rgb' in rest


def _reconciled(text: str, declared: str | None, is_rgb: bool, dtype: np.dtype, channels: int) -> tuple[str, str]:
    """Encoding of what was decoded, and that of the message; ImageError where the format string lies about it."""
    bits = 8 * dtype.itemsize
    stored = f'{OF_CHANNELS[channels]}{bits}'
    if declared is None:
        return stored, stored
    if is_rgb:
        stored = stored.replace('bgr', 'rgb')
    declared_dtype, declared_channels = layout(declared)
    lies = f'format {text!r} does not fit the data: {channels} channels of {bits} bits'
    if dtype != declared_dtype:
        raise ImageError(lies)
    if channels != 1 and declared in YUV:
        return stored, stored   # YUV is never what was compressed
    if channels != 1 and letters(declared) in COLOURS:
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
