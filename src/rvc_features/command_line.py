"""What the command-line tools share: numbers as options, interruptions, progress, and quiet decoders."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
from types import TracebackType
from typing import Any, Callable, Iterable, Iterator, NoReturn

FAILED = 1             # exit status of a tool that could not end what it began
BAD_INPUT = 2          # of one that was given what it can't use; argparse's own


class Interrupted(BaseException):
    """Ctrl-C or SIGTERM; not an Exception, so that nothing on the way takes it for an error.

    Attributes
    ----------
    status : int
        The exit status that a shell expects: 128 plus the number of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f'interrupted by {signal.Signals(number).name}')
        self.status = 128 + number


@contextlib.contextmanager
def signals_as_exceptions() -> Iterator[None]:
    """Raise Interrupted where SIGINT or SIGTERM comes, once: what is tidied up then is not interrupted again."""
    def interrupt(number: int, frame: Any) -> NoReturn:
        for each in before:
            signal.signal(each, signal.SIG_IGN)
        raise Interrupted(number)

    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number in before:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def positive_number(text: str) -> float:
    """An option that is a number above zero (and below 2^32, as seconds of ROS are)."""
    try:
        number = float(text)
    except ValueError:
        number = 0
    if not 0 < number < 2 ** 32:
        raise argparse.ArgumentTypeError(f'must be a positive number; got {text!r}')
    return number


def at_least(least: int) -> Callable[[str], int]:
    """The type of an option that is such an integer."""
    def integer(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            number = least - 1
        if number < least:
            raise argparse.ArgumentTypeError(f'must be an integer of at least {least}; got {text!r}')
        return number
    return integer


def with_progress(items: Iterable[Any], unit: str) -> Iterable[Any]:
    """The same items, with a bar on a terminal that shows how far they are."""
    try:
        from tqdm import tqdm
    except ImportError:    # then there is no bar
        return items
    return tqdm(items, unit=unit, disable=None)


def print_safely() -> None:
    """From here on, letters that the terminal lacks (or a file name has wrong) are printed as \\x.., not an error.

    And what can't be printed at all, into a file on a full disk or a pipe that nobody reads, ends it with a sentence.
    """
    sys.excepthook = _say_of_system
    with contextlib.suppress(AttributeError):     # a stream that somebody put there in place of the terminal
        sys.stdout.reconfigure(errors='backslashreplace')   # type: ignore[union-attr]


def _say_of_system(kind: type[BaseException], error: BaseException, where: TracebackType | None) -> None:
    """In place of a traceback, for errors that the system makes and the program can't help; it ends with FAILED."""
    if isinstance(error, OSError):
        print(f'{os.path.basename(sys.argv[0])}: {error}', file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, where)


def quiet_opencv() -> None:
    """What OpenCV prints about a bad file is said by us, once and in words. To be called before it opens a video."""
    import cv2
    os.environ.setdefault('OPENCV_FFMPEG_LOGLEVEL', '-8')
    set_level = getattr(cv2, 'setLogLevel', None) or getattr(getattr(cv2.utils, 'logging', None), 'setLogLevel', None)
    if set_level is not None:     # OpenCV 4.2 has neither
        set_level(0)
