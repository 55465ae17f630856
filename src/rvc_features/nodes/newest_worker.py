"""One worker thread that always takes the newest item: what comes faster than it can work is dropped, not queued.

It makes a lag impossible: however slow the work and however fast the camera, the result is at most two processing
times old. (No ROS here.)
"""

from __future__ import annotations

import queue
import threading
import time
from typing import Any, Callable

_NOTHING = object()
_MOST_ABANDONED = 3   # threads; each holds what it has at hand for as long as it hangs


class AbandonedError(Exception):
    """The work of this thread was given up: nobody waits for its results any more."""


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
        self._work, self._failed, self._name = work, failed, name
        self._slot: Any = _NOTHING
        self._stopped = False
        self._lock = threading.RLock()
        self._bell: queue.SimpleQueue[None] = queue.SimpleQueue()   # one stroke for each item that found the slot empty
        self._abandoned: list[threading.Thread] = []
        self._thread = self._started()

    def put(self, item: Any) -> None:
        """Hand over an item; returns at once."""
        with self._lock:
            self.received += 1
            is_first = self._slot is _NOTHING
            self.dropped += not is_first
            self._slot = item
        if is_first:
            self._bell.put(None)

    def renew(self) -> bool:
        """Give up on the item at work, and have a fresh thread take the next ones; False where too many hang already.

        Python can't end a thread: the old one goes on, and ends when its work returns, which may be never. `work` is to
        call `check` after whatever may have hung.
        """
        with self._lock:
            if self.abandoned() >= _MOST_ABANDONED:
                return False
            self._abandoned.append(self._thread)
            self.busy_since = None
            self._thread = self._started()
            return True

    def abandoned(self) -> int:
        """How many threads were given up that still hang."""
        with self._lock:
            self._abandoned = [thread for thread in self._abandoned if thread.is_alive()]
            return len(self._abandoned)

    def check(self) -> None:
        """For `work`, after whatever may have hung: AbandonedError in a thread that has been given up meanwhile."""
        if self._abandoned and threading.current_thread() in self._abandoned:
            raise AbandonedError

    def stop(self, seconds: float | None = None) -> None:
        """Finish the item at work, drop what waits, and end the thread; wait for that, or at most so long."""
        with self._lock:
            self._stopped = True
        self._bell.put(None)
        self._thread.join(seconds)

    def _started(self) -> threading.Thread:
        thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        thread.start()
        return thread

    def _run(self) -> None:
        while True:
            self._bell.get()
            with self._lock:
                if self._stopped:
                    return
                item, self._slot = self._slot, _NOTHING
                self.busy_since = time.monotonic()
            failure: BaseException | None = None
            try:
                self._work(item)
            except BaseException as error:   # a thread that ends leaves a node that is up and does nothing
                failure = error
            item = None   # not to hold what may be large until the next one comes
            with self._lock:
                if threading.current_thread() is not self._thread:
                    return   # another has taken its place
                self.busy_since = None
            if failure is not None:
                self._failed(failure)
                failure = None   # it holds what the work had at hand
