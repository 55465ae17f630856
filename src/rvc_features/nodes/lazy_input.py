"""An input that a node subscribes to only while somebody listens to what it makes of it."""

from __future__ import annotations

import threading
from typing import Callable

from rvc_features.image_transport import Subscriber


class LazyInput:
    """Subscribes and unsubscribes as listeners come and go.

    `update` is to be called from one thread, and not from rospy's callbacks: those announce listeners with locks held
    that subscribing needs too. They only set `changed`, for which that thread waits.

    Parameters
    ----------
    subscribe : callable
        Makes the subscription.
    listeners : callable
        How many there are at the moment.

    Attributes
    ----------
    subscriber : image_transport.Subscriber or None
    changed : threading.Event
        To be set when somebody begins or ceases to listen.
    """

    def __init__(self, subscribe: Callable[[], Subscriber], listeners: Callable[[], int]) -> None:
        self.subscriber: Subscriber | None = None
        self.changed = threading.Event()
        self._subscribe, self._listeners = subscribe, listeners

    def update(self) -> None:
        """Subscribe if somebody listens now, unsubscribe if nobody does."""
        wanted = self._listeners() > 0
        if wanted and self.subscriber is None:
            self.subscriber = self._subscribe()
        elif not wanted and self.subscriber is not None:
            self.subscriber.shutdown()
            self.subscriber = None

    def wait(self, seconds: float) -> None:
        """Until listeners change, but not longer than that."""
        if self.changed.wait(seconds):
            self.changed.clear()
