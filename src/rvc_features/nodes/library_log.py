"""What the package's half without ROS has to say: to where the node's own messages go, and to /diagnostics."""

from __future__ import annotations

import functools
import logging
import time

import rospy

from rvc_features.brief import cut

_RECENT = 60.0   # seconds: longer than what lasts is left unsaid in between
_MOST = 5        # warnings that are kept


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


@functools.lru_cache(maxsize=None)
def library_log() -> LibraryLog:
    """The one of this process."""
    return LibraryLog()
