"""JPEG and PNG data, checked before they are decoded, and decoded so that damage is noticed. No ROS, no files.

    still = still_images.check(data)       # StillImageError if it can't be decoded, or is too large
    image = still_images.decode(still)

What comes from outside is taken apart, and put together again from what a still image needs: nothing else reaches the
decoder. Animations, which crash that of OpenCV 4.11, are gone then, and whatever else lies between the pixels; and the
size is that which the decoder is going to find, because there is only one left that it could.
"""

from __future__ import annotations

import cv2
import numpy as np

from rvc_features.still_images import decoder_warnings, jpeg, png
from rvc_features.still_images.budget import MEGAPIXELS, Still, StillImageError, TooLargeError, check_size, most_bytes

__all__ = ['MEGAPIXELS', 'Still', 'StillImageError', 'TooLargeError', 'check', 'check_size', 'decode', 'kind',
           'most_bytes']


def kind(data: bytes) -> str | None:
    """'jpeg' or 'png', by the first bytes; None for everything else."""
    return 'jpeg' if data.startswith(b'\xff\xd8\xff') else 'png' if data.startswith(png.SIGNATURE) else None


def check(data: bytes, megapixels: float = MEGAPIXELS) -> Still:
    """Take a JPEG or PNG apart and put it together again from what a still image needs.

    Parameters
    ----------
    data : bytes
    megapixels : float
        How large the image may be. Counted are pixels, the bytes that decoding takes (4 per pixel of the limit), and
        the passes of a JPEG over its pixels.

    Returns
    -------
    Still

    Raises
    ------
    StillImageError
        When it is neither JPEG nor PNG, breaks off, is not made as these are, or is of a kind that isn't read: JPEG
        with 12 bits, arithmetic coding or without loss.
    TooLargeError
        When it is larger than `megapixels` allows; of the same class.
    """
    found = kind(data)
    if found is None:
        raise StillImageError(f'neither JPEG nor PNG: {len(data)} bytes that begin with {data[:8].hex() or "nothing"}')
    return (jpeg if found == 'jpeg' else png).checked(data, megapixels)


def decode(still: Still, flags: int = cv2.IMREAD_UNCHANGED) -> np.ndarray:
    """The pixels of an image that has been checked.

    Parameters
    ----------
    still : Still
    flags : int
        Of cv2.imdecode; default: as it is.

    Returns
    -------
    ndarray, shape (height, width) or (height, width, channels)

    Raises
    ------
    StillImageError
        When the decoder can't read it, or warns that it had to make something up. (A JPEG has no checksum: damage that
        leaves the code readable is seen by nobody.)
    """
    with decoder_warnings.heard() as heard:
        try:
            array = cv2.imdecode(np.frombuffer(still.data, np.uint8), flags)
        except cv2.error as error:
            raise StillImageError(f'corrupt {still.kind.upper()}: {error.err}') from None
    damage = heard.damage()
    if array is None or damage or array.shape[:2] != (still.height, still.width):
        raise StillImageError(f'corrupt {still.kind.upper()}: {damage or "the decoder can not read it"}')
    return array
