"""The images of a bag as files, or as a video: the inverse of make_bag.

    rosrun rvc_features unmake_bag BAG OUTPUT [--topic NAME] [--rate HZ] [--force]

OUTPUT is a folder, for PNG files that are named by their time (1305031102.175304000.png, which make_bag understands),
or a video (.avi, .mp4).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, Iterator, NamedTuple, Sequence

import cv2
import numpy as np

from rvc_features.command_line import (
    BAD_INPUT,
    Interrupted,
    positive_number,
    print_safely,
    quiet_opencv,
    signals_as_exceptions,
    with_progress,
)
from rvc_features.image_transport.encodings import converted
from rvc_features.image_transport.messages import unpack
from rvc_features.recordings.bags import BagImages
from rvc_features.recordings.file_times import name_of
from rvc_features.recordings.regular_files import SourceError
from rvc_features.recordings.whole_files import whole_file

VIDEOS = {'.avi': 'MJPG', '.mp4': 'mp4v'}   # and the code of how their frames are compressed
DEFAULT_RATE = 10.0   # Hz, where the bag's times tell none


class StampedImage(NamedTuple):
    """An image of a bag and its time."""

    image: np.ndarray    # uint8 or uint16, (H, W) grey or (H, W, 3) BGR
    nanoseconds: int     # since 1970: the stamp in its header, or where that is zero when it was recorded


def to_images(source: BagImages, folder: str | Path, overwrite: bool = False) -> int:
    """Write each image of `source` as PNG into a folder, which is made if need be; how many there were.

    Grey images of 8 or 16 bits and colour images come out as they are in the bag; others as they are shown.

    Raises
    ------
    SourceError
        When two images have the same time.
    FileExistsError
        When there is such a file already, and it may not be replaced.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written: set[int] = set()
    for image, nanoseconds in _images(source):
        if nanoseconds in written:
            raise SourceError(f'{source.path}: two images on {source.topic} have the time {name_of(nanoseconds)}, and '
                              'would be the same file')
        with whole_file(folder / f'{name_of(nanoseconds)}.png', overwrite) as unfinished:
            unfinished.write_bytes(_encoded(image))
        written.add(nanoseconds)
    return len(written)


def to_video(source: BagImages, path: str | Path, rate: float | None = None, overwrite: bool = False) -> int:
    """Write the images of `source` as a video (see VIDEOS); how many there were.

    Parameters
    ----------
    rate : float, optional
        Frames per second; default: the median in the bag.

    Raises
    ------
    SourceError
        When the images differ in size, or OpenCV can't write such a video.
    FileExistsError
        When there is such a file already, and it may not be replaced.
    """
    path = Path(path)
    if rate is None:
        gaps = np.diff([nanoseconds for _, nanoseconds in _images(source)])
        rate = min(1e9 / max(float(np.median(gaps)), 1e6), 1000.0) if len(gaps) else DEFAULT_RATE
    with whole_file(path, overwrite, path.suffix.lower()) as unfinished:   # the suffix tells OpenCV the kind of file
        return _write_video(source, unfinished, rate)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit status."""
    print_safely()
    options = _parser().parse_args(arguments)
    quiet_opencv()
    video = Path(options.output).suffix.lower() in VIDEOS
    try:
        with signals_as_exceptions():
            source = BagImages(options.bag, options.topic)
            count = to_video(source, options.output, options.rate, options.force) if video \
                else to_images(source, options.output, options.force)
            if not count:
                raise SourceError(f'{options.bag}: none of its {len(source)} images on {source.topic} can be decoded'
                                  + (f'; the first: {source.skipped[0]}' if source.skipped else ''))
    except FileExistsError as error:
        print(f'unmake_bag: {error}; name another place, or give --force', file=sys.stderr)
        return BAD_INPUT
    except (SourceError, OSError) as error:
        print(f'unmake_bag: {error}', file=sys.stderr)
        return BAD_INPUT
    except Interrupted as interruption:
        print(f'unmake_bag: {interruption}', file=sys.stderr)
        return interruption.status
    print(f'{options.output}: {count} images of {source.topic}'
          + (f'; {len(source.skipped)} could not be decoded, the first: {source.skipped[0]}' if source.skipped else ''))
    return 0


def _images(source: BagImages) -> Iterator[StampedImage]:
    for _, (image, stamp), recorded in source.messages(_decoded):
        yield StampedImage(image, (stamp if stamp else recorded).to_nsec())


def _decoded(message: Any) -> tuple[np.ndarray, Any]:
    """The pixels as a PNG file can hold them, and the stamp."""
    pixels, encoding = unpack(message)
    if not (pixels.ndim == 2 and encoding in ('mono8', '8UC1', 'mono16', '16UC1')):
        pixels = converted(pixels, encoding, 'bgr8')
    return pixels, message.header.stamp


def _encoded(image: np.ndarray) -> bytes:
    _, data = cv2.imencode('.png', image)
    return data.tobytes()


def _write_video(source: BagImages, path: Path, rate: float) -> int:
    writer, size, count = None, (0, 0), 0
    try:
        for image, _ in with_progress(_images(source), 'frames'):
            if writer is None:
                size = image.shape[1], image.shape[0]
                writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*VIDEOS[path.suffix]), rate, size)
                if not writer.isOpened():
                    raise SourceError(f'{source.path}: OpenCV can not write its images of {size[0]}x{size[1]} pixels '
                                      f'as a {path.suffix} video; take a folder of images')
            if (image.shape[1], image.shape[0]) != size:
                raise SourceError(f'{source.path}: its images on {source.topic} differ in size, which those of a video '
                                  'can not; take a folder of images')
            shown = image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)
            writer.write(shown if shown.ndim == 3 else cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR))
            count += 1
    finally:
        if writer is not None:
            writer.release()
    if count and cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT) <= 0:
        # What the writer could not write it leaves out, and says nothing; the index at the end, too.
        raise OSError(f'{source.path}: its video could not be written whole; is the disk full?')
    return count


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='unmake_bag', description='The images of a bag as files, or as a video.')
    parser.add_argument('bag', help='the bag to read')
    parser.add_argument('output', help=f'a folder for PNG files named by their time, or a video ({", ".join(VIDEOS)})')
    parser.add_argument('--topic', help='its image topic; not needed where there is only one')
    parser.add_argument('--rate', type=positive_number, help='frames per second of a video (default: as in the bag)')
    parser.add_argument('--force', action='store_true', help='replace files that are there')
    return parser
