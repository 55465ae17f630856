"""Where key points may lie: rectangles, a file, a border and the newest mask image, made into one mask.

As everywhere in OpenCV a mask is an image, and points may lie where it is not zero. A rectangle says the opposite: it
lies on what is to be left out, such as the bonnet of a car or the robot's own arm.
"""

from __future__ import annotations

import re
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Sequence

import cv2
import numpy as np

from rvc_features import parameters
from rvc_features.brief import shown
from rvc_features.parameters import Integer, parameter
from rvc_features.recordings.image_sources import SourceError, read_image

ACCEPTED = ('accepted are an image file (points may lie where it is not zero) or rectangles to leave out, as '
            'x,y,width,height in pixels, several of them separated by blanks or semicolons')
_MOST_SIZES = 4   # mask images that are kept, one for each size: a camera has few


class MaskError(ValueError):
    """What can't be used as a mask; the text says what was given, and what is accepted."""


@dataclass(frozen=True)
class Border:
    """A rim without points, of its own width at each side of the image."""

    left: int = parameter(0, Integer('Pixels at the left without points.', 0))
    right: int = parameter(0, Integer('Pixels at the right without points.', 0))
    top: int = parameter(0, Integer('Pixels at the top without points.', 0))
    bottom: int = parameter(0, Integer('Pixels at the bottom without points.', 0))

    def __post_init__(self) -> None:
        parameters.validate(self)

    def __bool__(self) -> bool:
        return any((self.left, self.right, self.top, self.bottom))


@dataclass(frozen=True, eq=False)
class FixedMask:
    """What was given once: rectangles to leave out, or an image.

    Attributes
    ----------
    rectangles : tuple of (x, y, width, height)
        In pixels; what is outside of the image is cut off.
    image : ndarray, uint8, shape (H, W), or None
        Not zero where points may lie.
    """

    rectangles: tuple[tuple[int, int, int, int], ...] = ()
    image: np.ndarray | None = None


def parse(given: Any) -> FixedMask:
    """The mask that a parameter or an option describes.

    Parameters
    ----------
    given : str, or a sequence of four integers, or of such sequences
        The name of an image file; or rectangles, as text `x,y,width,height` or as numbers. Empty: no mask.

    Raises
    ------
    MaskError
        When it is neither, or the file can't be read.
    """
    if isinstance(given, str):
        text = given.strip()
        if re.fullmatch(r'[-+\d,;.\s]*', text):
            return FixedMask(tuple(_rectangle(part.split(','), given) for part in re.split(r'[;\s]+', _joined(text))
                                   if part))
        return FixedMask(image=_image_file(Path(text).expanduser()))
    if isinstance(given, Sequence) and not isinstance(given, bytes):
        rows = [given] if given and not isinstance(given[0], (list, tuple)) else given
        return FixedMask(tuple(_rectangle(row, given) for row in rows))
    raise MaskError(f'{shown(given)} is no mask; {ACCEPTED}')


def _joined(text: str) -> str:
    return re.sub(r'\s*,\s*', ',', text)


def _rectangle(numbers: Any, given: Any) -> tuple[int, int, int, int]:
    try:
        x, y, width, height = (int(number) for number in numbers)
    except (TypeError, ValueError):
        raise MaskError(f'{shown(given)} is no mask; {ACCEPTED}') from None
    if width < 1 or height < 1:
        raise MaskError(f'a rectangle of {width} x {height} pixels in {shown(given)} covers nothing; {ACCEPTED}')
    return x, y, width, height


def _image_file(path: Path) -> np.ndarray:
    try:
        image = read_image(path)
    except SourceError as error:
        raise MaskError(f'{error}; {ACCEPTED}') from None
    return image if image.ndim == 2 else image.max(axis=2)


