"""All questions put to one solution, and what came of each: passed, failed or not tested, in one sentence."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Mapping, Protocol, Sequence

import numpy as np

from rvc_features.exercise import findings, scenes
from rvc_features.exercise.findings import Explanation
from rvc_features.exercise.mistakes import LEGAL
from rvc_features.exercise.mistakes_of_exercise_2 import NoAngle
from rvc_features.exercise.questions import FIRST, PARAMETERS, Probe, Question, questions
from rvc_features.exercise.reference import Reference
from rvc_features.exercise.subject import Answer

PASSED, FAILED, NOT_TESTED = 'passed', 'failed', 'not tested'
LAST_EXERCISE = 3


class Subject(Protocol):
    """What can be examined."""

    name: str
    printed: str
    takes: Mapping[str, str]

    def answer(self, probe: Probe, before: Sequence[np.ndarray] = ()) -> Answer:
        """What it does with one image."""


@dataclass(frozen=True)
class Check:
    """What came of one question."""

    name: str
    status: str
    sentence: str
    mistakes: tuple[str, ...] = ()                           # more than one: it is one of these
    probe: Probe | None = None                               # what to draw
    found: np.ndarray | None = None
    expected: np.ndarray | None = None


@dataclass
class Examination:
    """What came of all questions."""

    subject: str
    checks: list[Check] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    cannot_run: str = ''

    @property
    def exit_status(self) -> int:
        """0: all passed; 1: a mistake; 2: it can't be run."""
        return 2 if self.cannot_run else int(any(check.status == FAILED for check in self.checks))

    @property
    def mistakes(self) -> list[str]:
        """The names of all mistakes, each once."""
        return list(dict.fromkeys(name for check in self.checks for name in check.mistakes))


def examine(subject: Subject, exercise: int = LAST_EXERCISE, names: Sequence[str] | None = None) -> Examination:
    """Ask all there is to ask up to that exercise, or of that only the questions of these names."""
    return _Examiner(subject, exercise, names).run()


