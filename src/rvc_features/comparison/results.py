"""Results on disk: one file for each pair, so that an interrupted comparison goes on.

A file appears whole or not at all (`os.replace`), under a name that says what it is the result of (`pair_task.key`):
whatever changes, images, settings or code, is measured anew, and only that.
"""

from __future__ import annotations

import dataclasses
import json
import os
from typing import Any

from rvc_features.recordings.whole_files import whole_file


@dataclasses.dataclass(frozen=True)
class Measured:
    """A pair without its images, and what was measured on it."""

    dataset: str
    group: str
    name: str
    change: float | None
    note: str
    shape: tuple[int, int]
    paired: bool               # or a single image, as the last frame of a recording is
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
    with whole_file(path) as unfinished:
        # A file's name may hold bytes that are no text; they become question marks.
        unfinished.write_bytes(content.encode(errors='replace') if isinstance(content, str) else content)
