"""What the examiner asks: images with parameters, and what counts of the answer.

What counts is where points are, by named places of the image, their order, angles and sizes; never a number that a
right solution is free to choose, such as the unit of the response.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Callable, Iterable, Mapping, Sequence

import numpy as np

from rvc_features.exercise import scenes
from rvc_features.exercise.scenes import BETWEEN, ELSEWHERE, Scene

FIRST = ('corners', 'edges', 'threshold', 'window')      # what all other questions build on
PARAMETERS = ('window_size', 'threshold', 'fixed_number_of_points', 'number_of_points', 'octaves', 'anms',
              'anms_points')
USUAL = {'window_size': 3, 'threshold': 0.05, 'fixed_number_of_points': False, 'number_of_points': 500, 'octaves': 1,
         'anms': False, 'anms_points': 500}

Answers = Sequence[np.ndarray]    # of key_points.DTYPE, one per probe


@dataclass(frozen=True)
class Probe:
    """One image, with the parameters that differ from the usual ones."""

    scene: Scene
    changed: Mapping[str, Any] = field(default_factory=dict)

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters, all of them."""
        return {**USUAL, **self.changed}


@dataclass(frozen=True)
class Question:
    """Probes and what counts of the answers: `read` gives it, `alike` compares it, `tell` says the difference."""

    name: str
    asks: str
    exercise: int
    probes: tuple[Probe, ...]
    read: Callable[[Sequence[Probe], Answers], Any]
    tell: Callable[[Any, Any], str]
    alike: Callable[[Any, Any], bool] = lambda seen, expected: seen == expected
    needs: tuple[str, ...] = ()     # parameters without which it can't be asked
    decides: bool = False           # asked only where several mistakes would explain the rest; no check of its own


# ---- What counts, and how it is said ----

def places(probes: Sequence[Probe], answers: Answers) -> tuple[frozenset[str], ...]:
    """For each probe the places that have points."""
    return tuple(frozenset(probe.scene.sites_of(points)) - {BETWEEN} for probe, points in zip(probes, answers))


def named_places(probes: Sequence[Probe], answers: Answers) -> tuple[frozenset[str], ...]:
    """The same, without what lies elsewhere."""
    return tuple(found - {ELSEWHERE} for found in places(probes, answers))


def places_in_order(probes: Sequence[Probe], answers: Answers) -> tuple[tuple[str, ...], ...]:
    """For each probe the place of each point."""
    return tuple(tuple(probe.scene.sites_of(points)) for probe, points in zip(probes, answers))


def places_and_numbers(probes: Sequence[Probe], answers: Answers) -> tuple[tuple[str, ...], ...]:
    """For each probe the place of each point, in no order."""
    return tuple(tuple(sorted(order)) for order in places_in_order(probes, answers))


def places_and_clumps(probes: Sequence[Probe], answers: Answers) -> tuple[Any, ...]:
    """The places that have points, and whether the points touch one another."""
    return (*places(probes, answers), any(_clumped(points) for points in answers))


def _clumped(points: np.ndarray) -> bool:
    """Whether most points have another beside them."""
    if len(points) < 4:
        return False
    points = points[:1000]
    distance = np.hypot(*(points[axis][:, None] - points[axis] for axis in 'xy'))
    np.fill_diagonal(distance, np.inf)
    return float(((distance.min(axis=1) > 0.1) & (distance.min(axis=1) < 1.6)).mean()) > 0.5


def octaves_and_sizes(probes: Sequence[Probe], answers: Answers) -> frozenset[tuple[int, str, int]]:
    """Octave from the first, place, and size as a power of two of the smallest; of all points."""
    points = answers[0]
    if len(points) == 0:
        return frozenset()
    octave = points['octave'] - points['octave'].min()
    first = points['size'][octave == 0].min()
    powers = np.rint(np.log2(np.maximum(points['size'], 1e-9) / max(first, 1e-9))).astype(int)
    return frozenset(zip(octave.tolist(), probes[0].scene.sites_of(points), powers.tolist()))


