"""The process that a student's class runs in: it reads requests and answers them, one JSON object a line each.

    python3 -m rvc_features.exercise.child my_pkg.harris:HarrisDetector

Only NumPy and OpenCV are loaded beside the class. What the class prints goes to a file, what it reads is empty.
"""

from __future__ import annotations

import base64
import importlib
import importlib.util
import inspect
import json
import linecache
import math
import os
import select
import sys
import tempfile
import threading
import traceback
from pathlib import Path
from typing import Any, Callable, Iterator

import numpy as np

_MOST_POINTS = 20000     # are handed on; no image has as many corners
_USUAL_NAME = 'HarrisDetector'


class UnusableError(Exception):
    """What is named can't be used; the text says why."""


def load(target: str) -> Callable[..., Any]:
    """The class or factory: package.module:name, or my_harris.py[:name]."""
    place, _, name = target.partition(':')
    if place.endswith('.py'):
        path = Path(place).resolve()
        if not path.is_file():
            raise UnusableError(f'there is no file {place}')
        sys.path.insert(0, str(path.parent))
        specification = importlib.util.spec_from_file_location(path.stem, path)
        assert specification is not None
        assert specification.loader is not None
        module = importlib.util.module_from_spec(specification)
        sys.modules[path.stem] = module
        specification.loader.exec_module(module)
    else:
        sys.path.insert(0, os.getcwd())
        module = importlib.import_module(place)
    if name:
        found: Any = module
        for part in name.split('.'):
            if not hasattr(found, part):
                own = ', '.join(_own_names(module)) or 'nothing of its own'
                raise UnusableError(f'{place} has no {name}; it has {own}')
            found = getattr(found, part)
    else:
        found = _only_detector(module, place)
    if not callable(found):
        raise UnusableError(f'{target} must be a class, or a function that makes a detector; it is '
                            f'{type(found).__name__}')
    return found


def _own_names(module: Any) -> list[str]:
    return [name for name, value in vars(module).items()
            if callable(value) and getattr(value, '__module__', None) == module.__name__]


def _only_detector(module: Any, place: str) -> Any:
    """What is called HarrisDetector, or else the one class with a method detect."""
    if callable(getattr(module, _USUAL_NAME, None)):
        return getattr(module, _USUAL_NAME)
    classes = [value for value in vars(module).values() if inspect.isclass(value) and hasattr(value, 'detect')
               and value.__module__ == module.__name__]
    if len(classes) != 1:
        raise UnusableError(f'{place} has {len(classes)} classes with a method detect; give one as {place}:name')
    return classes[0]


class Submission:
    """A class, and how it wants to be called."""

    def __init__(self, target: str) -> None:
        self.make = load(target)

    def describe(self, names: list[str]) -> dict[str, Any]:
        """Which of the sheet's parameters it takes, and under which name."""
        try:
            parameters = inspect.signature(self.make).parameters
        except (TypeError, ValueError):      # not written in Python
            return {'takes': {}}
        if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values()):
            return {'takes': {name: name for name in names}}
        known = {name.lower(): name for name, parameter in parameters.items()
                 if parameter.kind in (parameter.KEYWORD_ONLY, parameter.POSITIONAL_OR_KEYWORD)}
        return {'takes': {name: known[name] for name in names if name in known}}

    def detect(self, parameters: dict[str, Any], images: list[np.ndarray], mask: np.ndarray | None) -> dict[str, Any]:
        """What one detector finds in the last of the images, having seen those before it."""
        detector = self.make(**parameters)
        if not callable(getattr(detector, 'detect', None)):
            raise UnusableError(f'{type(detector).__name__} has no method detect')
        answers = []
        for image in images:
            given, given_mask = image.copy(), None if mask is None else mask.copy()
            with_mask = () if given_mask is None else (given_mask,)
            if given_mask is not None and not _takes_mask(detector.detect):
                return {'no_mask': True}
            answer = points_of(detector.detect(given, *with_mask))
            answer['changed'] = not np.array_equal(given, image) or not (
                mask is None or given_mask is None or np.array_equal(given_mask, mask))
            answers.append(answer)
        return {**answers[-1], 'changed': any(answer['changed'] for answer in answers)}


def _takes_mask(detect: Callable[..., Any]) -> bool:
    try:
        inspect.signature(detect).bind(None, None)
    except TypeError:
        return False
    except ValueError:       # not written in Python
        return True
    return True


