"""What the documents show to be typed: blocks of code, and the commands in them and in their lines of text."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Iterator

from markdown_it import MarkdownIt

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [ROOT / name for name in ('README.md', 'CONTRIBUTING.md', 'SECURITY.md')] + sorted(
    (ROOT / 'docs').rglob('*.md'))
# What commands begin with where they stand in a line of text.
_STARTS = ('./run ', 'rosrun rvc_features ', 'rosrun dynamic_reconfigure ', 'roslaunch rvc_features ', 'rosdep ',
           'python3 -m ', 'PYTHONPATH=')


@dataclass(frozen=True)
class Block:
    """A block of code."""

    place: str       # file and line
    language: str    # as the fence has it; '' for what is indented
    text: str


@dataclass(frozen=True)
class Command:
    """A line for the shell, without its comment."""

    place: str
    text: str

    @property
    def words(self) -> list[str]:
        """As the shell splits it; what stands in square brackets may be left out, and is there."""
        text = self.text if self.text.startswith('python3 -c') else re.sub(r'[\[\]]', '', self.text)
        return shlex.split(text)


def blocks() -> Iterator[Block]:
    """Every block of code, save the directives for Sphinx."""
    for path in DOCUMENTS:
        for token in MarkdownIt().parse(path.read_text()):
            if token.type in ('fence', 'code_block') and not token.info.startswith('{'):
                yield Block(f'{path.relative_to(ROOT)}:{token.map[0] + 1}', token.info, token.content)


def commands() -> list[Command]:
    """Every command, in the order of the documents; of one that stands there several times the first."""
    found: dict[str, Command] = {}
    for block in blocks():
        if block.language in ('', 'bash'):
            for line in block.text.replace('\\\n', ' ').splitlines():
                text = re.sub(r'(^|\s)#.*', '', line).strip()
                if text:
                    found.setdefault(text, Command(block.place, text))
    for path in DOCUMENTS:
        for token in MarkdownIt().parse(path.read_text()):
            for child in token.children or ():
                if child.type == 'code_inline' and child.content.startswith(_STARTS):
                    found.setdefault(child.content, Command(f'{path.relative_to(ROOT)}:{token.map[0] + 1}',
                                                            child.content))
    return list(found.values())
