"""Files that appear whole or not at all, and never in place of another one unasked."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path
from typing import Iterator


@contextlib.contextmanager
def whole_file(path: str | Path, overwrite: bool = True, suffix: str = '.part') -> Iterator[Path]:
    """Make a file under a private name beside its place, and give it its name when it is complete.

    Whatever happens meanwhile, `path` is what it was before; and of two that write it at once, one file is there whole.

    Parameters
    ----------
    path : str or Path
    overwrite : bool
        Whether a file that is there already is replaced.
    suffix : str
        Of the private name, for programs that go by it.

    Yields
    ------
    Path
        An empty file to be written, removed again if the block raises.

    Raises
    ------
    FileExistsError
        Where there is such a file, and it may not be replaced: before anything is written, or, if it came meanwhile,
        at the end.
    OSError
        Where the folder can't be written.
    """
    path = Path(path)
    if not overwrite and os.path.lexists(path):
        raise _exists(path)
    handle, name = tempfile.mkstemp(prefix='.', suffix=suffix, dir=path.parent)
    os.close(handle)
    try:
        yield Path(name)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)   # mkstemp's files are for the owner alone
        if overwrite:
            os.replace(name, path)
        else:
            _rename_to_new(name, path)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(name)
        raise


def _rename_to_new(name: str, path: Path) -> None:
    try:
        os.link(name, path)      # unlike a rename, it fails where something is there
    except FileExistsError:
        raise _exists(path) from None
    except OSError:              # a file system without links
        if os.path.lexists(path):
            raise _exists(path) from None
        os.replace(name, path)
        return
    os.unlink(name)


def _exists(path: Path) -> FileExistsError:
    return FileExistsError(f'{path}: there is such a file already')
