"""A student's class in a process of its own: what it answers, whatever it does."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Mapping, Sequence

import numpy as np

from rvc_features import key_points
from rvc_features.exercise.questions import PARAMETERS, Probe

_SOURCE = str(Path(__file__).resolve().parents[2])


class CannotRunError(Exception):
    """There is nothing to examine; the text says why."""


@dataclass(frozen=True)
class Answer:
    """What a solution did with one image: it found points, or there is trouble to tell."""

    points: np.ndarray | None         # of key_points.DTYPE
    trouble: str = ''                 # it raised, hung, died, or returned rubbish
    meant: bool = False               # it raised on purpose, as for an argument that it doesn't take
    changed: bool = False             # it changed its input
    printed: str = ''
    no_mask: bool = False             # it takes no mask


class ClassSubject:
    """A class or factory, by `package.module:name` or `my_harris.py:name`.

    Parameters
    ----------
    target : str
    seconds : float
        Limit for each image; the import and the first image, for which something may have to be compiled, get twice
        as long.

    Raises
    ------
    CannotRunError
        When there is no such class, or it can't be imported.
    """

    def __init__(self, target: str, seconds: float) -> None:
        self.name = target
        self.seconds = seconds
        self.printed = ''
        self._errors = tempfile.TemporaryFile()      # noqa: SIM115  (closed in close)
        path = os.pathsep.join(filter(None, (os.environ.get('PYTHONPATH'), _SOURCE)))
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'rvc_features.exercise.child', target], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=self._errors, env={**os.environ, 'PYTHONPATH': path},
            start_new_session=True)
        self._unread = b''
        self._warm = False
        self.dead = ''
        try:
            self._expect_usable(self._reply())
            self.takes: Mapping[str, str] = self._expect_usable(self._ask({'describe': list(PARAMETERS)}))['takes']
        except CannotRunError:
            self.close()
            raise

    def skipped(self) -> tuple[str, ...]:
        """The sheet's parameters that it doesn't take."""
        return tuple(name for name in PARAMETERS if name not in self.takes)

    def answer(self, probe: Probe, before: Sequence[np.ndarray] = ()) -> Answer:
        """What a new detector finds in the probe's image, having seen the images `before` it."""
        if self.dead:
            return Answer(None, self.dead)
        parameters = {self.takes[name]: value for name, value in probe.parameters.items() if name in self.takes}
        reply = self._ask({'parameters': parameters,
                           'images': [_packed(image) for image in (*before, probe.scene.image)],
                           'mask': _packed(probe.scene.mask)})
        self._warm = True
        printed, changed = reply.get('printed', ''), reply.get('changed', False)
        self.printed = self.printed or printed
        if reply.get('no_mask'):
            return Answer(None, no_mask=True)
        if 'points' in reply:
            points = np.array([tuple(row) for row in reply['points']], key_points.DTYPE)
            return Answer(points, changed=changed, printed=printed)
        if 'raised' in reply:
            return Answer(None, f'it raises {reply["raised"]}', reply['meant'], printed=printed)
        return Answer(None, reply.get('rubbish') or reply.get('unusable') or reply['trouble'], changed=changed)

    def close(self) -> None:
        """End the process, and what it has started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):      # a request that nobody read
                    stream.close()

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request).encode() + b'\n')
            self._process.stdin.flush()
        except BrokenPipeError:
            return self._death()
        return self._reply()

    def _reply(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        limit = self.seconds if self._warm else 2 * self.seconds
        deadline = time.monotonic() + limit
        while b'\n' not in self._unread:
            left = deadline - time.monotonic()
            if left <= 0 or not select.select([self._process.stdout], [], [], left)[0]:
                os.killpg(self._process.pid, signal.SIGKILL)
                self.dead = f'it hangs: there was no answer in {limit:g} s'
                return {'trouble': self.dead}
            block = os.read(self._process.stdout.fileno(), 1 << 20)
            if not block:
                return self._death()
            self._unread += block
        line, self._unread = self._unread.split(b'\n', 1)
        return json.loads(line)

    def _death(self) -> dict[str, Any]:
        status = self._process.wait()
        how = f'by {signal.Signals(-status).name}' if status < 0 else f'with exit status {status}'
        self._errors.seek(0)
        last = self._errors.read().decode(errors='replace').strip().splitlines()[-1:]
        self.dead = f'its process ended {how}' + (f': {last[0]}' if last else '')
        return {'trouble': self.dead}

    def _expect_usable(self, reply: dict[str, Any]) -> dict[str, Any]:
        self.printed = self.printed or reply.get('printed', '')
        for kind in ('unusable', 'raised', 'trouble'):
            if kind in reply:
                raise CannotRunError(reply[kind])
        return reply


def _packed(image: np.ndarray | None) -> dict[str, Any] | None:
    if image is None:
        return None
    return {'shape': image.shape, 'data': base64.b64encode(np.ascontiguousarray(image).tobytes()).decode()}
