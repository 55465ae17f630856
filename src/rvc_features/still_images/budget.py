"""What an image may cost, and what is said of one that costs more or can't be read."""

from __future__ import annotations

import dataclasses

MEGAPIXELS = 25.0
"""How large an image may be if nobody says otherwise: most cameras of machines pass (24 megapixels and less), and the
worst that a message of 10 MB can hold takes less than 3 s and 1.5 GB from message to key points."""

_LEAST_SIDE = 256        # pixels; narrower images are counted as if they were that wide, as each row costs something
_BYTES = 4               # per pixel of the limit, when decoded: BGRA, or progressive JPEG in grey with its coefficients
_PASSES = 16             # how many scans of a JPEG an image as large as the limit may have; smaller ones more
_MOST_SCANS = 100        # however small; encoders write about ten


class StillImageError(ValueError):
    """Data that are no image to be decoded; the text says what is wrong with them."""


class TooLargeError(StillImageError):
    """An image that would take more memory or time than was allowed."""


@dataclasses.dataclass(frozen=True)
class Still:
    """An image that may be decoded.

    Attributes
    ----------
    data : bytes
        What the decoder gets.
    kind : {'jpeg', 'png'}
    width, height : int
        In pixels.
    channels, bits : int
        Of what `decode` makes of it, as it is: 1, 3 (BGR) or 4 (BGRA) channels of 8 or 16 bits.
    """

    data: bytes
    kind: str
    width: int
    height: int
    channels: int
    bits: int


def check_size(width: int, height: int, megapixels: float, bytes_per_pixel: float = 0.0, passes: int = 1) -> None:
    """TooLargeError for an image of that size, where `megapixels` are allowed; the same for every kind of image."""
    most = 1e6 * megapixels
    pixels = max(width, _LEAST_SIDE) * max(height, _LEAST_SIDE)
    limit = f'more than {megapixels:g} megapixels'
    if pixels > most:
        raise TooLargeError(f'{width} x {height} pixels: {limit}')
    if width * height * bytes_per_pixel > _BYTES * most:
        raise TooLargeError(f'{width} x {height} pixels of {bytes_per_pixel:g} bytes: {limit} of {_BYTES} bytes')
    if passes > _MOST_SCANS or pixels * passes > _PASSES * most:
        raise TooLargeError(f'JPEG of {passes} scans over {width} x {height} pixels: '
                            f'more than {_MOST_SCANS}, or than {_PASSES} over {megapixels:g} megapixels')


def most_bytes(megapixels: float) -> int:
    """What the pixels of an image of that limit may take."""
    return int(_BYTES * 1e6 * megapixels)
