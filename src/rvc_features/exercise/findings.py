"""From what was seen to the mistake: the hypothesis that explains it, and no other does."""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass
from typing import Any, Callable, Iterator, Mapping, NamedTuple, Sequence

import numpy as np

from rvc_features.exercise import mistakes_of_exercise_2  # noqa: F401  (fills the table)
from rvc_features.exercise.mistakes import LEGAL, TABLE
from rvc_features.exercise.questions import FIRST, Probe, Question, questions
from rvc_features.exercise.reference import Reference

Seen = Mapping[str, Any]        # by the name of the question: what its `read` gave

# What solutions are free to choose, the usual first.
_FILTERS = tuple({'sobel': sobel, 'window': window, 'neighbourhood': neighbourhood}
                 for neighbourhood, window, sobel in itertools.product((3, 7), ('gaussian', 'box', 'narrow'),
                                                                       (True, False)))
_STYLES = tuple({**chosen, **kind} for kind in ({}, {'minimum_response': 0.0, 'threshold_first': True},
                                                {'minimum_response': 0.0}) for chosen in _FILTERS[:6])
_MOST_BLENDS = 40


@dataclass(frozen=True)
class Finding:
    """One mistake; or several, where the images can't tell which of them it is."""

    names: tuple[str, ...]
    texts: tuple[str, ...]           # what each is, in one sentence
    questions: tuple[str, ...]       # in which it shows

    @property
    def text(self) -> str:
        """In one sentence."""
        if len(self.texts) == 1:
            return self.texts[0]
        return 'one of these, which the images can\'t tell apart: ' + '; or '.join(self.texts)


@dataclass(frozen=True)
class Explanation:
    """What there is to say about a solution."""

    base: type[Reference]                    # the reference, with what the sheet allows
    failed: tuple[str, ...]                  # questions, in order
    findings: tuple[Finding, ...]
    hinging: tuple[str, ...]                 # failed questions that a finding affects, though it doesn't explain them
    unexplained: tuple[str, ...]


class _Hypothesis(NamedTuple):
    """A way to make a mistake, in the style of a solution, and the questions in which that shows."""

    way: type[Reference]
    detector: type[Reference]
    shows: frozenset[str]


def explain(seen: Seen, ask: Callable[[Question], Any]) -> Explanation:
    """The mistakes in a solution; `ask` puts one more question, and gives None where it has no answer."""
    bases: list[type[Reference]] = [Reference, *LEGAL]
    base = min(bases, key=lambda legal: len(_failed(seen, legal)))      # of equals the first
    failed = _failed(seen, base)
    left = list(failed)
    hinging: set[str] = set()
    findings: list[Finding] = []
    first = [name for name in failed if name in FIRST]
    if first:
        chosen = _best(seen, base, left, first) or _of_first(seen, base, left, first)
        if chosen:
            chosen = chosen + _others_of_first(seen, base, chosen, failed)
            agreeing = [name for name in left if _alike(name, seen[name], chosen[0].detector)]
            findings.append(_finding(_decided(chosen, ask), agreeing))
            hinging.update(chosen[0].shows.difference(agreeing))
        else:
            findings = _blend(seen, base, failed)
            hinging.update(left if not findings else ())
            hinging.difference_update(first)
        settled = {name for finding in findings for name in finding.questions} | hinging
        left = [name for name in left if name not in settled]
    while set(left).difference(first):
        chosen = _best(seen, base, left)
        if not chosen:
            break
        findings.append(_finding(_decided(chosen, ask), [name for name in failed if name in chosen[0].shows]))
        left = [name for name in left if name not in chosen[0].shows]
    if set(findings[0].questions if findings else ()).intersection(first):
        hinging.update(left)
        left = []
    return Explanation(base, failed, tuple(findings), tuple(name for name in failed if name in hinging), tuple(left))


def expected(question: Question, detector: type[Reference] = Reference) -> Any:
    """What counts of the answers that a detector gives."""
    return _expected(question.name, detector)


