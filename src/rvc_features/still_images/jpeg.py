"""JPEG taken apart and put together again: ITU-T T.81, annex B."""

from __future__ import annotations

import dataclasses
import re
import struct

from rvc_features.still_images.budget import Still, StillImageError, TooLargeError, check_size

_MOST_SEGMENTS = 1000
_MARKER = re.compile(rb'\xff[^\x00\xff\xd0-\xd7]')   # 255 followed by 0 is a byte of pixels, D0 to D7 are restarts
_FILL = re.compile(rb'\xff+')
_BARE = {0x01, *range(0xD0, 0xD8)}                    # markers without a length
_TABLES = {0xC4, 0xDB, 0xDD}                          # Huffman, quantisation, restart interval
_READ_FRAMES = {0xC0, 0xC1, 0xC2}                     # baseline, extended, progressive
_OTHER_FRAMES = {0xC3, *range(0xC5, 0xD0)} - {0xC8, 0xCC}
_DROPPED = {0xCC, 0xDC, *range(0xE0, 0xF0), 0xFE}     # conditions of arithmetic coding, lines, applications, comments
_JFIF = b'\xff\xe0\0\x10JFIF\0\1\1\0\0\1\0\1\0\0'     # it and Adobe's decide what the channels mean


def checked(data: bytes, megapixels: float) -> Still:
    """As `still_images.check`, of data that begin like a JPEG."""
    frame: _Frame | None = None
    parts, scans, position = [data[:2]], 0, 2
    for _ in range(_MOST_SEGMENTS):
        fill = _FILL.match(data, position)
        if fill is None or fill.end() == len(data):
            raise StillImageError(f'{_breaks_off(data, position)}: no segment at byte {position} of {len(data)}')
        marker, position = data[fill.end()], fill.end() + 1
        if marker in _BARE:
            continue
        if marker == 0xD9:
            break
        body, position = _segment(data, marker, position)
        if marker == 0xDA:
            if frame is None:
                raise StillImageError('corrupt JPEG: pixels without a frame header')
            scans += 1
            check_size(frame.width, frame.height, megapixels, frame.bytes_per_pixel(scans), scans)
            end = _MARKER.search(data, position)
            if end is None:
                raise StillImageError(f'truncated JPEG: no end after {len(data)} bytes')
            selection = body if frame.progressive else body[:-3] + b'\0\x3f\0'   # some cameras leave it out
            parts += [_written(marker, selection), data[position:end.start()]]
            position = end.start()
        elif marker in _READ_FRAMES:
            if frame is not None:
                raise StillImageError('corrupt JPEG: two frame headers')
            frame = _frame(marker, body)
            check_size(frame.width, frame.height, megapixels)
            parts.append(_written(marker, body))
        elif marker in _TABLES:
            parts.append(_written(marker, body))
        elif marker == 0xE0 and body.startswith(b'JFIF\0'):
            parts.append(_JFIF)
        elif marker == 0xEE and body.startswith(b'Adobe') and len(body) >= 12:
            parts.append(_written(marker, body[:12]))
        elif marker in _OTHER_FRAMES:
            raise StillImageError(f'JPEG of a kind (SOF{marker - 0xC0}) that is not read: only baseline, extended and '
                                  'progressive with Huffman coding are')
        elif marker not in _DROPPED:
            raise StillImageError(f'corrupt JPEG: unknown segment {marker:02x} before byte {position}')
    else:
        raise TooLargeError(f'JPEG of more than {_MOST_SEGMENTS} segments')
    if frame is None or scans == 0:
        raise StillImageError('corrupt JPEG: it ends before any pixels')
    return Still(b''.join((*parts, b'\xff\xd9')), 'jpeg', frame.width, frame.height, frame.channels, 8)


@dataclasses.dataclass(frozen=True)
class _Frame:
    """A frame header."""

    width: int
    height: int
    samplings: tuple[tuple[int, int], ...]   # horizontal and vertical, of each component
    progressive: bool

    @property
    def channels(self) -> int:
        """Of what the decoder makes of it; four components are inks, which it mixes."""
        return 1 if len(self.samplings) == 1 else 3

    def bytes_per_pixel(self, scans: int) -> float:
        """Memory that decoding takes: the pixels, and the coefficients if it must keep them from scan to scan."""
        if scans == 1 and not self.progressive:
            return self.channels
        largest = max(x for x, _ in self.samplings) * max(y for _, y in self.samplings)
        return self.channels + 2 * sum(x * y for x, y in self.samplings) / largest


def _breaks_off(data: bytes, position: int) -> str:
    return 'truncated JPEG' if position >= len(data) - 1 else 'corrupt JPEG'


def _segment(data: bytes, marker: int, position: int) -> tuple[bytes, int]:
    """What a segment holds, and where the next one begins."""
    length = int.from_bytes(data[position:position + 2], 'big')
    end = position + length
    if length < 2:
        raise StillImageError(f'corrupt JPEG: segment {marker:02x} of {length} bytes')
    if end > len(data):
        raise StillImageError(f'truncated JPEG: segment {marker:02x} of {length} bytes, {len(data) - position} left')
    return data[position + 2:end], end


def _written(marker: int, body: bytes) -> bytes:
    return struct.pack('>BBH', 0xFF, marker, len(body) + 2) + body


def _frame(marker: int, body: bytes) -> _Frame:
    if len(body) < 6 or len(body) != 6 + 3 * body[5]:
        raise StillImageError(f'corrupt JPEG: frame header of {len(body)} bytes')
    bits, height, width, components = struct.unpack_from('>BHHB', body)
    if bits != 8:
        raise StillImageError(f'JPEG of {bits} bits; only 8 can be read, PNG has 16')
    samplings = tuple((each >> 4, each & 15) for each in body[7::3])
    if components not in (1, 3, 4) or not all(1 <= x <= 4 and 1 <= y <= 4 for x, y in samplings):
        raise StillImageError(f'corrupt JPEG: {components} components sampled {samplings}')
    if width == 0 or height == 0:
        raise StillImageError(f'corrupt JPEG: {width} x {height} pixels')
    return _Frame(width, height, samplings, marker == 0xC2)