def angles(probes: Sequence[Probe], answers: Answers) -> dict[str, float]:
    """The angle at each place, of the strongest point there."""
    found: dict[str, float] = {}
    points = answers[0][np.argsort(-answers[0]['response'], kind='stable')]
    for place, angle in zip(probes[0].scene.sites_of(points), points['angle'].tolist()):
        if place != ELSEWHERE:
            found.setdefault(place, angle)
    return found


def same_angles(seen: dict[str, float], expected: dict[str, float]) -> bool:
    """Whether four in five angles are within 30 degrees; small ones, as of radians, must agree as numbers."""
    if set(seen) != set(expected):
        return False
    small = all(abs(angle) < 2 * np.pi for angle in expected.values())
    if small != all(abs(angle) < 2 * np.pi for angle in seen.values()):
        return False
    differences = np.array([seen[place] - expected[place] for place in expected])
    if small:
        close = np.abs((differences + np.pi) % (2 * np.pi) - np.pi) < np.radians(30)
    else:
        close = np.abs((differences + 180) % 360 - 180) < 30
    return bool(close.mean() >= 0.8) if len(close) else True


def whether_different(probes: Sequence[Probe], answers: Answers) -> bool:
    """Whether the second answer differs from the first, in the place of a point or in a response."""
    first, second = (list(zip(points['x'], points['y'], points['response'])) for points in answers)
    return first != second


def whether_proportional(probes: Sequence[Probe], answers: Answers) -> str | None:
    """Whether the response grows as the fourth power of the contrast, as every term of the right H does.

    None where it can't be known, as of responses that are divided by the largest.
    """
    strongest = [float(points['response'].max(initial=0)) for points in answers]
    if not all(strength > 0 for strength in strongest) or strongest[0] == strongest[1]:
        return None
    gains = [float(probe.scene.image.max()) for probe in probes]
    ratio = strongest[1] / strongest[0] / (gains[1] / gains[0]) ** 4
    return 'as the fourth power' if abs(ratio - 1) < 2e-4 else 'otherwise'


def whether_it_falls(probes: Sequence[Probe], answers: Answers) -> str:
    """Whether fewer points come above ever larger thresholds."""
    counts = [len(points) for points in answers]
    if counts[0] == 0:
        return 'nothing above any'
    return 'fewer' if counts[-1] < counts[0] else 'all above each'


def whether_any(probes: Sequence[Probe], answers: Answers) -> str:
    """Whether there are points at all."""
    return 'points' if len(answers[0]) else 'no points'


def _list(names: Iterable[str]) -> str:
    return ', '.join(names) or 'nowhere'


def tell_places(seen: Sequence[frozenset[str]], expected: Sequence[frozenset[str]]) -> str:
    """In words: where places differ, in the first image in which they do."""
    for number, (found, right) in enumerate(zip(seen, expected), 1):
        if found != right:
            image = f'image {number}: ' if len(seen) > 1 else ''
            parts = [f'points at {_list(sorted(found - right))} where none should be'] if found - right else []
            parts += [f'none at {_list(sorted(right - found))}'] if right - found else []
            return f'{image}{"; ".join(parts)}'
    return 'the right places'


def tell_order(seen: Sequence[Sequence[str]], expected: Sequence[Sequence[str]]) -> str:
    """In words: the places of all points, in order."""
    return f'{len(seen[0])} points: {_list(seen[0][:10])}; expected {len(expected[0])}: {_list(expected[0])}'


def tell_clumps(seen: Sequence[Any], expected: Sequence[Any]) -> str:
    """In words: how the places differ, and whether there are clumps."""
    return tell_places(seen[:-1], expected[:-1]) + (', and clumps of points side by side' if seen[-1] else '')


def tell_octaves(seen: frozenset[tuple[int, str, int]], expected: frozenset[tuple[int, str, int]]) -> str:
    """In words: octave, place and size."""
    one, other = (_list([f'octave {octave} at {place}, {2.0 ** power:g} times the first size'
                         for octave, place, power in sorted(points)]) for points in (seen, expected))
    return f'points of {one}; expected {other}'