def _expected(name: str, detector: type[Reference]) -> Any:
    if (name, detector) not in _read:
        question = _by_name()[name]
        _read[name, detector] = question.read(question.probes, [_answer(detector, probe) for probe in question.probes])
    return _read[name, detector]


def _answer(detector: type[Reference], probe: Probe) -> np.ndarray:
    """What the detector finds; the candidates are kept, for most mistakes are made after them."""
    made = detector(**probe.parameters)
    steps = tuple((owner, name) for owner in detector.__mro__ for name in _STEPS_TO_CANDIDATES if name in vars(owner))
    key = (steps, detector.window, getattr(detector, 'trace_weight', None), detector.sobel, detector.minimum_response,
           detector.neighbourhood,
           made.window_size, made.octaves, probe.scene.name)
    if key not in _kept:
        _kept[key] = made.all_candidates(probe.scene.image, probe.scene.mask)
    return made.choose(_kept[key])


_STEPS_TO_CANDIDATES = ('planes', 'gradients', 'averages', 'average', 'response', 'candidates', 'allowed', 'position',
                        'size', 'angle')
# These serve all solutions of a folder; what is in them doesn't depend on any.
_read: dict[tuple[str, type[Reference]], Any] = {}
_made: dict[tuple[Any, ...], type[Reference]] = {}
_kept: dict[tuple[Any, ...], np.ndarray] = {}


@functools.lru_cache(maxsize=1)
def _by_name() -> dict[str, Question]:
    return {question.name: question for question in questions()}


def _mixed(way: type[Reference], base: type[Reference], style: tuple[tuple[str, Any], ...]) -> type[Reference]:
    """One detector with all of it: each overrides a step of its own."""
    if (way, base, style) not in _made:
        bases = (way,) if base is Reference else (way, base)
        _made[way, base, style] = type(way.__name__, bases, {'__doc__': way.__doc__, **dict(style)})
    return _made[way, base, style]


def _alike(name: str, seen: Any, detector: type[Reference]) -> bool:
    return _by_name()[name].alike(seen, _expected(name, detector))


def _failed(seen: Seen, detector: type[Reference]) -> tuple[str, ...]:
    return tuple(name for name in seen if not _alike(name, seen[name], detector))


def _in_styles(way: type[Reference], base: type[Reference]) -> Iterator[type[Reference]]:
    """The way in each style and unit; which candidates there are matters little where H is wrong."""
    of_response = any(step in vars(way) for step in ('averages', 'average', 'response'))
    for style in _FILTERS if of_response else _STYLES:
        own = {key: value for key, value in style.items() if key not in vars(way)}
        for unit in way.units:
            detector = _mixed(way, base, tuple({**own, **unit}.items()))
            # With a unit so small that nothing is found anywhere, many formulas are the same.
            if not unit or _expected('smallest threshold', detector) != 'no points':
                yield detector


def _ways() -> Iterator[type[Reference]]:
    return itertools.chain.from_iterable(TABLE.values())


def _best(seen: Seen, base: type[Reference], left: list[str], must: Sequence[str] = ()) -> list[_Hypothesis]:
    """Those that show in most of the questions left, and in each as it was seen; in no other question.

    Where no question `must` be among them, mistakes that would show in the first questions are not considered.
    """
    found = []
    for way in _ways():
        best: _Hypothesis | None = None
        for detector in _in_styles(way, base):
            shows = _shows(seen, detector, base, left)
            if not shows or not shows.issuperset(must) or (best is not None and len(shows) <= len(best.shows)):
                continue
            if must or all(_same(name, base, detector) for name in FIRST):
                best = _Hypothesis(way, detector, shows)
                if len(shows) == len(left):
                    break
        if best is not None:
            found.append(best)
    most = max((len(hypothesis.shows) for hypothesis in found), default=0)
    widest = [hypothesis for hypothesis in found if len(hypothesis.shows) == most]
    return [hypothesis for hypothesis in widest if hypothesis.shows == widest[0].shows]