def points_of(found: Any) -> dict[str, Any]:
    """Key points as lists of numbers, or what is wrong with them."""
    if found is None or isinstance(found, (str, bytes, dict)):
        return {'rubbish': f'detect returned {_short(found)}, not a list of key points'}
    if isinstance(found, tuple) and len(found) == 2 and not hasattr(found[0], 'pt') and isinstance(
            found[0], (list, tuple)):
        return {'rubbish': 'detect returned two things, not one list of key points'}
    try:
        points = list(found)
    except TypeError:
        return {'rubbish': f'detect returned {_short(found)}, not a list of key points'}
    rows = []
    for point in points[:_MOST_POINTS]:
        try:
            x, y = (float(value) for value in point.pt)
        except (AttributeError, TypeError, ValueError):
            return {'rubbish': f'detect returned a list of {type(point).__name__}, which has no pt of two numbers: '
                               f'{_short(point)}'}
        if not (math.isfinite(x) and math.isfinite(y)):
            return {'rubbish': f'a key point has pt = ({x}, {y})'}
        rows.append([x, y, *_numbers(point)])
    return {'points': rows, 'count': len(points)}


def _numbers(point: Any) -> Iterator[float]:
    for name, missing in (('size', math.nan), ('angle', -1.0), ('response', math.nan), ('octave', 0)):
        try:
            yield float(getattr(point, name, missing))
        except (TypeError, ValueError):
            yield missing


def _short(value: Any) -> str:
    text = f'{value!r}'
    return text if len(text) <= 80 else f'{text[:77]}...'


def raised(error: BaseException) -> dict[str, Any]:
    """An exception in words, where it came from, and whether the class meant it."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename != __file__
              and 'importlib' not in frame.filename]
    own = [frame for frame in frames if '/site-packages/' not in frame.filename
           and '/dist-packages/' not in frame.filename] or frames
    text = ''.join(traceback.format_exception_only(type(error), error)).strip().replace('\n', ' ')
    where = f' (line {own[-1].lineno} of {os.path.basename(own[-1].filename)})' if own else ''
    line = linecache.getline(own[-1].filename, own[-1].lineno or 0).strip() if own else ''
    meant = bool(frames) and frames[-1] == own[-1] and line.startswith(('raise ', 'assert '))
    return {'raised': text[:300] + where, 'meant': meant}


def _array(packed: dict[str, Any] | None) -> np.ndarray | None:
    if packed is None:
        return None
    return np.frombuffer(base64.b64decode(packed['data']), np.uint8).reshape(packed['shape']).copy()


def _answer(submission: Submission, request: dict[str, Any]) -> dict[str, Any]:
    if 'describe' in request:
        return submission.describe(request['describe'])
    images = [image for image in map(_array, request['images']) if image is not None]
    return submission.detect(request['parameters'], images, _array(request['mask']))


def _end_with(requests: int) -> None:
    """End when nobody can ask any more: the examiner has ended, by Ctrl-C for one, while a student's class loops."""
    poll = select.poll()
    poll.register(requests, 0)   # the end of the pipe is always told
    poll.poll()
    os._exit(1)


def main() -> None:
    """Answer until there is no more to answer."""
    replies, requests = os.fdopen(os.dup(1), 'w'), os.fdopen(os.dup(0))
    threading.Thread(target=_end_with, args=(requests.fileno(),), daemon=True).start()
    printed = tempfile.TemporaryFile()   # noqa: SIM115  (as long as the process)
    os.dup2(printed.fileno(), 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    sys.stdin = open(os.devnull)         # noqa: SIM115
    told = 0

    def reply(answer: dict[str, Any]) -> None:
        nonlocal told
        sys.stdout.flush()
        size = os.fstat(printed.fileno()).st_size
        answer['printed'] = os.pread(printed.fileno(), 200, told).decode(errors='replace') if size > told else ''
        told = size
        replies.write(json.dumps(answer) + '\n')
        replies.flush()

    try:
        submission = Submission(sys.argv[1])
    except UnusableError as error:
        reply({'unusable': str(error)})
        return
    except BaseException as error:       # whatever a student's file does
        reply({'unusable': f'{sys.argv[1]} can\'t be imported: {raised(error)["raised"]}'})
        return
    reply({})
    for line in requests:
        try:
            reply(_answer(submission, json.loads(line)))
        except UnusableError as error:
            reply({'unusable': str(error)})
        except BaseException as error:   # whatever a student's class does, sys.exit included
            reply(raised(error))


if __name__ == '__main__':
    main()
