"""demo.launch in a process of its own, which ends with this one however that ends."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import tempfile
from pathlib import Path
from typing import Iterator, Sequence

_PATIENCE = 8.0   # seconds for all that was launched to end when it is asked to


@contextlib.contextmanager
def launched(bags: Sequence[Path], base_topic: str, transport: str, view: bool,
             log: Path) -> Iterator[subprocess.Popen]:
    """Start demo.launch, paused, and end it with all it started.

    Parameters
    ----------
    bags : sequence of Path
        To be played.
    base_topic, transport : str
        The image topic in them.
    view : bool
        Whether a window shows the images.
    log : Path
        Where its output goes.
    """
    with tempfile.TemporaryDirectory(prefix='rvc_features_') as folder, open(log, 'w', encoding='utf-8') as file:
        # Arguments of a launch file are split at spaces and quotes, which paths may have: so bags get plain ones.
        links = [os.path.join(folder, f'{number}.bag') for number in range(len(bags))]
        for bag, link in zip(bags, links):
            os.symlink(bag.resolve(), link)
        process = subprocess.Popen(
            ['roslaunch', '--wait', 'rvc_features', 'demo.launch', f'in:={base_topic}',
             f'image_transport:={transport}', f'view:={str(view).lower()}', 'paused:=true', 'bags:=' + ' '.join(links)],
            stdin=subprocess.DEVNULL, stdout=file, stderr=file, start_new_session=True, preexec_fn=_end_with_the_parent,
            env={**os.environ, 'PYTHONUNBUFFERED': '1'})   # or the log of a roslaunch that is stopped stays empty
        try:
            yield process
        finally:
            _end(process)


def _end_with_the_parent() -> None:
    """In the new process: SIGINT, at which roslaunch ends its nodes, when the parent is gone, even by SIGKILL."""
    _prctl(_SET_SIGNAL_AT_DEATH_OF_THE_PARENT, signal.SIGINT)


_prctl = ctypes.CDLL(None).prctl   # looked up before the fork, after which little may be done
_SET_SIGNAL_AT_DEATH_OF_THE_PARENT = 1


def _end(process: subprocess.Popen) -> None:
    """Ask a process to end its children and itself; whatever has not ended in time is killed."""
    started = _descendants(process.pid)
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        for each in [process.pid, *started]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(each, signal.SIGKILL)
        process.wait()


def _descendants(process: int) -> list[int]:
    """The processes that one has started and those have."""
    try:
        text = Path(f'/proc/{process}/task/{process}/children').read_text()
    except OSError:      # it has ended
        return []
    children = [int(child) for child in text.split()]
    return children + [each for child in children for each in _descendants(child)]
