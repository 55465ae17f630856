"""The report's numbers as CSV: every number of every table, and everything that was measured on each pair.

A name that a spreadsheet would take for a formula has an apostrophe before it.
"""

from __future__ import annotations

import csv
import io
from typing import Any, Sequence

import numpy as np

from rvc_features.comparison.pair_task import Settings
from rvc_features.comparison.results import Measured
from rvc_features.comparison.summary import Section


def summary_csv(sections: Sequence[Section]) -> str:
    """One line for each number of each table."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    writer.writerow(['data', 'group', 'measure', 'unit', 'detector', 'value', 'low', 'high', 'chance', 'pairs', 'best',
                     'as_good_as_best'])
    for section in sections:
        for table in (section.table, *section.breakdowns):
            for label, row in zip(table.labels, table.rows):
                for column, cell in zip(table.columns, row):
                    group = 'all' if table is section.table else _no_formula(column.title)
                    writer.writerow([section.kind, group, column.key, column.unit, _no_formula(label),
                                     *map(_number, (cell.value, cell.low, cell.high, cell.chance)), cell.pairs,
                                     int(cell.best), int(cell.as_good)])
    return out.getvalue()


def pairs_csv(measured: Sequence[Measured], settings: Settings) -> str:
    """One line for each detector on each pair: everything that was measured."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    epsilons = settings.all_epsilons()
    several = [f'{name}_{epsilon:g}' for name in ('repeatability', 'chance', 'found_again') for epsilon in epsilons]
    ends = ('found', 'in_region', 'coverage', 'spacing_px')
    writer.writerow(['data', 'group', 'pair', 'change', 'detector',
                     *(f'{name}_{number}' for name in ends for number in (1, 2)), *several,
                     'error_px', 'orientation_error_deg', 'matches', 'right_matches', 'tracked', 'motion_px',
                     'median_ms_1', 'median_ms_2'])
    for pair in measured:
        for label, values in pair.result['contestants'].items():
            row: list[Any] = [*map(_no_formula, (pair.dataset, pair.group, pair.name)), _number(pair.change),
                              _no_formula(label)]
            for name in ('found', 'in_region', 'coverage', 'spacing'):
                row += [_number(value) for value in _two(values.get(name))]
            for name in ('repeatability', 'chance', 'found_again'):
                row += [_number(value) for value in values.get(name) or [None] * len(epsilons)]
            row += [_number(values.get(name)) for name in ('error', 'orientation_error', 'matches', 'right_matches',
                                                           'tracked', 'motion')]
            row += [_number(value) for value in _two([float(np.median(times)) for times in values['milliseconds']])]
            writer.writerow(row)
    return out.getvalue()


def _number(value: float | None) -> str:
    return '' if value is None else repr(value) if isinstance(value, int) else f'{value:.6g}'


def _two(values: Sequence[Any] | None) -> list[Any]:
    return [*(values or ()), None, None][:2]


def _no_formula(text: str) -> str:
    return f"'{text}" if text.startswith(('=', '+', '-', '@', '\t', '\r')) else text
