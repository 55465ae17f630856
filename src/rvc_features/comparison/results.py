"""Results on disk: one file for each pair, so that an interrupted comparison goes on.

A file appears whole or not at all (`os.replace`), under a name that says what it is the result of (`pair_task.key`):
whatever changes, images, settings or code, is measured anew, and only that.
"""

from __future__ import annotations

import dataclasses
import json
import os
import tempfile
from typing import Any


@dataclasses.dataclass(frozen=True)
class Measured:
    """A pair without its images, and what was measured on it."""

    dataset: str
    group: str
    name: str
    change: float | None
    note: str
    shape: tuple[int, int]
    result: dict[str, Any]


class Store:
    """Results in a folder, one JSON file each."""

    def __init__(self, folder: str) -> None:
        self.folder = folder
        os.makedirs(folder, exist_ok=True)

    def load(self, key: str) -> dict[str, Any] | None:
        """The result, or None where there is none or only a damaged file."""
        try:
            with open(self._path(key), encoding='utf-8') as file:
                content = json.load(file)
        except (OSError, ValueError):
            return None
        return content['result'] if isinstance(content, dict) and content.get('key') == key else None

    def save(self, key: str, result: dict[str, Any]) -> None:
        write_whole(self._path(key), json.dumps({'key': key, 'result': result}))

    def _path(self, key: str) -> str:
        return os.path.join(self.folder, f'{key}.json')


def write_whole(path: str, content: str | bytes) -> None:
    """Write a file so that at any moment there is the old one or the new one, never half of one."""
    data = content.encode() if isinstance(content, str) else content
    handle, temporary = tempfile.mkstemp(prefix='.', suffix='.part', dir=os.path.dirname(path) or '.')
    try:
        with os.fdopen(handle, 'wb') as file:
            file.write(data)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)   # mkstemp's files are for the owner alone
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