def tell_angles(seen: dict[str, float], expected: dict[str, float]) -> str:
    """In words: some angles."""
    some = [f'{seen[place]:.4g} at {place}' for place in sorted(seen)][:4]
    return f'{_list(some)} and so on' if some else 'no points'


def tell_difference(seen: bool, expected: bool) -> str:
    """In words: whether it has an effect."""
    return 'with another value it finds other points' if seen else 'with another value it finds the same points'


def _say(seen: Any, expected: Any) -> str:
    return f'{seen}; expected: {expected}'


# ---- The questions, in the order of the sheet ----

def questions() -> tuple[Question, ...]:
    """All of them."""
    return (
        Question('corners', 'a right angle has one key point, at (x, y)', 1,
                 (Probe(scenes.corners(), {'threshold': 0.1}),), places_and_clumps, tell_clumps),
        Question('edges', 'H is positive at corners, not along edges', 1,
                 tuple(Probe(scenes.edges(), {'threshold': threshold}) for threshold in (0.05, 0.25, 0.35)), places,
                 tell_places),
        Question('threshold', 'points are those above threshold * H_max, whatever the brightness', 1,
                 tuple(Probe(scenes.strengths(gain), {'threshold': threshold})
                       for gain, threshold in ((1.0, 0.3), (1.0, 0.03), (0.25, 0.3), (0.25, 0.01))),
                 named_places, tell_places, needs=('threshold',)),
        Question('window', 'window_size is the side of the window that is averaged over', 1,
                 (Probe(scenes.strengths()), Probe(scenes.strengths(), {'window_size': 9})),
                 whether_different, tell_difference, needs=('window_size',)),
        Question('colour', 'a colour image is made grey first', 1,
                 (Probe(scenes.colours(), {'threshold': 0.02}),), places, tell_places),
        Question('mask', 'no key point lies where the mask is 0', 1,
                 (Probe(scenes.masked(), {'threshold': 0.1}),), places, tell_places),
        Question('fixed number of points', 'the strongest number_of_points, strongest first', 2,
                 (Probe(scenes.strengths(), {'threshold': 0.001, 'fixed_number_of_points': True,
                                             'number_of_points': 4}),), places_in_order, tell_order,
                 needs=('fixed_number_of_points', 'number_of_points')),
        Question('octaves', 'points of smaller octaves are in pixels of the full image', 2,
                 (Probe(scenes.large(), {'octaves': 3, 'threshold': 0.02}),), octaves_and_sizes, tell_octaves,
                 needs=('octaves',)),
        Question('octaves, threshold', 'H_max is the largest response of all octaves', 2,
                 (Probe(scenes.texture(), {'octaves': 2, 'threshold': 0.2}),), places, tell_places,
                 needs=('octaves', 'threshold')),
        Question('ANMS', 'the points of largest suppression radius, c_r = 0.9', 2,
                 (Probe(scenes.crowd(), {'threshold': 0.001, 'anms': True, 'anms_points': scenes.CROWD_POINTS}),),
                 places_and_numbers, tell_order, needs=('anms', 'anms_points')),
        Question('orientation', 'the angle is atan2 of the gradient, in degrees', 2,
                 (Probe(scenes.directions(), {'threshold': 0.3}),), angles, tell_angles, same_angles),
        Question('growth with contrast', 'H is of fourth degree in the contrast', 1,
                 (Probe(scenes.faint(1), {'threshold': 0.3}), Probe(scenes.faint(100), {'threshold': 0.3})),
                 whether_proportional, _say, decides=True),
        Question('smallest threshold', 'a threshold of next to nothing lets the corners through', 1,
                 (Probe(scenes.sharp(), {'threshold': 1e-15}),), whether_any, _say, decides=True),
        Question('large thresholds', 'nothing is above a threshold of more than 1', 1,
                 tuple(Probe(scenes.strengths(), {'threshold': threshold})
                       for threshold in (1.5, 1e4, 1e7, 1e10, 1e13)),
                 whether_it_falls, _say, decides=True, needs=('threshold',)),
    )
