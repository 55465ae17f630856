"""Grey images from disk, or an error that names the file: OpenCV alone returns the upper half of a truncated JPEG."""

from __future__ import annotations

import os

import cv2
import numpy as np

EXTENSIONS = ('.png', '.jpg', '.jpeg', '.ppm', '.pgm', '.bmp', '.tif', '.tiff', '.webp')

ACCEPTED = f'accepted are whole image files ({", ".join(EXTENSIONS)})'


class ImageFileError(ValueError):
    """An image file that can't be used; the text names it."""


def is_image(path: str) -> bool:
    return os.path.splitext(path)[1].lower() in EXTENSIONS


def read_grey(path: str) -> np.ndarray:
    """The image in a file, uint8 (H, W).

    Raises
    ------
    ImageFileError
        When the file is missing, truncated or no image.
    """
    try:
        with open(path, 'rb') as file:
            data = file.read()
    except OSError as error:
        raise ImageFileError(f'{path}: {error.strerror}; {ACCEPTED}') from None
    if not data:
        raise ImageFileError(f'{path}: the file is empty; {ACCEPTED}')
    if is_truncated(data):
        raise ImageFileError(f'{path}: the image is truncated or damaged; {ACCEPTED}')
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        image = None
    if image is None:
        raise ImageFileError(f'{path}: no image could be decoded from it, it may be truncated; {ACCEPTED}')
    return image


def is_truncated(data: bytes) -> bool:
    """Whether a PNG or JPEG file ends before its end marker; other formats fail to decode by themselves."""
    if data.startswith(b'\x89PNG\r\n\x1a\n'):
        return not _png_ends(data)
    if data.startswith(b'\xff\xd8'):
        return not _jpeg_ends(data)
    return False


def _png_ends(data: bytes) -> bool:
    position = 8
    while position + 8 <= len(data):
        length, kind = int.from_bytes(data[position:position + 4], 'big'), data[position + 4:position + 8]
        position += 12 + length   # length, kind, content, checksum
        if kind == b'IEND':
            return position <= len(data)
    return False


def _jpeg_ends(data: bytes) -> bool:
    position = 2
    while position + 4 <= len(data) and data[position] == 0xFF:
        marker = data[position + 1]
        if marker == 0xDA:   # start of scan: from here on, FF D9 can only be the end of the image
            return data.find(b'\xff\xd9', position) >= 0
        if marker in (0xFF, 0x01) or 0xD0 <= marker <= 0xD7:
            position += 1 if marker == 0xFF else 2   # a fill byte, or a marker without content
            continue
        position += 2 + int.from_bytes(data[position + 2:position + 4], 'big')
    return False
