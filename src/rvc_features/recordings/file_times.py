"""When images were taken, from the names of their files or a list beside them, as data sets keep it.

TUM RGB-D names a file by its seconds (1305031102.175304.png), EuRoC by its nanoseconds (1403636579763555584.png); KITTI
numbers its files and writes their times into timestamps.txt (dates) or times.txt (seconds since the start).
"""

from __future__ import annotations

import calendar
import re
from pathlib import Path
from typing import NamedTuple, Sequence

from rvc_features.recordings.regular_files import SourceError, read_text


class FileTimes(NamedTuple):
    """Times of files, in their order."""

    nanoseconds: list[int]
    since_1970: bool           # or since the start of the recording


def file_times(paths: Sequence[Path]) -> FileTimes | None:
    """The times of image files; None where neither their names nor a list beside them tells.

    Raises
    ------
    SourceError
        Where a list beside the files has no time for one of them.
    """
    named = [_time_in_name(path.stem) for path in paths]
    known = [time for time in named if time is not None]
    if known and len(known) == len(paths):
        return FileTimes(known, True)
    folders = {path.parent for path in paths}
    if len(folders) != 1 or not all(re.fullmatch(r'\d{1,18}', path.stem) for path in paths):
        return None
    folder, = folders
    for place in (folder, folder.resolve().parent):
        for name in ('timestamps.txt', 'times.txt'):
            listed = _listed_times(place / name) if (place / name).is_file() else None
            if listed is not None:
                last = max(int(path.stem) for path in paths)
                if last >= len(listed.nanoseconds):
                    raise SourceError(f'{place / name}: it has {len(listed.nanoseconds)} times, and none for image '
                                      f'{last}; take images and times of one recording, or give a rate')
                return FileTimes([listed.nanoseconds[int(path.stem)] for path in paths], listed.since_1970)
    return None


def name_of(nanoseconds: int) -> str:
    """The name, without suffix, of a file of that time: seconds and nine digits after the point, as TUM writes it."""
    return f'{nanoseconds // 10 ** 9}.{nanoseconds % 10 ** 9:09}'


_EARLIEST, _LATEST = 10 ** 9, 2 ** 32   # seconds since 1970: from 2001 to the end of what ROS can say
_DIGITS = {13: 10 ** 6, 16: 10 ** 3, 19: 1}   # nanoseconds in the unit of a name of that many digits


def _time_in_name(stem: str) -> int | None:
    """Nanoseconds since 1970, where the name is a plausible time."""
    match = re.fullmatch(r'(\d{10})\.(\d{1,9})', stem)
    if match:
        time = int(match[1]) * 10 ** 9 + int(match[2].ljust(9, '0'))
    elif stem.isascii() and stem.isdigit() and len(stem) in _DIGITS:
        time = int(stem) * _DIGITS[len(stem)]
    else:
        return None
    return time if _EARLIEST * 10 ** 9 <= time < _LATEST * 10 ** 9 else None


def _listed_times(path: Path) -> FileTimes | None:
    """The times in a list, one a line; None where it holds something else."""
    lines = [line.strip() for line in read_text(path).splitlines() if line.strip()]
    dates = [re.fullmatch(r'(\d{4})-(\d\d)-(\d\d)[ T](\d\d):(\d\d):(\d\d)(?:\.(\d{1,9})\d*)?', line) for line in lines]
    if lines and all(dates):
        return FileTimes([calendar.timegm(tuple(int(part) for part in match.groups()[:6])) * 10 ** 9
                          + int((match[7] or '').ljust(9, '0')) for match in dates if match], True)
    if lines and all(re.fullmatch(r'\d{1,9}(\.\d*)?([eE][+-]?\d{1,2})?', line) for line in lines):
        return FileTimes([round(float(line) * 10 ** 9) for line in lines], False)
    return None
