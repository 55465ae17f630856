"""JPEG and PNG in sensor_msgs/CompressedImage: checked before decoding, and written as the C++ transport does."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import sensor_msgs.msg
from std_msgs.msg import Header

from rvc_features import still_images
from rvc_features.brief import shown
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
from rvc_features.still_images import MEGAPIXELS, Still, StillImageError, TooLargeError

COMPRESSED_FORMATS = ('jpeg', 'png')
_JPEG_SIDE = 65500   # pixels, of libjpeg


def to_compressed_message(array: np.ndarray, encoding: str, header: Header | None = None, format: str = 'jpeg',
                          jpeg_quality: int = 80, jpeg_progressive: bool = False, jpeg_optimize: bool = False,
                          jpeg_restart_interval: int = 0, png_level: int = 9) -> sensor_msgs.msg.CompressedImage:
    """A compressed image message of an array, with format string and pixels as the C++ transport writes them.

    Parameters
    ----------
    array, encoding, header
        As for `to_image_message`; 8 or 16 bits per channel.
    format : {'jpeg', 'png'}
        Images of 16 bits become PNG in any case, as JPEG has 8; where JPEG was wanted, quickly: of level 1.
    jpeg_quality : int, 1 to 100
    jpeg_progressive, jpeg_optimize : bool
    jpeg_restart_interval : int, 0 to 65535
        Blocks from one restart marker to the next, across which no damage spreads; 0 for none.
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
    bits, target = 8 * array.dtype.itemsize, ''
    if bits == 16 and format == 'jpeg':
        format, png_level = 'png', 1
    if format == 'jpeg':
        if max(array.shape[:2]) > _JPEG_SIDE:   # OpenCV would say so on the terminal too
            raise ImageError(f'{array.shape} {encoding} image can not become jpeg, which has at most {_JPEG_SIDE} '
                             'pixels a side')
        encoding = COLOUR_OF_FOUR.get(encoding, encoding)
    if letters(encoding) in COLOURS:
        target = f'bgr{bits}'
        array = recoloured(array, encoding, target)
    if format == 'jpeg':
        parameters = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality, cv2.IMWRITE_JPEG_PROGRESSIVE, int(jpeg_progressive),
                      cv2.IMWRITE_JPEG_OPTIMIZE, int(jpeg_optimize),
                      cv2.IMWRITE_JPEG_RST_INTERVAL, jpeg_restart_interval]
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


def decompressed(message: Any, wanted: str, megapixels: float = MEGAPIXELS) -> tuple[np.ndarray, str]:
    """The pixels of a sensor_msgs/CompressedImage and their encoding.

    For 'passthrough' that is the encoding which the format string declares; else one from which `wanted` is made at
    the least expense.
    """
    data = message.data if isinstance(message.data, bytes) else bytes(buffer(message.data))
    declared, is_rgb = _declared(message.format)
    try:
        still = still_images.check(data, megapixels)
        stored, encoding = _reconciled(message.format, declared, is_rgb, still)
        if wanted == 'mono8' and stored == 'bgr8' and still.kind == 'jpeg':
            # The luminance is what JPEG has at hand.
            return still_images.decode(still, cv2.IMREAD_GRAYSCALE), 'mono8'
        array = still_images.decode(still)
    except TooLargeError as error:
        raise ImageError(f'{error} (parameter ~most_megapixels)') from None
    except StillImageError as error:
        raise ImageError(f'{error} (format {shown(message.format)})') from None
    return (array, stored) if wanted != 'passthrough' else (recoloured(array, stored, encoding), encoding)


def _declared(format_text: str) -> tuple[str | None, bool]:
    """The encoding that a format string declares, if it does, and whether what was compressed had red first.

    `bgr8; jpeg compressed bgr8` is today's form, `jpeg` the old one. Without `rgb` in so many words blue comes first.
    """
    encoding, separator, rest = format_text.partition(';')
    encoding = encoding.strip()
    if not separator or encoding.lower() in ('jpeg', 'jpg', 'png', ''):
        return None, False
    return encoding, 'compressed rgb' in rest


def _reconciled(text: str, declared: str | None, is_rgb: bool, still: Still) -> tuple[str, str]:
    """Encoding of what will be decoded, and that of the message; ImageError where the format string lies about it."""
    channels, bits = still.channels, still.bits
    stored = f'{OF_CHANNELS[channels]}{bits}'
    if declared is None:
        return stored, stored
    if is_rgb:
        stored = stored.replace('bgr', 'rgb')
    if declared in COLOUR_OF_FOUR and channels < 4:
        declared = COLOUR_OF_FOUR[declared]   # a name that says what the fourth channel was
    declared_dtype, declared_channels = layout(declared)
    lies = f'format {shown(text)} does not fit the data: {channels} channels of {bits} bits'
    if declared_dtype == np.uint16 and bits == 8 and still.kind == 'jpeg':
        if 'compressed bgr8' not in text and 'compressed rgb8' not in text:
            raise ImageError(f'{lies}, as JPEG has them (where it is sent: dynparam set TOPIC/compressed format png)')
        return stored, f'{letters(declared)}8'   # C++ sends bgr16 like that, and says so
    if 8 * declared_dtype.itemsize != bits or declared_dtype.kind != 'u':
        raise ImageError(lies)
    if channels != 1 and declared in YUV:
        return stored, stored   # YUV is never what was compressed
    if channels != 1 and letters(declared) in COLOURS:
        return stored, declared
    if channels != declared_channels:
        raise ImageError(lies)
    return declared, declared
