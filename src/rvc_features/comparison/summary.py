"""Results gathered into what the report says: for each kind of data its table, curves and notes.

Everything here is a pure function of the results, so that the same results give the same report to the byte.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Callable, Sequence

from rvc_features.comparison import datasets as data
from rvc_features.comparison.columns import columns_for
from rvc_features.comparison.results import Measured
from rvc_features.comparison.tables import HIGH, Column, Table, breakdown, mean, median, table


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


def _section(kind: str, title: str, introduction: str, chosen: Sequence[Measured], datasets: Sequence[data.Dataset],
             labels: tuple[str, ...], epsilons: Sequence[float], points: int, seed: int) -> Section:
    all_epsilons = chosen[0].result['epsilons']
    columns = columns_for(kind, epsilons, all_epsilons, points)
    groups = list(dict.fromkeys(pair.group for pair in chosen))
    main = [column for column in columns if column.better == HIGH and column.key not in ('coverage', 'spacing')]
    breakdowns = tuple(breakdown(column, chosen, groups, labels, seed) for column in main) if len(groups) > 1 else ()
    units = {group: unit for dataset in datasets for group, unit in dataset.change_unit.items()}
    headline = columns[0]
    return Section(
        kind, title, introduction, table('all', columns, chosen, labels, seed), breakdowns,
        _epsilon_curve(kind, chosen, labels, all_epsilons),
        tuple(curve for curve in (_change_curve(group, units.get(group, ''), headline, chosen, labels)
                                  for group in groups) if curve is not None),
        tuple(tuple((float(found), median([times]) or 0.0)
                    for pair in chosen
                    for found, times in zip(pair.result['contestants'][label]['found'],
                                            pair.result['contestants'][label]['milliseconds']))
              for label in labels),
        tuple(tuple((float(found), ms) for found, ms in _sweep(chosen, label)) for label in labels),
        _notes(kind, chosen, datasets, labels, points))


def _epsilon_curve(kind: str, chosen: Sequence[Measured], labels: tuple[str, ...],
                   all_epsilons: Sequence[float]) -> Curve | None:
    name = 'found_again' if kind == data.FRAMES else 'repeatability'

    def means(wanted: str, of_labels: Sequence[str]) -> list[float | None]:
        rows = [pair.result['contestants'][label][wanted] for label in of_labels for pair in chosen
                if wanted in pair.result['contestants'][label]]
        return [mean([row[i] for row in rows]) for i in range(len(all_epsilons))]

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
        return tuple(mean([value(pair.result['contestants'][label]) for pair in by_change[change]
                            for label in of_labels]) for change in changes)

    return Curve(group, unit, tuple(changes), tuple(f'{change:g}' for change in changes),
                 tuple(means(column.value, [label]) for label in labels),
                 means(column.chance, labels) if column.chance else (None,) * len(changes))


def _notes(kind: str, chosen: Sequence[Measured], datasets: Sequence[data.Dataset], labels: Sequence[str],
           points: int) -> tuple[str, ...]:
    noted: dict[str, list[str]] = {}
    for pair in chosen:
        if pair.note:
            noted.setdefault(pair.note, []).append(f'{pair.group}, {pair.name}')
    notes = [f'{_some(places)}: {note}.' for note, places in noted.items()]
    for dataset in datasets:
        if dataset.skipped:
            frames = 'frame' if len(dataset.skipped) == 1 else 'frames'
            notes.append(f'{dataset.name}: {len(dataset.skipped)} {frames} could not be decoded, and skipped; '
                         f'the first: {dataset.skipped[0]}.')
    pairs = sum(pair.paired for pair in chosen)
    if pairs == 1:
        notes.append('There is one pair only: no interval can be given, and a small difference means nothing.')
    elif pairs == 0:
        notes.append('There is no pair of images: each is looked at by itself, and nothing is found again.')
    fewer: dict[int, list[str]] = {}
    for label in labels:
        short = sum(1 for pair in chosen if min(pair.result['contestants'][label]['found']) < points)
        fewer.setdefault(short, []).append(label)
    for short, those in fewer.items():
        if short:
            notes.append(f'Fewer than {points} points in {short} of {len(chosen)} measurements: {"; ".join(those)}. '
                         'Fewer are compared there, usually better ones, so the comparison with the others is not '
                         'quite fair.')
    return tuple(notes)


def _some(places: Sequence[str]) -> str:
    """The first places of a note, and how many there are."""
    if len(places) <= _PLACES:
        return '; '.join(places)
    return f'{"; ".join(places[:_PLACES])}; and {len(places) - _PLACES} more'


_PLACES = 3


def _sweep(chosen: Sequence[Measured], label: str) -> list[tuple[float, float]]:
    """Of each number of points asked for, points found and milliseconds: medians over the images it was tried on."""
    sweeps = [pair.result['contestants'][label]['sweep'] for pair in chosen
              if pair.result['contestants'][label].get('sweep')]
    return [(median([[found for found, _ in step]]) or 0.0, median([[ms for _, ms in step]]) or 0.0)
            for step in zip(*sweeps)]
