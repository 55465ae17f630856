"""One worker thread that always takes the newest item: what comes faster than it can work is dropped, not queued.

It makes a lag impossible: however slow the work and however fast the camera, the result is at most two processing
times old. (No ROS here.)
"""

from __future__ import annotations

import threading
import time
from typing import Any, Callable

_NOTHING = object()


class NewestWorker:
    """Calls `work(item)` in a thread of its own for the newest item put.

    Parameters
    ----------
    work : callable
        Takes one item.
    failed : callable
        Takes whatever `work` raises, be it SystemExit; the thread goes on with the next item.

    Attributes
    ----------
    received, dropped : int
        How many items were put, and how many of them gave way to a newer one.
    busy_since : float or None
        By time.monotonic, when the item at work was begun.
    """

    def __init__(self, work: Callable[[Any], None], failed: Callable[[BaseException], None],
                 name: str = 'newest_worker') -> None:
        self.received = 0
        self.dropped = 0
        self.busy_since: float | None = None
        self._work, self._failed = work, failed
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
            self.busy_since = time.monotonic()
            try:
                self._work(item)
            except BaseException as error:   # a thread that ends leaves a node that is up and does nothing
                self._failed(error)
            item = None   # not to hold what may be large until the next one comes
            self.busy_since = None
