"""Images as messages and as arrays: the way from the one to the other, with every message checked."""

from __future__ import annotations

import struct
import sys
from typing import Any

import genpy
import numpy as np
import sensor_msgs.msg
from std_msgs.msg import Header

from rvc_features.image_transport.compressed import decompressed
from rvc_features.image_transport.encodings import YUV, ImageError, buffer, converted, fitting, layout
from rvc_features.image_transport.whole_writes import HEADER, Piece, header_bytes
from rvc_features.still_images import MEGAPIXELS, TooLargeError, check_size

# Of sensor_msgs/Image, as it travels.
_SIZE = struct.Struct('<3I')     # height, width, length of the encoding
_LAYOUT = struct.Struct('<B2I')  # is_bigendian, step, length of the data


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
    array, stored = _pixels(whole(message), encoding)
    if encoding not in ('passthrough', stored):
        array = converted(array, stored, encoding)
    return array.copy() if writable and not array.flags.writeable else array


def unpack(message: Any) -> tuple[np.ndarray, str]:
    """The pixels of an image message as they are, and their encoding; otherwise as `to_array`."""
    return _pixels(whole(message), 'passthrough')


def whole(message: Any) -> Any:
    """The message, if it is one: ImageError for what a subscription of ours could not read."""
    problem = getattr(message, 'problem', '')
    if problem:
        raise ImageError(problem)
    return message


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
    array = fitting(array, encoding)
    height, width = array.shape[:2]
    return Image(Header() if header is None else header, height, width, encoding, int(sys.byteorder == 'big'),
                 array.nbytes // height, array.data.cast('B'))


class Image(sensor_msgs.msg.Image):
    """sensor_msgs/Image whose pixels are copied neither when it arrives nor before it is sent.

    `data` is a memoryview where it was received, and may be any C-contiguous buffer where it is sent; that halves the
    time which large images spend in rospy.
    """

    def pieces(self) -> list[Piece]:
        """Its bytes: all before the pixels, and the pixels where they are."""
        try:
            pixels = buffer(self.data)
            encoding = self.encoding.encode()
            return [b''.join((header_bytes(self.header), _SIZE.pack(self.height, self.width, len(encoding)), encoding,
                              _LAYOUT.pack(self.is_bigendian, self.step, pixels.nbytes))), pixels]
        except (struct.error, TypeError, ValueError, AttributeError) as error:
            raise genpy.SerializationError(f'not an image: {error}') from error

    def serialize(self, buff: Any) -> None:
        for piece in self.pieces():
            buff.write(piece)

    def deserialize(self, buff: bytes | memoryview) -> Image:
        header = self.header
        try:
            header.seq, header.stamp.secs, header.stamp.nsecs, length = HEADER.unpack_from(buff)
            header.frame_id, place = _text(buff, HEADER.size, length)
            self.height, self.width, length = _SIZE.unpack_from(buff, place)
            self.encoding, place = _text(buff, place + _SIZE.size, length)
            self.is_bigendian, self.step, length = _LAYOUT.unpack_from(buff, place)
        except struct.error as error:
            raise genpy.DeserializationError(error) from error
        place += _LAYOUT.size
        self.data = memoryview(buff)[place:place + length]
        return self

    def __getstate__(self) -> list:
        # A memoryview can be neither copied with copy.deepcopy nor pickled.
        return [bytes(value) if isinstance(value, memoryview) else value for value in super().__getstate__()]


def _text(buff: bytes | memoryview, place: int, length: int) -> tuple[str, int]:
    """The text of that length, as genpy reads it, and the place behind it."""
    return bytes(buff[place:place + length]).decode('utf-8', 'rosmsg'), place + length


def _pixels(message: Any, encoding: str) -> tuple[np.ndarray, str]:
    megapixels = getattr(message, 'megapixels', MEGAPIXELS)   # a subscription of ours says how large it may be
    return (decompressed(message, encoding, megapixels) if hasattr(message, 'format') else _view(message, megapixels))


def _view(message: Any, megapixels: float) -> tuple[np.ndarray, str]:
    """The pixels of a sensor_msgs/Image, checked, and their encoding."""
    dtype, channels = layout(message.encoding)
    height, width, step = message.height, message.width, message.step
    row = width * channels * dtype.itemsize
    if height == 0 or width == 0:
        raise ImageError(f'image without pixels: {width} x {height}')
    if message.encoding in YUV and width % 2:
        raise ImageError(f'{message.encoding} has pixels in pairs; got a width of {width}')
    if step < row:
        raise ImageError(f'step is {step}, but {width} pixels of {message.encoding} take {row} bytes')
    data = buffer(message.data)
    if len(data) != height * step:
        raise ImageError(f'data has {len(data)} bytes, but {height} rows of {step} bytes make {height * step}')
    try:
        check_size(width, height, megapixels, channels * dtype.itemsize)
    except TooLargeError as error:
        raise ImageError(f'{error} (parameter ~most_megapixels)') from None
    stored = dtype if dtype.itemsize == 1 else dtype.newbyteorder('>' if message.is_bigendian else '<')
    array: np.ndarray = np.ndarray((height, width, channels), stored, data,
                                   strides=(step, channels * dtype.itemsize, dtype.itemsize))
    array = np.ascontiguousarray(array, dtype)
    return array[:, :, 0] if channels == 1 else array, message.encoding