class Masks:
    """All masks of a camera, made into one for each image; from any thread.

    Parameters
    ----------
    fixed : FixedMask
        Its image counts while no other one of the images' size has come by `add`, its rectangles always.
    border : Border
        Counts always; may be replaced at any time.

    Examples
    --------
    >>> Masks(parse('0,0,2,1')).of((2, 3)).tolist()
    [[0, 0, 255], [255, 255, 255]]
    """

    def __init__(self, fixed: FixedMask | None = None, border: Border | None = None) -> None:
        self.fixed = fixed or FixedMask()
        self.border = border or Border()
        self._newest: dict[tuple[int, int], np.ndarray] = {}   # of each size the newest image, the newest of all last
        self._came = 0                                         # mask images so far
        self._made: tuple[Any, ...] | None = None              # what the mask below was made of
        self._mask: np.ndarray | None = None
        self._lock = threading.Lock()

    def add(self, image: np.ndarray) -> None:
        """A mask image that has come: it counts for all images of its size, until the next one of that size.

        Parameters
        ----------
        image : ndarray, uint8, shape (H, W)
            Not zero where points may lie. It must not change afterwards.
        """
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 2 or image.size == 0:
            got = f'{image.dtype} {image.shape}' if isinstance(image, np.ndarray) else type(image).__name__
            raise MaskError(f'a mask must be a uint8 array of shape (height, width); got {got}')
        shape = image.shape[0], image.shape[1]
        with self._lock:
            self._newest.pop(shape, None)
            self._newest[shape] = image
            self._came += 1
            while len(self._newest) > _MOST_SIZES:
                del self._newest[next(iter(self._newest))]

    def of(self, shape: tuple[int, ...]) -> np.ndarray | None:
        """The mask for images of that shape, read-only uint8 (H, W) of 0 and 255; None where points may lie anywhere.

        The same array as before where nothing has changed.
        """
        height, width = size = shape[0], shape[1]
        with self._lock:
            fixed, border = self.fixed, self.border
            sources = self._came, fixed, border, size
            if sources != self._made:
                image = self._newest.get(size)
                if image is None and fixed.image is not None and fixed.image.shape == size:
                    image = fixed.image
                self._made, self._mask = sources, _composed(image, fixed.rectangles, border, height, width)
            return self._mask

    def problem(self, shape: tuple[int, ...]) -> str:
        """Why the newest mask does not count for images of that shape; empty if it does, or there is none."""
        with self._lock:
            sizes = list(self._newest)
            if sizes and sizes[-1] != shape[:2]:
                return _other_size('mask', sizes[-1], shape) + (', the last one that fits stays' if shape[:2] in sizes
                                                                else '')
            image = self.fixed.image
            if not sizes and image is not None and image.shape != shape[:2]:
                return _other_size('mask file', image.shape, shape)
            return ''


def _other_size(what: str, size: tuple[int, ...], wanted: tuple[int, ...]) -> str:
    return f'{what} refused: it has {size[1]} x {size[0]} pixels, and the images have {wanted[1]} x {wanted[0]}'


def _composed(image: np.ndarray | None, rectangles: Sequence[tuple[int, int, int, int]], border: Border, height: int,
              width: int) -> np.ndarray | None:
    if image is None and not rectangles and not border:
        return None
    mask = np.full((height, width), 255, np.uint8) if image is None else (image != 0).astype(np.uint8) * np.uint8(255)
    for x, y, across, down in rectangles:
        mask[max(y, 0):max(y + down, 0), max(x, 0):max(x + across, 0)] = 0
    mask[:border.top] = 0
    mask[:, :border.left] = 0
    mask[max(height - border.bottom, 0):] = 0
    mask[:, max(width - border.right, 0):] = 0
    mask.flags.writeable = False
    return mask


def shaded(picture: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
    """The picture, half as bright in place where the mask is zero.

    Parameters
    ----------
    picture : ndarray, uint8, shape (H, W, 3)
    mask : ndarray, uint8, shape (H, W), of 0 and 255, or None
    """
    if mask is not None:
        cv2.multiply(picture, cv2.cvtColor(mask | 127, cv2.COLOR_GRAY2BGR), picture, 1 / 255)
    return picture
