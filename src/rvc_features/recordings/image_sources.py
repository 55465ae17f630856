"""Frames from image files, folders and videos. (Bags are in bags.py: they need ROS.)"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Iterator, NamedTuple, Sequence

import cv2
import numpy as np

from rvc_features import still_images
from rvc_features.recordings.file_times import FileTimes, file_times
from rvc_features.recordings.regular_files import SourceError, check_regular

IMAGE_SUFFIXES = ('.bmp', '.jpeg', '.jpg', '.pgm', '.png', '.ppm', '.tif', '.tiff', '.webp')


class Frame(NamedTuple):
    """One image and where it comes from."""

    name: str               # file name, or file name and number of the frame
    image: np.ndarray       # uint8, (H, W) grey or (H, W, 3) BGR
    time: float | None      # seconds since the start, where the source knows


class ImageFiles:
    """Images from files and folders, in natural order (img2 before img10) within each folder.

    Parameters
    ----------
    paths : sequence of str or Path
        Image files, and folders whose image files are taken (not those of their sub-folders).

    Attributes
    ----------
    paths : list of Path

    Raises
    ------
    SourceError
        When a path is missing, is no image, or a folder has no images.
    """

    def __init__(self, paths: Sequence[str | Path]) -> None:
        self.paths = [file for path in paths for file in _image_paths(Path(path))]

    def __len__(self) -> int:
        return len(self.paths)

    def times(self) -> FileTimes | None:
        """When the images were taken, where names or a list beside the files tell; SourceError where that lacks one."""
        return file_times(self.paths)

    def __iter__(self) -> Iterator[Frame]:
        for path in self.paths:
            yield Frame(path.name, read_image(path), None)


class Video:
    """Frames of a video file.

    Parameters
    ----------
    path : str or Path
    most : int, optional
        Stop after that many frames.

    Attributes
    ----------
    rate : float
        Frames per second as the file says, or 0 where it doesn't.

    Raises
    ------
    SourceError
        When the file is missing or OpenCV can't read it.
    """

    def __init__(self, path: str | Path, most: int | None = None) -> None:
        self.path = Path(path)
        self._most = sys.maxsize if most is None else most
        capture = self._open()
        try:
            # Some versions of OpenCV open any file; only a frame proves that it is a video.
            if not self._next(capture)[0]:
                raise SourceError(f'{self.path}: not a video that OpenCV can read')
            rate, count = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
        finally:
            capture.release()
        self.rate = rate if 0 < rate < _MOST_FRAMES else 0.0
        self._count = int(count) if 0 < count < _MOST_FRAMES else 0

    def __len__(self) -> int:
        """Number of frames as the file says, 0 where it doesn't; some files are wrong about it."""
        return min(self._count, self._most)

    def __iter__(self) -> Iterator[Frame]:
        capture = self._open()
        number = 0
        try:
            while number < self._most:
                read, image = self._next(capture)
                if not read:
                    break
                yield Frame(f'{self.path.name} {number}', image, number / self.rate if self.rate else None)
                number += 1
        finally:
            capture.release()
        if number == 0 < self._most:
            raise SourceError(f'{self.path}: no frame can be read from this video')

    def _open(self) -> cv2.VideoCapture:
        check_regular(self.path)
        # FFmpeg where it is there: the others talk to the terminal. As older OpenCV brings it, it films the letters of
        # a text file.
        backends = cv2.videoio_registry.getBackends()
        capture = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG if cv2.CAP_FFMPEG in backends else cv2.CAP_ANY)
        if not capture.isOpened() or capture.get(cv2.CAP_PROP_FOURCC) == int.from_bytes(b'ansi', 'little'):
            raise SourceError(f'{self.path}: not a video that OpenCV can read')
        return capture

    def _next(self, capture: cv2.VideoCapture) -> tuple[bool, np.ndarray]:
        try:
            return capture.read()
        except cv2.error as error:
            raise SourceError(f'{self.path}: a frame that OpenCV can not read ({error.err})') from None


_MOST_FRAMES = 1e9   # as a count or a rate; a damaged file may say anything


def open_source(paths: Sequence[str | Path]) -> ImageFiles | Video:
    """The frames of one video, or of any number of image files and folders; SourceError otherwise."""
    path = Path(paths[0])
    if len(paths) == 1 and path.exists() and not path.is_dir() and not is_image(path):
        return Video(paths[0])
    return ImageFiles(paths)


def read_image(path: str | Path, grey: bool = False) -> np.ndarray:
    """One image file as uint8, grey or BGR as it is stored; SourceError where it can't be decoded.

    With `grey` the decoder makes it grey, as `cv2.imread(path, cv2.IMREAD_GRAYSCALE)` does: that can differ by one
    grey value from a conversion afterwards, which moves published figures of detectors. (Unlike there, a note in the
    file that the camera was held upright turns nothing.)
    """
    check_regular(path)
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise SourceError(f'{path}: {error.strerror}') from None
    image = _decoded(path, data, cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint8:
        image = cv2.normalize(image, np.empty(image.shape, np.uint8), 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    if image.ndim == 3 and image.shape[2] == 4:
        image = cv2.cvtColor(image, cv2.COLOR_BGRA2BGR)
    return image


def _decoded(path: str | Path, data: np.ndarray, flags: int) -> np.ndarray:
    reason = 'it is empty' if data.size == 0 else 'the decoder refuses it'
    image = None
    try:
        if still_images.kind(data[:8].tobytes()) is not None:
            image = still_images.decode(still_images.check(data.tobytes(), _MEGAPIXELS), flags)
        elif data.size:
            image = cv2.imdecode(data, flags)
    except (still_images.StillImageError, cv2.error) as error:
        reason = error.err if isinstance(error, cv2.error) else str(error)
    if image is None:
        raise SourceError(f'{path}: not an image that OpenCV can read, or cut short ({reason}; '
                          f'accepted: {", ".join(IMAGE_SUFFIXES)})')
    return image


_MEGAPIXELS = 200   # the largest photographs; of a tiny file that claims more, the pixels would fill the memory


def is_image(path: Path) -> bool:
    """Whether the file's name ends like that of an image."""
    return path.suffix.lower() in IMAGE_SUFFIXES


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Sort key that puts img2 before img10."""
    return [(int(digits or 0), text) for digits, text in re.findall(r'(\d+)|(\D+)', path.name)]


def _image_paths(path: Path) -> list[Path]:
    if path.is_dir():
        files = sorted((file for file in path.iterdir() if file.is_file() and is_image(file)), key=natural_order)
        if not files:
            raise SourceError(f'{path}: no images in this folder (accepted: {", ".join(IMAGE_SUFFIXES)})')
        return files
    if not path.exists():
        raise SourceError(f'{path}: no such file or folder')
    if not is_image(path):
        raise SourceError(f'{path}: not an image (accepted: {", ".join(IMAGE_SUFFIXES)}) or a folder of images')
    return [path]
