"""Keeps what the node publishes: a bag of it, and a video of the pictures."""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path
from typing import Iterator

import cv2
import numpy as np
import rosbag
from sensor_msgs.msg import Image

from rvc_features.msg import KeyPoints
from rvc_features.recordings.whole_files import whole_file

BAG, VIDEO = 'output.bag', 'annotated.avi'
_FRAMES_PER_SECOND = 10


@contextlib.contextmanager
def recorder(output: Path, topic: str) -> Iterator[Recorder]:
    """Record into a folder; the files are there, whole, when all went well.

    Parameters
    ----------
    output : Path
    topic : str
        Of the node; its name stands before `image` and `key_points` in the bag.
    """
    with whole_file(output / BAG) as bag, whole_file(output / VIDEO, suffix='.avi') as video:
        recording = Recorder(bag, video, topic)
        try:
            yield recording
        finally:
            recording.close()


class Recorder:
    """Made by `recorder`; its methods may be called from several threads, and do nothing after `close`."""

    def __init__(self, bag: Path, video: Path, topic: str) -> None:
        self._bag = rosbag.Bag(str(bag), 'w')
        self._video_path = str(video)
        self._video: cv2.VideoWriter | None = None
        self._size = (0, 0)
        self._topic = topic
        self._closed = False
        self._lock = threading.Lock()

    def key_points(self, message: KeyPoints) -> None:
        with self._lock:
            if not self._closed:
                self._bag.write(f'{self._topic}/key_points', message, message.header.stamp)

    def picture(self, message: Image, picture: np.ndarray) -> None:
        with self._lock:
            if self._closed:
                return
            self._bag.write(f'{self._topic}/image', message, message.header.stamp)
            if self._video is None:
                self._size = (picture.shape[1], picture.shape[0])
                self._video = cv2.VideoWriter(self._video_path, cv2.VideoWriter.fourcc(*'MJPG'), _FRAMES_PER_SECOND,
                                              self._size)
            self._video.write(cv2.resize(picture, self._size))

    def close(self) -> None:
        with self._lock:
            self._closed = True
            self._bag.close()
            if self._video is not None:
                self._video.release()
