"""Make a bag of images from image files, folders or a video.

    rosrun rvc_features make_bag OUTPUT.bag INPUT [INPUT ...] [--rate HZ] [--topic NAME] [--frame-id NAME]
                                 [--camera-info FILE] [--start SECONDS] [--force]
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from pathlib import Path
from typing import Any, Iterator, Sequence

import genpy
import rosbag
import yaml
from rosgraph.names import is_legal_name
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from rvc_features.command_line import (
    BAD_INPUT,
    Interrupted,
    positive_number,
    print_safely,
    quiet_opencv,
    signals_as_exceptions,
    with_progress,
)
from rvc_features.image_transport.messages import to_image_message
from rvc_features.recordings.file_times import FileTimes
from rvc_features.recordings.image_sources import ImageFiles, Video, open_source
from rvc_features.recordings.regular_files import SourceError, read_text
from rvc_features.recordings.whole_files import whole_file

DEFAULT_RATE = 10.0   # Hz, where the source has none of its own


def make_bag(output: str | Path, source: ImageFiles | Video, rate: float | None = None,
             topic: str = '/camera/image_raw', frame_id: str = 'camera', camera_info: CameraInfo | None = None,
             start: float | None = None, overwrite: bool = False) -> int:
    """Write every frame of `source` to a new bag.

    Parameters
    ----------
    output : str or Path
        The bag; it appears under this name only when it is complete.
    source : ImageFiles or Video
    rate : float, optional
        Frames per second in the bag; default: the times of the images, the rate of the video, or else DEFAULT_RATE.
    topic, frame_id : str
    camera_info : sensor_msgs/CameraInfo, optional
        Written beside each image, on the topic `camera_info` next to the image topic.
    start : float, optional
        Time of the first frame in seconds since 1970; default: that of the image, or else now.
    overwrite : bool
        Whether a file that is there already is replaced.

    Returns
    -------
    int
        How many frames were written.

    Raises
    ------
    SourceError
        When a frame can't be read, or its time is beyond what ROS can say (the year 2106).
    FileExistsError
        When there is such a file already, and it may not be replaced.
    """
    written = 0
    with whole_file(output, overwrite) as unfinished, rosbag.Bag(str(unfinished), 'w') as bag:
        frames, stamps = _in_order_of_time(source, rate, start)
        for number, (frame, nanoseconds) in enumerate(zip(with_progress(frames, 'frames'), stamps)):
            if not 0 <= nanoseconds < 2 ** 32 * 10 ** 9:
                raise SourceError(f'{frame.name}: its time, {nanoseconds / 10 ** 9:g} s since 1970, is beyond what ROS '
                                  'can say; give another --start, or a higher --rate')
            stamp = genpy.Time(*divmod(nanoseconds, 10 ** 9))
            header = Header(seq=number, stamp=stamp, frame_id=frame_id)
            encoding = 'mono8' if frame.image.ndim == 2 else 'bgr8'
            bag.write(topic, to_image_message(frame.image, encoding, header), stamp)
            if camera_info is not None:
                camera_info.header = header
                bag.write(f'{topic.rsplit("/", 1)[0]}/camera_info', camera_info, stamp)
            written += 1
    return written


def read_camera_info(path: str | Path) -> CameraInfo:
    """A calibration file as camera_calibration writes it (YAML); SourceError where it isn't one."""
    text = read_text(path)
    try:
        given = yaml.safe_load(text)
        return CameraInfo(
            width=_size(given, 'image_width'), height=_size(given, 'image_height'),
            distortion_model=str(given['distortion_model']), D=_numbers(given, 'distortion_coefficients'),
            K=_numbers(given, 'camera_matrix', 9), R=_numbers(given, 'rectification_matrix', 9),
            P=_numbers(given, 'projection_matrix', 12))
    except (yaml.YAMLError, LookupError, TypeError, ValueError, ArithmeticError, RecursionError) as error:
        reason = ' '.join(str(error).split())[:200]
        raise SourceError(f'{path}: not a camera calibration as camera_calibration writes it '
                          f'({type(error).__name__}: {reason})') from None


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit status."""
    print_safely()
    options = _parser().parse_args(arguments)
    quiet_opencv()
    try:
        with signals_as_exceptions():
            source = open_source(options.inputs)
            camera_info = read_camera_info(options.camera_info) if options.camera_info else None
            count = make_bag(options.output, source, options.rate, options.topic, options.frame_id, camera_info,
                             options.start, options.force)
    except FileExistsError as error:
        print(f'make_bag: {error}; name another, or give --force', file=sys.stderr)
        return BAD_INPUT
    except (SourceError, OSError) as error:
        print(f'make_bag: {error}', file=sys.stderr)
        return BAD_INPUT
    except Interrupted as interruption:
        print(f'make_bag: {interruption}; no bag was made', file=sys.stderr)
        return interruption.status
    print(f'{options.output}: {count} frames on {options.topic}, {_pace(source, options.rate)}')
    return 0


def _in_order_of_time(source: ImageFiles | Video, rate: float | None,
                      start: float | None) -> tuple[ImageFiles | Video, Iterator[int]]:
    """The source, images of known time in its order, and a time for each of its frames in nanoseconds since 1970."""
    first = round((time.time() if start is None else start) * 10 ** 9)
    times = _times_of(source, rate)
    if times is None or not isinstance(source, ImageFiles):
        per_second = _rate_of(source, rate)
        return source, (first + round(number * 10 ** 9 / per_second) for number in itertools.count())
    ordered = sorted(zip(times.nanoseconds, source.paths))
    shift = 0 if times.since_1970 and start is None else first - ordered[0][0]
    return ImageFiles([path for _, path in ordered]), iter([nanoseconds + shift for nanoseconds, _ in ordered])


def _times_of(source: ImageFiles | Video, rate: float | None) -> FileTimes | None:
    return source.times() if rate is None and isinstance(source, ImageFiles) else None


def _rate_of(source: ImageFiles | Video, rate: float | None) -> float:
    return rate or getattr(source, 'rate', 0.0) or DEFAULT_RATE


def _pace(source: ImageFiles | Video, rate: float | None) -> str:
    times = _times_of(source, rate)
    if times is None:
        return f'{_rate_of(source, rate):g} per second'
    return f'at the times that came with the images, {(max(times.nanoseconds) - min(times.nanoseconds)) / 1e9:.3f} s'


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='make_bag', description='Make a bag of images; unmake_bag is the inverse.')
    parser.add_argument('output', type=_bag_name, help='the bag to write')
    parser.add_argument('inputs', nargs='+', metavar='input', help='image files and folders, or one video')
    parser.add_argument('--rate', type=positive_number,
                        help='frames per second (default: the times in the names of the images (TUM, EuRoC) or in '
                             'timestamps.txt beside them (KITTI), the rate of the video, else 10)')
    parser.add_argument('--topic', type=_topic, default='/camera/image_raw', help='default: %(default)s')
    parser.add_argument('--frame-id', default='camera', help='default: %(default)s')
    parser.add_argument('--camera-info', metavar='FILE', help='calibration (YAML) to be written beside each image')
    parser.add_argument('--start', type=positive_number, metavar='SECONDS',
                        help='time of the first frame in seconds since 1970 (default: its own, else now)')
    parser.add_argument('--force', action='store_true', help='replace OUTPUT if it is there')
    return parser


def _bag_name(text: str) -> str:
    if not text.endswith('.bag'):
        raise argparse.ArgumentTypeError(f'the bag to write comes first, and its name must end in .bag; got {text!r}')
    return text


def _topic(text: str) -> str:
    if not text.strip('/') or text.endswith('/') or not is_legal_name(text):
        raise argparse.ArgumentTypeError(f'{text!r} is not a topic name (letters, digits, _ and /)')
    return text


def _size(given: dict[str, Any], name: str) -> int:
    if not 0 <= int(given[name]) < 2 ** 32:
        raise ValueError(f'{name} is {given[name]}')
    return int(given[name])


def _numbers(given: dict[str, Any], name: str, count: int | None = None) -> list[float]:
    numbers = [float(number) for number in given[name]['data']]
    if count is not None and len(numbers) != count:
        raise ValueError(f'{name} must have {count} numbers, has {len(numbers)}')
    return numbers
