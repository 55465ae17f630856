"""One worker thread that always takes the newest item: what comes faster than it can work is dropped, not queued.

It makes a lag impossible: however slow the work and however fast the camera, the result is at most two processing
times old. (No ROS here.)
"""

from __future__ import annotations

import threading
from typing import Any, Callable

_NOTHING = object()


class NewestWorker:
    """Calls `work(item)` in a thread of its own for the newest item put.

    Parameters
    ----------
    work : callable
        Takes one item. It must deal with its own errors.

    Attributes
    ----------
    received, dropped : int
        How many items were put, and how many of them gave way to a newer one.
    """

    def __init__(self, work: Callable[[Any], None], name: str = 'newest_worker') -> None:
        self.received = 0
        self.dropped = 0
        self._work = work
        self._slot: Any = _NOTHING
        self._stopped = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, item: Any) -> None:
        """Hand over an item; returns at once."""
        with self._changed:
            self.received += 1
            self.dropped += self._slot is not _NOTHING
            self._slot = item
            self._changed.notify()

    def stop(self, seconds: float | None = None) -> None:
        """Finish the item at work, drop what waits, and end the thread; wait for that, or at most so long."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        self._thread.join(seconds)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stopped or self._slot is not _NOTHING)
                if self._stopped:
                    return
                item, self._slot = self._slot, _NOTHING
            self._work(item)
