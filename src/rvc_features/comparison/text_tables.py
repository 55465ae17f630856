"""The report's tables as plain text for a terminal, and the whole report as Markdown.

Names that come from outside (labels, files) are shown as they are: they are no markup.
"""

from __future__ import annotations

import re
from html import escape
from typing import Iterator, Sequence

from rvc_features.comparison.contestants import Contestant
from rvc_features.comparison.datasets import Dataset
from rvc_features.comparison.page import origin, scope
from rvc_features.comparison.pair_task import Settings
from rvc_features.comparison.results import Measured
from rvc_features.comparison.summary import Section
from rvc_features.comparison.tables import Cell, Column, Table


def as_text(sections: Sequence[Section]) -> str:
    """The main tables for a terminal."""
    lines = []
    for section in sections:
        table = section.table
        rows = [['', *(column.heading for column in table.columns)]]
        rows += [[label, *(_marked(column, cell) for column, cell in zip(table.columns, row))]
                 for label, row in zip(table.labels, table.rows)]
        chances = _chances(table)
        rows += [['chance', *(f'{text} ' for text in chances)]] if any(chances) else []
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        lines.append(f'\n{section.title} ({table.basis()}; * best, ~ as good)')
        lines += ['  '.join([row[0].ljust(widths[0]), *(text.rjust(width) for text, width in zip(row[1:], widths[1:]))])
                  for row in rows]
        lines += [f'Note: {note}' for note in section.notes]
    return '\n'.join(lines) + '\n'


def as_markdown(title: str, sections: Sequence[Section], datasets: Sequence[Dataset],
                contestants: Sequence[Contestant], settings: Settings, measured: Sequence[Measured],
                command: str) -> str:
    """All tables as Markdown."""
    lines = [f'# {_plain(title)}', '', scope(contestants, settings), '',
             *(f'{_plain(line)}\n' for line in origin(measured, command))]
    for section in sections:
        lines += [f'## {section.title}', '', section.introduction, '']
        lines += [f'- {_plain(dataset.name)}: {_plain(dataset.description)}'
                  for dataset in datasets if dataset.kind == section.kind]
        lines += ['', *_markdown_table(section.table), '',
                  f'Mean over {section.table.basis()}; **best**, ≈ not told apart from the best', '']
        for note in section.notes:
            lines += [f'Note: {_plain(note)}', '']
        lines += [f'- *{column.heading}*: {column.explanation}' for column in section.table.columns] + ['']
        for table in section.breakdowns:
            lines += [f'### {_plain(table.title)}', '', *_markdown_table(table), '']
    lines += ['## Settings', '']
    for contestant in contestants:
        lines.append(f'- {_plain(contestant.label)}: {_plain(_settings_text(contestant))}')
    return '\n'.join(lines) + '\n'


def _markdown_table(table: Table) -> Iterator[str]:
    yield '| | ' + ' | '.join(_plain(column.heading) for column in table.columns) + ' |'
    yield '|---|' + '---:|' * len(table.columns)
    for label, row in zip(table.labels, table.rows):
        cells = []
        for column, cell in zip(table.columns, row):
            text = column.text(cell.value)
            cells.append(f'**{text}**' if cell.best else f'≈ {text}' if cell.as_good else text)
        yield f'| {_plain(label)} | ' + ' | '.join(cells) + ' |'
    chances = _chances(table)
    if any(chances):
        yield '| *chance* | ' + ' | '.join(chances) + ' |'


def _chances(table: Table) -> list[str]:
    """What random points would reach in each column: the mean over the detectors, which differ little in this."""
    texts = []
    for column, cells in zip(table.columns, zip(*table.rows)):
        known = [cell.chance for cell in cells if cell.chance is not None]
        texts.append(column.text(sum(known) / len(known)) if known else '')
    return texts


def _settings_text(contestant: Contestant) -> str:
    return f'{contestant.detector.name}: ' + ', '.join(
        f'{name} {value}' for name, value in contestant.settings().items())


def _marked(column: Column, cell: Cell) -> str:
    return column.text(cell.value) + ('*' if cell.best else '~' if cell.as_good else ' ')


def _plain(text: str) -> str:
    """Text on one line that Markdown shows as it is, without HTML, links and breaks of a table."""
    return re.sub(r'([\\`*\[\]|~#])', r'\\\1', escape(' '.join(text.split()), quote=False))
