"""What the package's half without ROS has to say: to where the node's own messages go, and to /diagnostics."""

from __future__ import annotations

import functools
import logging
import re
import threading
import time
from pathlib import Path

import genpy
import rosgraph
import rospy
from rospy.impl.paramserver import get_param_server_cache

from rvc_features.brief import cut, reporter

_RECENT = 60.0   # seconds: longer than what lasts is left unsaid in between
_MOST = 5        # warnings that are kept
_KIND = 16       # characters at the beginning of a text that tell its kind
_MOST_KINDS = 50
_TRACEBACK = 'Traceback (most recent call last):'
_OMIT_TOPICS = '/rosout_disable_topics_generation'
_SHORTENED = 'is_shortened'   # attribute of records that have been through the filter


class LibraryLog(logging.Handler):
    """Handler of the logger `rvc_features`; keeps what was said in the last minute."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._recent: dict[str, tuple[float, str]] = {}

    def emit(self, record: logging.LogRecord) -> None:
        text = cut(record.getMessage())
        (rospy.logerr if record.levelno >= logging.ERROR else rospy.logwarn)(text)
        self._recent[str(record.msg)[:20]] = time.monotonic(), text
        while len(self._recent) > _MOST:
            del self._recent[next(iter(self._recent))]

    def recent(self) -> tuple[str, ...]:
        """Warnings of the last minute, the last of each kind."""
        now = time.monotonic()
        return tuple(text for said, text in list(self._recent.values()) if now - said < _RECENT)


class RosLog(logging.Filter):
    """Of what ROS's own libraries log as warning or worse, each kind in one line, less and less often while it lasts.

    They write a traceback for each request that makes no sense, and two lines for each connection that comes and goes.
    """

    def __init__(self) -> None:
        super().__init__()
        self._kinds: set[str] = set()

    def install(self) -> None:
        """Have all loggers of ROS's filtered like that."""
        for name in logging.root.manager.loggerDict:
            if name.partition('.')[0] in ('rosout', 'rospy', 'rosgraph', 'xmlrpc'):
                logging.getLogger(name).addFilter(self)

    def filter(self, record: logging.LogRecord) -> bool:
        least = logging.INFO if record.name == 'rospy.internal' else logging.WARNING
        if (record.levelno < least or not record.pathname.startswith(_ROS)
                or getattr(record, _SHORTENED, False)):
            return True
        text = _without_traceback(record.getMessage()) + (f' {record.exc_info[1]}' if record.exc_info else '')
        kind = f'{record.name} {re.sub("[^a-z ]", "", text[:_KIND].lower())}'
        if kind not in self._kinds and len(self._kinds) >= _MOST_KINDS:
            kind = record.name
        self._kinds.add(kind)
        reporter().say(functools.partial(logging.getLogger(record.name).log, record.levelno,
                                         extra={_SHORTENED: True}), kind, text)
        return False


def log_without_master() -> None:
    """Have lines for /rosout published without a question to the master; the node must be initialised.

    rospy asks for this parameter before each line, for as long as it is not set: without a master that is a traceback
    in the node's file in place of the line, and with one that hangs, whoever has something to say hangs, too.
    """
    value = rospy.get_param_cached(_OMIT_TOPICS, False)   # from then on the master tells of changes
    get_param_server_cache().set(_OMIT_TOPICS, value)


def _without_traceback(text: str) -> str:
    """A text with what was raised in place of the traceback in it: cut to one line, that would be all but its point."""
    before, found, after = text.partition(_TRACEBACK)
    return text if not found else before + after.rstrip().rpartition('\n')[2]


# rospy gives the outermost place in the stack for what its own modules log.
_ROS = (*(str(Path(module.__file__).parent) for module in (rospy, rosgraph, genpy)), threading.__file__)


@functools.lru_cache(maxsize=None)
def library_log() -> LibraryLog:
    """The one of this process."""
    return LibraryLog()