class _Examiner:
    def __init__(self, subject: Subject, exercise: int, names: Sequence[str] | None) -> None:
        self.subject = subject
        self.questions = [question for question in questions()
                          if not question.decides and question.exercise <= exercise
                          and (names is None or question.name in names)]
        self.answers: dict[str, list[Answer]] = {}
        self.result = Examination(subject.name)

    def run(self) -> Examination:
        seen: dict[str, Any] = {}
        for question in self.questions:
            answered = self._ask(question)
            if answered is not None:
                seen[question.name] = answered
        explanation = findings.explain(seen, self._ask)
        for question in self.questions:
            self.result.checks.append(self._check(question, seen, explanation))
        if seen:
            self.result.checks += [self._input(), self._memory()]
        self.result.checks.append(self._prints())
        skipped = [name for name in PARAMETERS if name not in self.subject.takes]
        if skipped:
            self.result.remarks.append(f'It doesn\'t take {", ".join(skipped)}: skipped.')
        return self.result

    def _ask(self, question: Question) -> Any:
        """What counts of the answers; None where there is none."""
        if not set(question.needs) <= set(self.subject.takes):
            return None
        answers = self.answers[question.name] = []
        for probe in question.probes:
            answers.append(self.subject.answer(probe))
            if answers[-1].points is None:
                return None
        return question.read(question.probes, [answer.points for answer in answers if answer.points is not None])

    # ---- One check each ----

    def _check(self, question: Question, seen: Mapping[str, Any], explanation: Explanation) -> Check:
        name = question.name
        if name not in seen:
            return self._unanswered(question, explanation)
        if name == 'orientation' and explanation.base is NoAngle:
            return Check(name, NOT_TESTED, 'no angle is given (-1)')
        if name not in explanation.failed:
            legal = f': {_text(explanation.base)}' if name == 'orientation' and explanation.base in LEGAL else ''
            return Check(name, PASSED, question.asks + legal)
        finding = next((one for one in explanation.findings if name in one.questions), None)
        picture = self._picture(question, explanation)
        differs = question.tell(seen[name], findings.expected(question, explanation.base))
        if finding is not None:
            looks = f'it looks like this: {finding.text}' if name == finding.questions[0] else 'for the same reason'
            return Check(name, FAILED, f'{differs}; {looks}', finding.names, *picture)
        if name in explanation.hinging:
            return Check(name, NOT_TESTED, f'hinges on what was found above ({differs})')
        sentence = f'{differs}; expected: {question.asks}; no mistake that is known here explains it'
        return Check(name, FAILED, sentence, (), *picture)

    def _unanswered(self, question: Question, explanation: Explanation) -> Check:
        missing = [name for name in question.needs if name not in self.subject.takes]
        if missing:
            return Check(question.name, NOT_TESTED, f'it doesn\'t take {", ".join(missing)}')
        answer = self.answers[question.name][-1]
        if answer.no_mask:
            return Check(question.name, NOT_TESTED, 'detect takes no mask')
        earlier = [check for check in self.result.checks if answer.trouble in check.sentence]
        if earlier:
            return Check(question.name, NOT_TESTED, f'the same as in "{earlier[0].name}"')
        if set(explanation.failed).intersection(FIRST):
            return Check(question.name, NOT_TESTED, f'hinges on what was found above: {answer.trouble}')
        if question.name == 'colour' and self._works('corners'):
            if answer.meant:
                return Check(question.name, NOT_TESTED, f'it takes no colour image: {answer.trouble}')
            return Check(question.name, FAILED, 'it looks like gradients of a colour image: it is not made grey first, '
                         f'and {answer.trouble}', ('gradients of a colour image',))
        return Check(question.name, FAILED, answer.trouble, (_kind(answer.trouble),))

    def _works(self, name: str) -> bool:
        return all(answer.points is not None for answer in self.answers.get(name, [Answer(None)]))

    def _picture(self, question: Question, explanation: Explanation) -> tuple[Probe, Any, np.ndarray]:
        """The first probe whose answer differs from the expected one, and both."""
        pairs = []
        for probe, answer in zip(question.probes, self.answers[question.name]):
            assert answer.points is not None
            right = explanation.base(**probe.parameters).detect(probe.scene.image, probe.scene.mask)
            pairs.append((probe, answer.points, right))
            if set(probe.scene.sites_of(answer.points)) != set(probe.scene.sites_of(right)):
                break
        return pairs[-1]

    def _input(self) -> Check:
        changed = [name for name, answers in self.answers.items() if any(answer.changed for answer in answers)]
        if not changed:
            return Check('input', PASSED, 'the image that is given stays as it is')
        return Check('input', FAILED, 'it looks like input image drawn into: detect changes the image (or mask) '
                     f'that it is given, in {", ".join(changed)}', ('input image drawn into',))

    def _memory(self) -> Check:
        name = 'one image after another'
        probe = Probe(scenes.corners(), {'threshold': 0.1})
        first, after = self.subject.answer(probe), self.subject.answer(probe, [scenes.strengths().image])
        if first.points is None or after.points is None:
            trouble = after.trouble if first.points is not None else ''
            return Check(name, FAILED if trouble else NOT_TESTED, trouble or 'there is no first answer',
                         (_kind(trouble),) if trouble else ())
        if np.array_equal(first.points[['x', 'y', 'octave']], after.points[['x', 'y', 'octave']]):
            return Check(name, PASSED, 'an image gives the same points whatever came before it')
        return Check(name, FAILED, 'it looks like points kept from the image before: the same image gives '
                     f'{len(first.points)} points at first, and {len(after.points)} after another one',
                     ('points kept from the image before',), probe, after.points, first.points)

    def _prints(self) -> Check:
        if not self.subject.printed:
            return Check('prints', PASSED, 'nothing is printed')
        lines = self.subject.printed.strip().splitlines() or ['']
        return Check('prints', FAILED, f'it prints while it detects: "{lines[0][:60]}"', ('prints',))


def _kind(trouble: str) -> str:
    for start, name in (('it raises', 'raises'), ('it hangs', 'hangs'), ('its process ended', 'dies')):
        if trouble.startswith(start):
            return name
    return 'rubbish'


def _text(detector: type[Reference]) -> str:
    return ' '.join((detector.__doc__ or '').split())
