"""Contestants by measures: means over pairs, their bootstrap intervals, and who is best.

Pure functions of the results, so that the same results give the same tables to the byte.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Callable, Sequence

import numpy as np

from rvc_features.comparison import intervals
from rvc_features.comparison.results import Measured

HIGH, LOW, NEITHER = 'high', 'low', 'neither'   # which end is the good one


@dataclasses.dataclass(frozen=True)
class Column:
    """One measure in the tables."""

    key: str
    title: str
    unit: str
    better: str
    digits: int
    explanation: str
    value: Callable[[dict[str, Any]], float | None]   # of one contestant on one pair
    chance: Callable[[dict[str, Any]], float | None] | None = None
    is_time: bool = False

    @property
    def heading(self) -> str:
        return f'{self.title} ({self.unit})' if self.unit else self.title

    def text(self, value: float | None) -> str:
        return '-' if value is None else f'{value:.{self.digits}f}'


@dataclasses.dataclass(frozen=True)
class Cell:
    """One number of a table."""

    value: float | None
    low: float | None = None      # ends of the 95 % interval, or the quartiles of times
    high: float | None = None
    best: bool = False
    as_good: bool = False         # its difference to the best is within what chance explains
    chance: float | None = None
    pairs: int = 0                # how many pairs it is the mean of


@dataclasses.dataclass(frozen=True)
class Table:
    """Contestants by measures, over the same pairs."""

    title: str
    columns: tuple[Column, ...]
    labels: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    pairs: int                    # of two images each
    single: int = 0               # images beside them that have no second one

    def basis(self) -> str:
        """What the numbers are means over, in words."""
        pairs = f'{self.pairs} pair{"s" * (self.pairs != 1)}'
        images = f'{self.single} single image{"s" * (self.single != 1)}'
        return f'{pairs} and {images}' if self.pairs and self.single else images if self.single else pairs


def table(title: str, columns: Sequence[Column], chosen: Sequence[Measured], labels: tuple[str, ...],
          seed: int) -> Table:
    """Contestants by intervals."""
    by_column = [cells(column, chosen, labels, seed) for column in columns]
    return Table(title, tuple(columns), labels, tuple(zip(*by_column)), *_counts(chosen))


def cells(column: Column, chosen: Sequence[Measured], labels: tuple[str, ...], seed: int) -> list[Cell]:
    """One column: a cell for each contestant."""
    values = _matrix(column.value, chosen, labels)
    chances = _matrix(column.chance, chosen, labels) if column.chance else None
    counts = (~np.isnan(values)).sum(axis=0)
    means = [float(np.nanmean(values[:, i])) if counts[i] else None for i in range(len(labels))]
    if column.is_time:
        quartiles = [_quartiles(chosen, label) for label in labels]
        means = [quartile[1] for quartile in quartiles]
    best = _best(means, column.better)
    resampled = intervals.bootstrap_means(values, seed) if len(values) > 1 else None

    made = []
    for i, mean in enumerate(means):
        low = high = chance = None
        as_good = False
        if chances is not None and not np.isnan(chances[:, i]).all():
            chance = float(np.nanmean(chances[:, i]))
        if resampled is not None and counts[i] > 1:
            low, high = intervals.interval(resampled[:, i])
            if best and i not in best and counts[best[0]] > 1:
                least, most = intervals.interval(resampled[:, i] - resampled[:, best[0]])
                as_good = least <= 0 <= most
        if column.is_time:
            low, _, high = quartiles[i]
        made.append(Cell(mean, low, high, i in best, as_good, chance, int(counts[i])))
    return made


def breakdown(column: Column, chosen: Sequence[Measured], groups: Sequence[str], labels: tuple[str, ...],
               seed: int) -> Table:
    """One measure, contestants by groups; each group becomes a column."""
    columns, by_group = [], []
    for group in groups:
        columns.append(dataclasses.replace(column, title=group, unit=''))
        by_group.append(cells(column, [pair for pair in chosen if pair.group == group], labels, seed))
    return Table(column.heading, tuple(columns), labels, tuple(zip(*by_group)), *_counts(chosen))


def _counts(chosen: Sequence[Measured]) -> tuple[int, int]:
    pairs = sum(each.paired for each in chosen)
    return pairs, len(chosen) - pairs


def _quartiles(chosen: Sequence[Measured], label: str) -> tuple[float, float, float]:
    samples = [time for pair in chosen for times in pair.result['contestants'][label]['milliseconds'] for time in times]
    low, middle, high = np.percentile(samples, [25, 50, 75])
    return float(low), float(middle), float(high)


def _best(means: Sequence[float | None], better: str) -> list[int]:
    """Indices of the best values; none where only one contestant has a value, or neither end is good."""
    known = [mean for mean in means if mean is not None]
    if better == NEITHER or len(known) < 2:
        return []
    leading = max(known) if better == HIGH else min(known)
    return [i for i, mean in enumerate(means) if mean == leading]


def _matrix(value: Callable[[dict[str, Any]], float | None], chosen: Sequence[Measured],
            labels: Sequence[str]) -> np.ndarray:
    """Pairs by contestants, NaN where there is no value."""
    rows = [[value(pair.result['contestants'][label]) for label in labels] for pair in chosen]
    return np.array([[math.nan if each is None else each for each in row] for row in rows], np.float64)


def mean(values: Sequence[float | None] | None) -> float | None:
    known = [value for value in values or () if value is not None]
    return sum(known) / len(known) if known else None


def median(times: Sequence[Sequence[float]]) -> float | None:
    samples = [time for image in times for time in image]
    return float(np.median(samples)) if samples else None
