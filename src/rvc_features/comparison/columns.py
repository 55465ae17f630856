"""The columns of the report's tables: what each measure is called, its unit, which end is good, where it is found."""

from __future__ import annotations

from typing import Any, Callable, Sequence

from rvc_features.comparison import datasets as data
from rvc_features.comparison import measures, survival
from rvc_features.comparison.tables import HIGH, LOW, NEITHER, Column, mean, median


def columns_for(kind: str, epsilons: Sequence[float], all_epsilons: Sequence[float], points: int) -> tuple[Column, ...]:
    """The columns of the tables for one kind of data."""
    def entry(name: str, epsilon: float) -> Callable[[dict[str, Any]], float | None]:
        index = list(all_epsilons).index(epsilon)
        return lambda values: values[name][index] if name in values else None

    def mean_of(name: str) -> Callable[[dict[str, Any]], float | None]:
        return lambda values: mean(values.get(name))

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
               'image; below it the quartiles', lambda values: median(values['milliseconds']), is_time=True),
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
                       f'{survival.TRACK_TOLERANCE:g} px', lambda values: values.get('tracked')),
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


def _matching(values: dict[str, Any]) -> float | None:
    return values['right_matches'] / values['matches'] if values.get('matches') else None
