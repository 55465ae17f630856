"""What is said in logs, errors and diagnostics is short, whatever comes from outside. (No ROS here.)"""

from __future__ import annotations

import functools
import reprlib
import threading
import time
from typing import Any, Callable

_LONGEST_VALUE = 60    # characters of a value that is shown
_LONGEST_LINE = 160    # characters of a line in the log
_PAUSE = 10.0          # seconds from one line about a cause to the next, at the least
_MINUTE = 65.0         # seconds in which a cause has two lines; a little more, for whoever counts in minutes


class _Short(reprlib.Repr):
    """As reprlib, with texts cut at the end, where least is lost."""

    def repr_str(self, x: str, level: int) -> str:
        return repr(x) if len(x) <= _LONGEST_VALUE else f'{x[:_LONGEST_VALUE]!r}... ({len(x):,} characters)'

    def repr_bytes(self, x: bytes, level: int) -> str:
        return repr(x) if len(x) <= _LONGEST_VALUE else f'{x[:_LONGEST_VALUE]!r}... ({len(x):,} bytes)'

    def repr_float(self, x: float, level: int) -> str:
        return repr(x)


_short = _Short()
_short.maxother = _LONGEST_VALUE


def shown(value: Any) -> str:
    """`repr` of a value, cut to what a line of a log or of a panel can take."""
    return _short.repr(value)


def cut(text: str, most: int = _LONGEST_LINE) -> str:
    """A text on one line, with what is too much left out of its middle."""
    if len(text) > 4 * most:   # not to look at all of what is thrown away
        text = f'{text[:2 * most]} {text[-most:]}'
    text = ' '.join(text.split())
    return text if len(text) <= most else f'{text[:most - most // 4 - 5]} ... {text[-(most // 4):]}'


class Reporter:
    """Says each cause of trouble in one line, at most twice a minute while it lasts, with a count of those left unsaid.

    A line goes to the terminal, to the node's file, and with the names of all topics to /rosout: a kilobyte in all.

    Parameters
    ----------
    clock : callable
        Seconds that only grow.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._causes: dict[str, _Cause] = {}
        self._lock = threading.Lock()

    def say(self, write: Callable[[str], Any], cause: str, text: str) -> None:
        """Write the text as one line, now or, with all others of that cause, later.

        Parameters
        ----------
        write : callable
            Such as rospy.logwarn.
        cause : str
            What is counted together. One of a few words of the program's own, never anything from outside.
        text : str
        """
        with self._lock:
            entry = self._causes.setdefault(cause, _Cause())
            line = entry.line(text, self._clock())
            entry.write = write
        if line:
            write(line)

    def catch_up(self) -> None:
        """Write what was left unsaid of causes whose time has come; to be called now and then, where possible."""
        with self._lock:
            now = self._clock()
            lines = [(entry.write, line) for entry in self._causes.values() for line in [entry.line(None, now)] if line]
        for write, line in lines:
            write(line)


class _Cause:
    def __init__(self) -> None:
        self.write: Callable[[str], Any] = print
        self._unsaid = 0
        self._last_text = ''
        self._before = self._said = -float('inf')   # when the last two lines were written

    def line(self, text: str | None, now: float) -> str:
        """What is to be written now that `text`, if any, has happened; empty for nothing."""
        if text is not None:
            self._last_text = text
            self._unsaid += 1
        if self._unsaid == 0 or now - self._said < _PAUSE or now - self._before < _MINUTE:
            return ''
        others = self._unsaid - 1
        count = f' (and {others:,} more in {now - self._said:.0f} s)' if others else ''
        self._unsaid, self._before, self._said = 0, self._said, now
        return cut(self._last_text, _LONGEST_LINE - len(count)) + count


@functools.lru_cache(maxsize=None)
def reporter() -> Reporter:
    """The one of this process, that all of a node share."""
    return Reporter()
