"""The report's tables as plain text for a terminal, and the whole report as Markdown."""

from __future__ import annotations

from typing import Iterator, Sequence

from rvc_features.comparison.contestants import Contestant
from rvc_features.comparison.datasets import Dataset
from rvc_features.comparison.page import scope
from rvc_features.comparison.pair_task import Settings
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
        lines.append(f'\n{section.title} ({table.pairs} pair{"s" * (table.pairs != 1)}; * best, ~ as good)')
        lines += ['  '.join([row[0].ljust(widths[0]), *(text.rjust(width) for text, width in zip(row[1:], widths[1:]))])
                  for row in rows]
        lines += [f'Note: {note}' for note in section.notes]
    return '\n'.join(lines) + '\n'


def as_markdown(title: str, sections: Sequence[Section], datasets: Sequence[Dataset],
                contestants: Sequence[Contestant], settings: Settings) -> str:
    """All tables as Markdown."""
    lines = [f'# {title}', '', scope(contestants, settings), '']
    for section in sections:
        lines += [f'## {section.title}', '', section.introduction, '']
        lines += [f'- {dataset.name}: {dataset.description}' for dataset in datasets if dataset.kind == section.kind]
        lines += ['', *_markdown_table(section.table), '', '**best**, ≈ not told apart from the best', '']
        for note in section.notes:
            lines += [f'Note: {note}', '']
        lines += [f'- *{column.heading}*: {column.explanation}' for column in section.table.columns] + ['']
        for table in section.breakdowns:
            lines += [f'### {table.title}', '', *_markdown_table(table), '']
    lines += ['## Settings', '']
    for contestant in contestants:
        lines.append(f'- {contestant.label}: {_settings_text(contestant)}')
    return '\n'.join(lines) + '\n'


def _markdown_table(table: Table) -> Iterator[str]:
    yield '| | ' + ' | '.join(column.heading for column in table.columns) + ' |'
    yield '|---|' + '---:|' * len(table.columns)
    for label, row in zip(table.labels, table.rows):
        cells = []
        for column, cell in zip(table.columns, row):
            text = column.text(cell.value)
            cells.append(f'**{text}**' if cell.best else f'≈ {text}' if cell.as_good else text)
        yield f'| {label} | ' + ' | '.join(cells) + ' |'
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
