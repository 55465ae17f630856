"""The command line: `rosrun rvc_features check_exercise`, or `python3 -m rvc_features.exercise.command`."""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import textwrap
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Sequence

from rvc_features.exercise import pictures
from rvc_features.exercise.examination import FAILED, PASSED, Examination, examine
from rvc_features.exercise.subject import CannotRunError, ClassSubject

CANNOT_RUN = 2           # exit status, as argparse's own
_SECONDS = 8.0           # limit for one image


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit status: 0 all passed, 1 a mistake, 2 something can't be run (the worst of all)."""
    parser = _parser()
    given = parser.parse_args(arguments)
    try:
        if given.node:
            from rvc_features.exercise.node_checks import examine_node
            examinations = [_report(examine_node(given.node, given.seconds, given.exercise), given)]
        else:
            targets = list(given.class_ or []) + _submissions(given.folder, given.name)
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                running = pool.map(lambda target: _examine_class(target, given), targets)
                examinations = [_report(examination, given) for examination in running]
        if given.json:
            Path(given.json).write_text(json.dumps([_as_dict(one) for one in examinations], indent=1) + '\n')
    except CannotRunError as error:
        print(f'{parser.prog}: {error}', file=sys.stderr)
        return CANNOT_RUN
    except OSError as error:
        print(f'{parser.prog}: {error.filename or ""}: {error.strerror or error}', file=sys.stderr)
        return CANNOT_RUN
    if len(examinations) > 1:
        print('\n'.join(_summary(examinations)))
    return max(examination.exit_status for examination in examinations)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='check_exercise', description='Names what a solution of the exercise does otherwise than the sheet.',
        epilog='Exit status: 0 all passed, 1 a mistake, 2 it can\'t be run; of several solutions the worst. '
               'See docs/check_exercise.md.')
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument('--class', dest='class_', nargs='+', metavar='MODULE:NAME',
                      help='classes or factories: package.module:name, or my_harris.py[:name]')
    what.add_argument('--folder', metavar='FOLDER',
                      help='submissions: each file *.py, and each sub-folder with a detector in it')
    parser.add_argument('--name', help='with --folder: the class or factory in each (default: HarrisDetector, or the '
                        'one class with a method detect)')
    what.add_argument('--node', nargs='+', metavar='NAME:=TOPIC',
                      help='a running node: in:=TOPIC image:=TOPIC [key_points:=TOPIC]')
    parser.add_argument('--exercise', type=int, choices=(1, 2, 3), default=3, help='check what is done so far')
    parser.add_argument('--json', metavar='FILE', help='write the results there, for marking')
    parser.add_argument('--pictures', metavar='FOLDER', default='check_exercise_output',
                        help='where the picture of each finding goes (default: %(default)s)')
    parser.add_argument('--seconds', type=_positive, default=_SECONDS,
                        help='limit for one image; what takes longer hangs (default: %(default)g)')
    return parser


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < float('inf'):
        raise ValueError
    return value


def _submissions(folder: str | None, name: str | None) -> list[str]:
    """Each file, and of each sub-folder the file that defines a detector."""
    if folder is None:
        return []
    root = Path(folder)
    if not root.is_dir():
        raise CannotRunError(f'{folder} is no folder')
    found = []
    for path in sorted(root.iterdir()):
        if path.name.startswith(('_', '.')):
            continue
        if path.is_file() and path.suffix == '.py':
            found.append(str(path))
        elif path.is_dir():
            found.append(str(_detector_file(path) or path))
    if not found:
        raise CannotRunError(f'{folder} has no submission: no file *.py, no sub-folder')
    return [f'{path}:{name}' if name and path.endswith('.py') else path for path in found]


def _detector_file(folder: Path) -> Path | None:
    files = sorted(folder.rglob('*.py'), key=lambda path: (len(path.parts), path))
    for sign in (r'^class HarrisDetector\b', r'^\s+def detect\('):
        for path in files:
            if re.search(sign, path.read_text(errors='replace'), re.MULTILINE):
                return path
    return None


def _examine_class(target: str, given: argparse.Namespace) -> Examination:
    try:
        if Path(target).is_dir():
            raise CannotRunError(f'{target} has no file with a class HarrisDetector or a method detect')
        subject = ClassSubject(target, given.seconds)
    except CannotRunError as error:
        return Examination(target, cannot_run=str(error))
    try:
        return examine(subject, given.exercise)
    finally:
        subject.close()


def _report(examination: Examination, given: argparse.Namespace) -> Examination:
    """Print the table, and write the pictures."""
    print(f'\n{examination.subject}')
    if examination.cannot_run:
        print(f'  can\'t be run: {examination.cannot_run}', flush=True)
        return examination
    folder = Path(given.pictures) / re.sub(r'[^\w.]+', '_', examination.subject).strip('_')
    for check in examination.checks:
        path = pictures.write(check, folder) if check.status == FAILED else None
        sentence = check.sentence + (f' [{path}]' if path else '')
        lines = textwrap.wrap(sentence, 84, break_long_words=False, break_on_hyphens=False)
        print(f'  {check.name:24s} {check.status:10s}  {lines[0]}')
        for line in lines[1:]:
            print(' ' * 39 + line)
    for remark in examination.remarks:
        print(f'  {remark}')
    print(f'  => {_verdict(examination)}')
    sys.stdout.flush()
    return examination


def _summary(examinations: Sequence[Examination]) -> list[str]:
    lines = ['', 'All submissions']
    for one in examinations:
        lines.append(f'  {one.subject:40s}  {_verdict(one)}')
    return lines


def _verdict(examination: Examination) -> str:
    if examination.cannot_run:
        return 'can\'t be run'
    passed = sum(check.status == PASSED for check in examination.checks)
    unnamed = sum(check.status == FAILED and not check.mistakes for check in examination.checks)
    parts = [' or '.join(names) for names in dict.fromkeys(check.mistakes for check in examination.checks) if names]
    parts += [f'{unnamed} for no reason that is known here'] if unnamed else []
    return '; '.join(parts) or f'{passed} passed, none failed'


def _as_dict(examination: Examination) -> dict[str, Any]:
    return {'subject': examination.subject, 'exit_status': examination.exit_status,
            'cannot_run': examination.cannot_run, 'mistakes': examination.mistakes, 'remarks': examination.remarks,
            'checks': [{'check': check.name, 'status': check.status, 'sentence': check.sentence,
                        'mistakes': list(check.mistakes)} for check in examination.checks]}


if __name__ == '__main__':
    sys.exit(main())
