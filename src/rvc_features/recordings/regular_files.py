"""Files that a user names, read with care: a pipe, a device or a folder in their place is refused, not waited for."""

from __future__ import annotations

import stat
from pathlib import Path


class SourceError(ValueError):
    """A file that can't be used; the text names it and says what is accepted."""


def check_regular(path: str | Path) -> None:
    """SourceError unless there is a file with content of its own, which can be read more than once."""
    try:
        mode = Path(path).stat().st_mode
    except FileNotFoundError:
        raise SourceError(f'{path}: no such file') from None
    except (OSError, ValueError) as error:      # ValueError: a null character in the name
        raise SourceError(f'{path}: {getattr(error, "strerror", None) or error}') from None
    if not stat.S_ISREG(mode):
        what = 'a folder' if stat.S_ISDIR(mode) else 'a pipe' if stat.S_ISFIFO(mode) else 'a device or socket'
        raise SourceError(f'{path}: {what}, not a file')


def read_text(path: str | Path, most: int = 2 ** 20) -> str:
    """The text in a small file, in UTF-8 (what isn't is replaced); SourceError where it can't be read.

    Parameters
    ----------
    path : str or Path
    most : int
        Bytes; a larger file is refused.
    """
    check_regular(path)
    try:
        with open(path, 'rb') as file:
            data = file.read(most + 1)
    except OSError as error:
        raise SourceError(f'{path}: {error.strerror}') from None
    if len(data) > most:
        raise SourceError(f'{path}: larger than {most} bytes, which no such file is')
    return data.decode('utf-8', errors='replace')