def _shows(seen: Seen, detector: type[Reference], base: type[Reference], left: list[str]
           ) -> frozenset[str] | None:
    """The questions in which the mistake shows; None if it would show otherwise than was seen."""
    shows = set()
    for name in left:
        if _alike(name, seen[name], detector):
            shows.add(name)
        elif not _same(name, base, detector):
            return None
    if not shows:
        return None
    for name in seen:
        if name not in left and _alike(name, seen[name], base) and not _same(name, base, detector):
            return None
    return frozenset(shows)


def _same(name: str, one: type[Reference], other: type[Reference]) -> bool:
    return _by_name()[name].alike(_expected(name, one), _expected(name, other))


def _of_first(seen: Seen, base: type[Reference], left: list[str], first: list[str]) -> list[_Hypothesis]:
    """Those that agree in the first questions, and may differ in what builds on them.

    How strong the points of a wrong response are beside one another depends on more than the sheet says.
    """
    found = []
    for way in _ways():
        for detector in _in_styles(way, base):
            if all(_alike(name, seen[name], detector) for name in (*first, *FIRST) if name in seen):
                others = [name for name in left if not _same(name, base, detector)]
                found.append(_Hypothesis(way, detector, frozenset(others)))
                break
    return found


def _others_of_first(seen: Seen, base: type[Reference], chosen: list[_Hypothesis], failed: Sequence[str]
                     ) -> list[_Hypothesis]:
    """Other mistakes that agree in each of the first questions in some style, though perhaps not in one for all.

    They are sought only where all that is chosen has a unit that was fitted: that explains much.
    """
    if not all(any(hypothesis.way.units) for hypothesis in chosen):
        return []
    names, found = {hypothesis.way.name for hypothesis in chosen}, []
    for way in _ways():
        detectors = () if way.name in names or any(way.units) else tuple(_in_styles(way, base))
        agrees = detectors and all(any(_alike(name, seen[name], detector) for detector in detectors)
                                   for name in FIRST if name in seen)
        if agrees and all(_same(name, base, detectors[0]) for name in seen if name not in failed):
            found.append(_Hypothesis(way, detectors[0], chosen[0].shows))
    return found


def _blend(seen: Seen, base: type[Reference], failed: tuple[str, ...]) -> list[Finding]:
    """Two mistakes of different steps that explain together what neither does alone; none if there are two such."""
    ways = []
    for way in _ways():
        agreeing = [name for name in failed if len(way.units) == 1 and _alike(name, seen[name], _mixed(way, base, ()))]
        if agreeing:
            ways.append(way)
    explaining: dict[frozenset[str], tuple[type[Reference], type[Reference]]] = {}
    for one, other in itertools.islice(itertools.permutations(ways, 2), _MOST_BLENDS):
        if one.name != other.name and not _failed(seen, _mixed(one, _mixed(other, base, ()), ())):
            explaining.setdefault(frozenset((one.name, other.name)), (one, other))
    if len(explaining) != 1:
        return []
    return [Finding((way.name,), (way.__doc__ or '',), failed) for way in next(iter(explaining.values()))]


def _decided(chosen: list[_Hypothesis], ask: Callable[[Question], Any]) -> list[_Hypothesis]:
    """Those that agree with the deciding questions too, if there are several."""
    for question in _by_name().values():
        if len({hypothesis.way.name for hypothesis in chosen}) < 2:
            break
        if question.decides and len({str(_expected(question.name, one.detector)) for one in chosen}) > 1:
            seen = ask(question)
            agreeing = [one for one in chosen if seen is not None and _alike(question.name, seen, one.detector)]
            chosen = agreeing or chosen
    return chosen


def _finding(chosen: list[_Hypothesis], shows: list[str]) -> Finding:
    texts: dict[str, str] = {}
    for hypothesis in chosen:
        texts.setdefault(hypothesis.way.name, ' '.join((hypothesis.way.__doc__ or '').split()))
    return Finding(tuple(texts), tuple(texts.values()), tuple(shows))
