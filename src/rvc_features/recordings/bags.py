"""Images in bags: what is there, and the frames of one topic."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Callable, Iterator

import genpy
import rosbag

from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.messages import to_array
from rvc_features.recordings.image_sources import Frame, SourceError

IMAGE_TYPES = ('sensor_msgs/Image', 'sensor_msgs/CompressedImage')


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
        When the bag can't be read, or doesn't have the topic; the text lists its image topics.
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

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Frame]:
        start = None
        for name, message, time in self.messages(lambda message: to_array(message, 'bgr8')):
            start = time if start is None else start
            yield Frame(name, message, (time - start).to_sec())

    def messages(self, decode: Callable[[Any], Any]) -> Iterator[tuple[str, Any, genpy.Time]]:
        """Of each message a name, what `decode` makes of it, and when it was recorded.

        A message that it raises ImageError for is skipped, and counted.
        """
        self.skipped = []
        with _open(self.path) as bag:
            for number, (_, message, time) in enumerate(bag.read_messages([self.topic])):
                name = f'{self.path.name} {self.topic} {number}'
                try:
                    decoded = decode(message)
                except ImageError as error:
                    self.skipped.append(f'{name}: {error}')
                    continue
                yield name, decoded, time


def image_topics(path: Path) -> dict[str, int]:
    """The bag's image topics and how many messages each has; SourceError where it can't be read."""
    with _open(path) as bag:
        topics = bag.get_type_and_topic_info().topics
    return {name: info.message_count for name, info in sorted(topics.items()) if info.msg_type in IMAGE_TYPES}


def _open(path: Path) -> rosbag.Bag:
    try:
        return rosbag.Bag(str(path))
    except rosbag.ROSBagUnindexedException:
        raise SourceError(f'{path}: this bag has no index, as after a crash; `rosbag reindex` mends it') from None
    except (rosbag.ROSBagException, OSError) as error:
        raise SourceError(f'{path}: not a bag that can be read ({error})') from None
