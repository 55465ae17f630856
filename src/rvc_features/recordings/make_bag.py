"""Make a bag of images from image files, folders or a video.

    rosrun rvc_features make_bag OUTPUT.bag INPUT [INPUT ...] [--rate HZ] [--topic NAME] [--frame-id NAME]
                                 [--camera-info FILE] [--start SECONDS]
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Any, Sequence

import genpy
import rosbag
import yaml
from rosgraph.names import is_legal_name
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header
from tqdm import tqdm

from rvc_features.image_transport.messages import to_image_message
from rvc_features.recordings.image_sources import ImageFiles, SourceError, Video, open_source

DEFAULT_RATE = 10.0   # Hz, where the source has none of its own


def make_bag(output: str | Path, source: ImageFiles | Video, rate: float, topic: str = '/camera/image_raw',
             frame_id: str = 'camera', camera_info: CameraInfo | None = None, start: float | None = None) -> int:
    """Write every frame of `source` to a new bag.

    Parameters
    ----------
    output : str or Path
        The bag; it appears under this name only when it is complete.
    source : ImageFiles or Video
    rate : float
        Frames per second in the bag.
    topic, frame_id : str
    camera_info : sensor_msgs/CameraInfo, optional
        Written beside each image, on the topic `camera_info` next to the image topic.
    start : float, optional
        Time of the first frame in seconds since 1970; default: now.

    Returns
    -------
    int
        How many frames were written.
    """
    start = time.time() if start is None else start
    unfinished = Path(f'{output}.part')
    written = 0
    try:
        with rosbag.Bag(str(unfinished), 'w') as bag:
            for number, frame in enumerate(tqdm(source, unit='frames', disable=None)):
                stamp = genpy.Time.from_sec(start + number / rate)
                header = Header(seq=number, stamp=stamp, frame_id=frame_id)
                encoding = 'mono8' if frame.image.ndim == 2 else 'bgr8'
                bag.write(topic, to_image_message(frame.image, encoding, header), stamp)
                if camera_info is not None:
                    camera_info.header = header
                    bag.write(f'{topic.rsplit("/", 1)[0]}/camera_info', camera_info, stamp)
                written += 1
        os.replace(unfinished, output)
    finally:
        unfinished.unlink(missing_ok=True)
    return written


def read_camera_info(path: str | Path) -> CameraInfo:
    """A calibration file as camera_calibration writes it (YAML); SourceError where it isn't one."""
    try:
        with open(path, encoding='utf-8') as file:
            given = yaml.safe_load(file)
        return CameraInfo(
            width=int(given['image_width']), height=int(given['image_height']),
            distortion_model=str(given['distortion_model']), D=_numbers(given, 'distortion_coefficients'),
            K=_numbers(given, 'camera_matrix', 9), R=_numbers(given, 'rectification_matrix', 9),
            P=_numbers(given, 'projection_matrix', 12))
    except OSError as error:
        raise SourceError(f'{path}: {error.strerror}') from None
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise SourceError(f'{path}: not a camera calibration as camera_calibration writes it ({error!r})') from None


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit status."""
    options = _parser().parse_args(arguments)
    try:
        source = open_source(options.inputs)
        camera_info = read_camera_info(options.camera_info) if options.camera_info else None
        rate = options.rate or getattr(source, 'rate', 0.0) or DEFAULT_RATE
        count = make_bag(options.output, source, rate, options.topic, options.frame_id, camera_info, options.start)
    except (SourceError, OSError) as error:
        print(f'make_bag: {error}', file=sys.stderr)
        return 2
    print(f'{options.output}: {count} frames on {options.topic}, {rate:g} per second')
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='make_bag', description='Make a bag of images.')
    parser.add_argument('output', help='the bag to write')
    parser.add_argument('inputs', nargs='+', metavar='input', help='image files and folders, or one video')
    parser.add_argument('--rate', type=_positive, help='frames per second (default: that of the video, else 10)')
    parser.add_argument('--topic', type=_topic, default='/camera/image_raw', help='default: %(default)s')
    parser.add_argument('--frame-id', default='camera', help='default: %(default)s')
    parser.add_argument('--camera-info', metavar='FILE', help='calibration (YAML) to be written beside each image')
    parser.add_argument('--start', type=_positive, metavar='SECONDS',
                        help='time of the first frame in seconds since 1970 (default: now)')
    return parser


def _positive(text: str) -> float:
    number = float(text)
    if not 0 < number < 2 ** 32:
        raise ValueError(text)
    return number


def _topic(text: str) -> str:
    if not is_legal_name(text):
        raise argparse.ArgumentTypeError(f'{text!r} is not a topic name (letters, digits, _ and /)')
    return text


def _numbers(given: dict[str, Any], name: str, count: int | None = None) -> list[float]:
    numbers = [float(number) for number in given[name]['data']]
    if count is not None and len(numbers) != count:
        raise ValueError(f'{name} must have {count} numbers, has {len(numbers)}')
    return numbers
