"""PNG taken apart and put together again: ISO/IEC 15948."""

from __future__ import annotations

import struct
import zlib
from typing import Iterator

from rvc_features.still_images.budget import Still, StillImageError, TooLargeError, check_size

SIGNATURE = b'\x89PNG\r\n\x1a\n'
_MOST_CHUNKS = 1 << 16
_COLOUR_TYPES = {0: (1, {1, 2, 4, 8, 16}), 2: (3, {8, 16}), 3: (1, {1, 2, 4, 8}), 4: (2, {8, 16}), 6: (4, {8, 16})}
_PASSES_OF_ADAM = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
_CHUNK = 1 << 20         # bytes; the decoder warns of much larger ones


def checked(data: bytes, megapixels: float) -> Still:
    """As `still_images.check`, of data that begin like a PNG."""
    header: tuple[int, ...] = ()
    tables: dict[bytes, bytes] = {}
    pixels: list[bytes] = []
    for name, body in _chunks(data):
        if not header:
            header = _png_header(name, body)
            check_size(header[0], header[1], megapixels)
        elif name == b'IDAT':
            pixels.append(body)
        elif name in (b'PLTE', b'tRNS') and name not in tables:
            tables[name] = _chunk(name, body)
        elif name != b'IEND' and not name[0] & 0x20:   # a capital letter: nobody may read on who doesn't know it
            raise StillImageError(f'corrupt PNG: chunk {name!r}, unknown or once too often')
    width, height, bits, colour = header[:4]
    samples = _COLOUR_TYPES[colour][0]
    channels = 1 if colour == 0 else 4 if colour > 3 else 3 + (b'tRNS' in tables)   # as OpenCV makes them
    decoded_bits = max(bits, 8)
    check_size(width, height, megapixels, max(samples, channels) * decoded_bits / 8)
    # Stored, not compressed again: it costs no more time in all, as the decoder has only to copy it then.
    size = _inflated_size(width, height, samples * bits, interlaced=bool(header[6]))
    stored = zlib.compress(_inflated(b''.join(pixels), size), 0)
    rewritten = (_chunk(b'IDAT', stored[begin:begin + _CHUNK]) for begin in range(0, len(stored), _CHUNK))
    return Still(b''.join((SIGNATURE, _chunk(b'IHDR', struct.pack('>IIBBBBB', *header)), *tables.values(), *rewritten,
                           _chunk(b'IEND', b''))), 'png', width, height, channels, decoded_bits)


def _png_header(name: bytes, body: bytes) -> tuple[int, ...]:
    if name != b'IHDR' or len(body) != 13:
        raise StillImageError(f'corrupt PNG: begins with {len(body)} bytes of {name!r} instead of a header of 13')
    width, height, bits, colour, compression, filtering, interlace = header = struct.unpack('>IIBBBBB', body)
    if (bits not in _COLOUR_TYPES.get(colour, (0, set()))[1] or compression or filtering or interlace > 1
            or width == 0 or height == 0):
        raise StillImageError(f'corrupt PNG: {width} x {height} pixels of type {colour} with {bits} bits, methods '
                              f'{compression}, {filtering} and {interlace}')
    return header


def _inflated_size(width: int, height: int, bits_per_pixel: int, interlaced: bool) -> int:
    """Bytes of all rows, with one for the filter before each."""
    size = 0
    for left, top, across, down in _PASSES_OF_ADAM if interlaced else ((0, 0, 1, 1),):
        columns, rows = -(-(width - left) // across), -(-(height - top) // down)
        size += rows * (1 + -(-columns * bits_per_pixel // 8)) if columns > 0 else 0
    return size


def _inflated(pixels: bytes, size: int) -> bytes:
    """The rows. No more than there should be: 10 MB may hold 10 GB, and the decoder would go through all of them."""
    inflate = zlib.decompressobj()
    try:
        rows = inflate.decompress(pixels, size + 1)
    except zlib.error as error:
        raise StillImageError(f'corrupt PNG: {error}') from None
    if len(rows) != size or not inflate.eof:
        raise StillImageError(f'corrupt PNG: {"more than " * (len(rows) > size)}{min(len(rows), size)} bytes of pixels '
                              f'instead of {size}')
    return rows


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Name and contents of each chunk that a still image may have, up to the last; others only if they are vital."""
    position = len(SIGNATURE)
    for _ in range(_MOST_CHUNKS):
        if position + 12 > len(data):
            break
        length, name = struct.unpack_from('>I4s', data, position)
        end = position + 12 + length
        if end > len(data):
            break
        if name == b'tRNS' or not name[0] & 0x20:
            if zlib.crc32(data[position + 4:end - 4]) != int.from_bytes(data[end - 4:end], 'big'):
                raise StillImageError(f'corrupt PNG: checksum of {name!r} at byte {position}')
            yield name, data[position + 8:end - 4]
        if name == b'IEND':
            return
        position = end
    else:
        raise TooLargeError(f'PNG of more than {_MOST_CHUNKS} chunks')
    raise StillImageError(f'truncated PNG: no end after {len(data)} bytes')


def _chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack('>I', len(body)) + name + body + struct.pack('>I', zlib.crc32(name + body))
