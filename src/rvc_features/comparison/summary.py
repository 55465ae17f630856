"""Results of pairs gathered into tables: means over pairs, their bootstrap intervals, and who is best.

Everything here is a pure function of the results, so that the same results give the same report to the byte.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Callable, Sequence

import numpy as np

from rvc_features.comparison import datasets as data
from rvc_features.comparison import measures
from rvc_features.comparison.runner import Measured

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
    pairs: int


@dataclasses.dataclass(frozen=True)
class Curve:
    """One line of a chart per contestant."""

    title: str
    x_title: str
    x: tuple[float, ...]
    x_labels: tuple[str, ...]
    lines: tuple[tuple[float | None, ...], ...]
    chance: tuple[float | None, ...]


@dataclasses.dataclass(frozen=True)
class Section:
    """All that is said about one kind of data."""

    kind: str
    title: str
    introduction: str
    table: Table
    breakdowns: tuple[Table, ...]     # one measure each: contestants by groups
    epsilon_curve: Curve | None
    change_curves: tuple[Curve, ...]
    times: tuple[tuple[tuple[float, float], ...], ...]    # by contestant: (points found, ms) of every image
    sweeps: tuple[tuple[tuple[float, float], ...], ...]   # by contestant: the same on one image, for rising numbers
    notes: tuple[str, ...]


def sections(measured: Sequence[Measured], datasets: Sequence[data.Dataset], labels: Sequence[str],
             epsilons: Sequence[float], points: int, seed: int) -> list[Section]:
    """One section for each kind of data there is."""
    made = []
    for kind, title, introduction in _KINDS:
        of_kind = [dataset for dataset in datasets if dataset.kind == kind]
        chosen = [pair for pair in measured if pair.dataset in {dataset.name for dataset in of_kind}]
        if chosen:
            made.append(_section(kind, title, introduction, chosen, of_kind, tuple(labels), epsilons, points, seed))
    return made


_KINDS = (
    (data.SEQUENCE, 'Real images with ground truth',
     'A homography, measured by the makers of the data, says where every point of the first image lies in the second.'),
    (data.SYNTHETIC, 'Photographs under known changes',
     'Both images of a pair are drawn from one photograph, so where every point goes is known exactly. '
     'Real cameras are less kind.'),
    (data.FRAMES, 'Recordings without ground truth',
     'Nothing says where points go; each frame is compared with the next by tracking its points there and back.'),
)


def columns_for(kind: str, epsilons: Sequence[float], all_epsilons: Sequence[float], points: int) -> tuple[Column, ...]:
    """The columns of the tables for one kind of data."""
    def entry(name: str, epsilon: float) -> Callable[[dict[str, Any]], float | None]:
        index = list(all_epsilons).index(epsilon)
        return lambda values: values[name][index] if name in values else None

    def mean_of(name: str) -> Callable[[dict[str, Any]], float | None]:
        return lambda values: _mean(values.get(name))

    widest = max(epsilons)
    alone = (
        Column('coverage', 'coverage', '', HIGH, 2,
               f'share of the {measures.CELLS}x{measures.CELLS} cells of the image with at least one of the '
               f'{points} strongest points', mean_of('coverage')),
        Column('spacing', 'spacing', 'px', HIGH, 1,
               'mean distance from a point to its nearest neighbour: small where points clump', mean_of('spacing')),
    )
    ending = (
        Column('time', 'time', 'ms', LOW, 2,
               'median for one image through this package\'s interface, one thread, all detectors in turn on each '
               'image; below it the quartiles', lambda values: _median(values['milliseconds']), is_time=True),
        Column('found', 'found', 'points', NEITHER, 0,
               f'points that the detector gave in an image; the {points} strongest are compared', mean_of('found')),
    )
    if kind == data.FRAMES:
        again = tuple(
            Column(f'found_again_{epsilon:g}', f'found again, {epsilon:g} px', '', HIGH, 3,
                   f'of the points that survive: share that the detector finds in the next frame within {epsilon:g} px '
                   'of where they went', entry('found_again', epsilon)) for epsilon in epsilons)
        return (Column('tracked', 'survival', '', HIGH, 3,
                       'share of the points that a tracker follows to the next frame and back to within '
                       f'{measures.TRACK_TOLERANCE:g} px', lambda values: values.get('tracked')),
                *again, *alone,
                Column('motion', 'motion', 'px', NEITHER, 1,
                       'median way of the points to the next frame: where it is near zero, finding again is easy',
                       lambda values: values.get('motion')), *ending)
    repeatable = tuple(
        Column(f'repeatability_{epsilon:g}', f'repeatability, {epsilon:g} px', '', HIGH, 3,
               f'share of the points in the region both images see that are found again within {epsilon:g} px, one to '
               'one; beside it (chance) what as many points strewn at random would reach',
               entry('repeatability', epsilon), entry('chance', epsilon)) for epsilon in epsilons)
    return (*repeatable,
            Column('error', 'error', 'px', LOW, 2,
                   f'localisation: mean distance of the points found again within {widest:g} px from where they '
                   'should be', lambda values: values.get('error')),
            Column('matching', 'matching', '', HIGH, 3,
                   'share of the mutual matches of ORB descriptors taken at the points that are right, within '
                   f'{measures.MATCH_TOLERANCE:g} px; points without an angle are described upright', _matching),
            Column('orientation', 'angle error', '°', LOW, 1,
                   f'median difference between the angles of a point found again within {widest:g} px and what the '
                   'homography turns it by; - for detectors that give no angle',
                   lambda values: values.get('orientation_error')),
            *alone, *ending,
            Column('in_region', 'compared', 'points', NEITHER, 0,
                   f'of the {points} strongest, how many lie in the region both images see (the smaller of the two '
                   'numbers, which the repeatability is a share of)',
                   lambda values: min(values['in_region']) if 'in_region' in values else None))


def _section(kind: str, title: str, introduction: str, chosen: Sequence[Measured], datasets: Sequence[data.Dataset],
             labels: tuple[str, ...], epsilons: Sequence[float], points: int, seed: int) -> Section:
    all_epsilons = chosen[0].result['epsilons']
    columns = columns_for(kind, epsilons, all_epsilons, points)
    groups = list(dict.fromkeys(pair.group for pair in chosen))
    main = [column for column in columns if column.better == HIGH and column.key not in ('coverage', 'spacing')]
    breakdowns = tuple(_breakdown(column, chosen, groups, labels, seed) for column in main) if len(groups) > 1 else ()
    units = {group: unit for dataset in datasets for group, unit in dataset.change_unit.items()}
    headline = columns[0]
    return Section(
        kind, title, introduction, table('all', columns, chosen, labels, seed), breakdowns,
        _epsilon_curve(kind, chosen, labels, all_epsilons),
        tuple(curve for curve in (_change_curve(group, units.get(group, ''), headline, chosen, labels)
                                  for group in groups) if curve is not None),
        tuple(tuple((float(found), _median([times]) or 0.0)
                    for pair in chosen
                    for found, times in zip(pair.result['contestants'][label]['found'],
                                            pair.result['contestants'][label]['milliseconds']))
              for label in labels),
        tuple(tuple((float(found), ms) for found, ms in _sweep(chosen, label)) for label in labels),
        _notes(kind, chosen, datasets, labels, points))


def table(title: str, columns: Sequence[Column], chosen: Sequence[Measured], labels: tuple[str, ...],
          seed: int) -> Table:
    """Contestants by measures."""
    by_column = [cells(column, chosen, labels, seed) for column in columns]
    return Table(title, tuple(columns), labels, tuple(zip(*by_column)), len(chosen))


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
    resampled = measures.bootstrap_means(values, seed) if len(values) > 1 else None

    made = []
    for i, mean in enumerate(means):
        low = high = chance = None
        as_good = False
        if chances is not None and not np.isnan(chances[:, i]).all():
            chance = float(np.nanmean(chances[:, i]))
        if resampled is not None and counts[i] > 1:
            low, high = measures.interval(resampled[:, i])
            if best and i not in best and counts[best[0]] > 1:
                least, most = measures.interval(resampled[:, i] - resampled[:, best[0]])
                as_good = least <= 0 <= most
        if column.is_time:
            low, _, high = quartiles[i]
        made.append(Cell(mean, low, high, i in best, as_good, chance, int(counts[i])))
    return made


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


def _breakdown(column: Column, chosen: Sequence[Measured], groups: Sequence[str], labels: tuple[str, ...],
               seed: int) -> Table:
    """One measure, contestants by groups; each group becomes a column."""
    columns, by_group = [], []
    for group in groups:
        columns.append(dataclasses.replace(column, title=group, unit=''))
        by_group.append(cells(column, [pair for pair in chosen if pair.group == group], labels, seed))
    return Table(column.heading, tuple(columns), labels, tuple(zip(*by_group)), len(chosen))


def _epsilon_curve(kind: str, chosen: Sequence[Measured], labels: tuple[str, ...],
                   all_epsilons: Sequence[float]) -> Curve | None:
    name = 'found_again' if kind == data.FRAMES else 'repeatability'

    def means(wanted: str, of_labels: Sequence[str]) -> list[float | None]:
        rows = [pair.result['contestants'][label][wanted] for label in of_labels for pair in chosen
                if wanted in pair.result['contestants'][label]]
        return [_mean([row[i] for row in rows]) for i in range(len(all_epsilons))]

    lines = tuple(tuple(means(name, [label])) for label in labels)
    if all(value is None for line in lines for value in line):
        return None
    return Curve('found again' if kind == data.FRAMES else 'repeatability', 'ε in pixels', tuple(all_epsilons),
                 tuple(f'{epsilon:g}' for epsilon in all_epsilons), lines, tuple(means('chance', labels)))


def _change_curve(group: str, unit: str, column: Column, chosen: Sequence[Measured],
                  labels: tuple[str, ...]) -> Curve | None:
    """One measure over the size of the change, the mean of the pairs that have the same."""
    by_change: dict[float, list[Measured]] = {}
    for pair in chosen:
        if pair.group == group and pair.change is not None:
            by_change.setdefault(pair.change, []).append(pair)
    changes = sorted(by_change)
    if len(changes) < 2:
        return None

    def means(value: Callable[[dict[str, Any]], float | None], of_labels: Sequence[str]) -> tuple[float | None, ...]:
        return tuple(_mean([value(pair.result['contestants'][label]) for pair in by_change[change]
                            for label in of_labels]) for change in changes)

    return Curve(group, unit, tuple(changes), tuple(f'{change:g}' for change in changes),
                 tuple(means(column.value, [label]) for label in labels),
                 means(column.chance, labels) if column.chance else (None,) * len(changes))


def _notes(kind: str, chosen: Sequence[Measured], datasets: Sequence[data.Dataset], labels: Sequence[str],
           points: int) -> tuple[str, ...]:
    notes = [f'{pair.group}, {pair.name}: {pair.note}.' for pair in chosen if pair.note]
    for dataset in datasets:
        if dataset.skipped:
            frames = 'frame' if len(dataset.skipped) == 1 else 'frames'
            notes.append(f'{dataset.name}: {len(dataset.skipped)} {frames} could not be decoded, and skipped; '
                         f'the first: {dataset.skipped[0]}.')
    if len(chosen) == 1:
        notes.append('There is one pair only: no interval can be given, and a small difference means nothing.')
    fewer: dict[int, list[str]] = {}
    for label in labels:
        short = sum(1 for pair in chosen if min(pair.result['contestants'][label]['found']) < points)
        fewer.setdefault(short, []).append(label)
    for short, those in fewer.items():
        if short:
            notes.append(f'Fewer than {points} points on {short} of {len(chosen)} pairs: {"; ".join(those)}. Fewer are '
                         'compared there, usually better ones, so the comparison with the others is not quite fair.')
    if kind == data.FRAMES and any('tracked' not in pair.result['contestants'][labels[0]] for pair in chosen[:-1]):
        notes.append('Where two images that follow each other differ in size, nothing is tracked.')
    return tuple(notes)


def _sweep(chosen: Sequence[Measured], label: str) -> list[tuple[int, float]]:
    return next((pair.result['contestants'][label]['sweep'] for pair in chosen
                 if 'sweep' in pair.result['contestants'][label]), [])


def _matrix(value: Callable[[dict[str, Any]], float | None], chosen: Sequence[Measured],
            labels: Sequence[str]) -> np.ndarray:
    """Pairs by contestants, NaN where there is no value."""
    rows = [[value(pair.result['contestants'][label]) for label in labels] for pair in chosen]
    return np.array([[math.nan if each is None else each for each in row] for row in rows], np.float64)


def _matching(values: dict[str, Any]) -> float | None:
    return values['right_matches'] / values['matches'] if values.get('matches') else None


def _mean(values: Sequence[float | None] | None) -> float | None:
    known = [value for value in values or () if value is not None]
    return sum(known) / len(known) if known else None


def _median(times: Sequence[Sequence[float]]) -> float | None:
    samples = [time for image in times for time in image]
    return float(np.median(samples)) if samples else None
