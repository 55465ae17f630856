"""Images in bags: what is there, and the frames of one topic.

Nothing that a bag brings along is run: messages are read by the installed classes, never by those that rosbag makes of
the definitions in the bag, by having Python written from them.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any, Callable, Iterator

import genpy
import rosbag
import rosbag.bag
import sensor_msgs.msg

from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.messages import Image, to_array
from rvc_features.recordings.image_sources import Frame
from rvc_features.recordings.regular_files import SourceError, check_regular

_CLASSES = {'sensor_msgs/Image': Image, 'sensor_msgs/CompressedImage': sensor_msgs.msg.CompressedImage}
_VERSION = 200   # of the format: that of ROS since 2010

# rosbag asks here before it makes a class; nothing else keeps it from doing so, even where raw bytes are asked for.
rosbag.bag._message_types.update({known._md5sum: known for known in _CLASSES.values()})


class BagImages:
    """The images of one topic of a bag, raw or compressed; messages that can't be decoded are counted and skipped.

    Parameters
    ----------
    path : str or Path
    topic : str, optional
        May be left out when the bag has only one image topic.

    Attributes
    ----------
    topic : str
    skipped : list of str
        Why each message was skipped that was, in the last pass.

    Raises
    ------
    SourceError
        When the bag can't be read, or doesn't have the topic (the text lists its image topics), or has it with other
        messages than those installed.
    """

    def __init__(self, path: str | Path, topic: str | None = None) -> None:
        self.path = Path(path)
        self.skipped: list[str] = []
        topics = image_topics(self.path)
        have = f'its image topics: {", ".join(topics) or "none"}'
        if topic is None and len(topics) != 1:
            raise SourceError(f'{self.path}: name a topic; {have}')
        self.topic = next(iter(topics)) if topic is None else topic
        if self.topic not in topics:
            raise SourceError(f'{self.path}: no images on topic {self.topic}; {have}')
        self._count = topics[self.topic]
        for _ in self._raw_messages():   # at once, if its messages are others
            break

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Frame]:
        start = None
        for name, message, time in self.messages(lambda message: to_array(message, 'bgr8')):
            start = time if start is None else start
            yield Frame(name, message, (time - start).to_sec())

    def messages(self, decode: Callable[[Any], Any]) -> Iterator[tuple[str, Any, genpy.Time]]:
        """Of each message a name, what `decode` makes of it, and when it was recorded.

        A message that can't be read, or that it raises ImageError for, is skipped and counted.
        """
        self.skipped = []
        for number, (kind, data, time) in enumerate(self._raw_messages()):
            name = f'{self.path.name} {self.topic} {number}'
            try:
                decoded = decode(_CLASSES[kind]().deserialize(data))
            except (ImageError, genpy.DeserializationError) as error:
                self.skipped.append(f'{name}: {error}')
                continue
            yield name, decoded, time

    def _raw_messages(self) -> Iterator[tuple[str, bytes, genpy.Time]]:
        """Type, bytes and time of each message."""
        with _opened(self.path) as bag:
            for _, message, time in bag.read_messages([self.topic], connection_filter=self._is_known, raw=True):
                yield message[0], message[1], time

    def _is_known(self, topic: str, kind: str, checksum: str, definition: str, header: dict[str, Any]) -> bool:
        """rosbag's filter of connections: those of the installed messages; SourceError for any other."""
        known = _CLASSES.get(kind)
        if known is None or known._md5sum != checksum:
            raise SourceError(f'{self.path}: messages on {topic} are {kind} with checksum {checksum}; only '
                              + ' and '.join(f'{name} ({known._md5sum})' for name, known in _CLASSES.items())
                              + ' are read')
        return True


def image_topics(path: Path) -> dict[str, int]:
    """The bag's image topics and how many messages each has; SourceError where it can't be read."""
    with _opened(path) as bag:
        topics = bag.get_type_and_topic_info().topics
    return {name: info.message_count for name, info in sorted(topics.items()) if info.msg_type in _CLASSES}


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[rosbag.Bag]:
    check_regular(path)
    try:
        with rosbag.Bag(str(path)) as bag:
            if bag.version != _VERSION:
                raise SourceError(f'{path}: a bag of format {bag.version / 100:g}, from before 2010; '
                                  '`rosbag fix` makes a new one of it')
            yield bag
    except SourceError:
        raise
    except rosbag.ROSBagUnindexedException:
        raise SourceError(f'{path}: this bag has no index, as after a crash; `rosbag reindex` mends it') from None
    except Exception as error:   # rosbag raises whatever a damaged file leads it to
        raise SourceError(f'{path}: not a bag that can be read ({str(error) or type(error).__name__})') from None
